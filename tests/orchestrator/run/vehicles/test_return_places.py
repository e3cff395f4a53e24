"""Where failsafes return to besides home, by their parameters; items of a list that are places."""

from collections.abc import Mapping

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.orchestrator.run.vehicles.return_checks import (
    height_above_home_m,
    landing_item_number,
    places_of_items,
)
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver.onboard.mission_protocol import MissionItem

LAND, SPEED = mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_DO_CHANGE_SPEED
WAYPOINT, START = mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_DO_LAND_START


@pytest.mark.parametrize(
    ("autopilot", "values", "ways"),
    [
        ("px4", {"NAV_DLL_ACT": 3, "COM_OBL_RC_ACT": 4, "RTL_TYPE": 2}, set()),
        ("px4", {"NAV_DLL_ACT": 2, "COM_OBL_RC_ACT": 4}, {"rally"}),
        ("px4", {"NAV_DLL_ACT": 3, "COM_OBL_RC_ACT": 3, "RTL_TYPE": 0}, {"rally"}),
        ("px4", {"NAV_DLL_ACT": 2, "RTL_TYPE": 1}, {"rally", "landing"}),
        ("px4", {"NAV_DLL_ACT": 2, "RTL_TYPE": 2}, {"mission"}),
        ("px4", {"NAV_DLL_ACT": 2, "RTL_TYPE": 3}, {"rally", "landing"}),
        ("px4", {"NAV_DLL_ACT": 2, "RTL_TYPE": 4}, {"mission"}),
        ("px4", {"NAV_DLL_ACT": 2, "RTL_TYPE": 7}, {"rally", "landing", "mission"}),
        ("ardupilot", {"FS_GCS_ENABLE": 5}, set()),
        ("ardupilot", {"FS_GCS_ENABLE": 1}, {"rally"}),
        ("ardupilot", {"FS_GCS_ENABLE": 6}, {"rally", "landing"}),
    ],
)
def test_ways_of_return_follow_from_the_parameters(
    autopilot: str, values: Mapping[str, float], ways: set[str]
) -> None:
    assert autopilot_named(autopilot).failsafes.ways_of_return(values) == ways


def test_items_that_are_places() -> None:
    items = (
        MissionItem(command=WAYPOINT, x=1, y=2),
        MissionItem(command=SPEED, x=1, y=2),
        MissionItem(command=START),
        MissionItem(command=LAND),
        MissionItem(command=LAND, x=3, y=4, z=5.0),
        MissionItem(command=WAYPOINT, x=5, y=6, frame=mavlink.MAV_FRAME_LOCAL_NED),
        MissionItem(command=WAYPOINT, x=5, y=6, z=480.0, frame=mavlink.MAV_FRAME_GLOBAL),
    )
    assert [number for number, _ in places_of_items(items)] == [1, 5, 7]
    assert landing_item_number(items) == 3
    assert landing_item_number(items[:2]) is None
    assert landing_item_number(items[4:]) == 1
    assert [height_above_home_m(items[index]) for index in (0, 4, 6)] == [0.0, 5.0, None]


def test_the_limit_of_rally_points_follows_from_its_parameter() -> None:
    limit_m = autopilot_named("ardupilot").failsafes.rally_limit_m
    assert limit_m({"RALLY_LIMIT_KM": 0.3}) == 300.0
    assert limit_m({"RALLY_LIMIT_KM": 0.0}) == limit_m({}) == float("inf")
    assert autopilot_named("px4").failsafes.rally_limit_m({"RALLY_LIMIT_KM": 0.3}) == float("inf")
