"""Missions as each firmware flies them: what it refuses, jumps, speeds, and what it reports."""

import asyncio
import math
from collections.abc import Callable
from statistics import median
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicles.embedded.autopilot.services.test_missions import BOTH, item, upload

Scenario = Callable[[Any], Any]
ARM, MODE, START = 400, 176, 300
WAYPOINT, TAKEOFF, LAND, JUMP, SPEED = 16, 22, 21, 177, 178
TURNS, SPLINE = 18, 82


def at(r: Any, north_m: float, east_m: float) -> dict[str, int]:
    place = r.vehicle.autopilot.state.frame.to_geodetic((north_m, east_m, 0.0))
    return {"x": round(place.latitude_deg * 1e7), "y": round(place.longitude_deg * 1e7)}


def mission(r: Any, *given: Any) -> list[Any]:
    """Return the items in their order, behind the home that ArduPilot has first."""
    home = [item(0, WAYPOINT, 0)] if r.config.autopilot == "ardupilot" else []
    items = [*home, *given]
    for seq, each in enumerate(items):
        each.seq = seq
    return items


async def ready(r: Any) -> None:
    await asyncio.sleep(7.0 if r.config.autopilot == "px4" else 42.0)


async def begin(r: Any) -> None:
    """Start the mission as each firmware's users do."""
    if r.config.autopilot == "ardupilot":
        assert await r.command(MODE, 1, 4) == 0
        assert await r.command(ARM, 1) == 0
    assert await r.command(START) == 0


@BOTH
def test_jumps_and_changes_of_speed_act(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await ready(r)
            first = 0 if autopilot == "px4" else 1
            items = mission(
                r,
                item(0, TAKEOFF, 0, z=3.0),
                item(0, SPEED, 0, params=(1.0, 1.5, -1.0, 0.0)),
                item(0, WAYPOINT, 0, z=3.0, **at(r, 8.0, 0.0)),
                item(0, WAYPOINT, 0, z=3.0, **at(r, 0.0, 0.0)),
                item(0, JUMP, 0, params=(2.0 + first, 1.0, 0.0, 0.0)),
                item(0, LAND, 0),
            )
            assert await upload(r, 0, items) == 0
            await begin(r)
            speeds: list[float] = []
            while r.armed:
                speeds.append(r.speed_m_s)
                await asyncio.sleep(0.1)
                assert asyncio.get_running_loop().time() < 200.0
            reached = [m.seq - first for m in r.of("MISSION_ITEM_REACHED")]
            assert reached == [0, 2, 3, 2, 3, 5]
            assert median(speed for speed in speeds if speed > 1.0) == pytest.approx(1.5, abs=0.1)
            # At a turn PX4 overshoots: in SIH with a tenth of its drag to 2.0 m/s.
            assert max(speeds) < 2.05

    virtually(scenario())


@BOTH
def test_the_state_of_a_mission_is_reported(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await ready(r)

            async def state() -> int:
                assert await r.command(512, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT) == 0
                return int(r.last["MISSION_CURRENT"].mission_state)

            assert await state() == mavlink.MISSION_STATE_NO_MISSION
            items = mission(
                r,
                item(0, TAKEOFF, 0, z=3.0),
                item(0, WAYPOINT, 0, z=3.0, **at(r, 30.0, 0.0)),
                item(0, WAYPOINT, 0, z=3.0, **at(r, 2.0, 0.0)),
            )
            assert await upload(r, 0, items) == 0
            assert await state() == mavlink.MISSION_STATE_NOT_STARTED
            await begin(r)
            await r.until(lambda: len(r.of("MISSION_ITEM_REACHED")) == 1)
            assert await state() == mavlink.MISSION_STATE_ACTIVE
            last = len(items) - 1
            for seq in (last, last - 1):
                assert await r.command(224, seq) == 0
                assert r.vehicle.autopilot.flight.behaviour.seq == seq, "it is flown at once"
            hold = (4, 3) if autopilot == "px4" else (17, 0)
            assert await r.command(MODE, 1, *hold) == 0
            assert await state() == mavlink.MISSION_STATE_PAUSED
            assert await r.command(224, last) == 0
            refused = mavlink.MAV_RESULT_FAILED if autopilot == "px4" else mavlink.MAV_RESULT_DENIED
            assert await r.command(224, last + 1) == refused
            # PX4's command begins anew, its mode goes on; ArduCopter goes on by both.
            again = (MODE, 1, 4, 4) if autopilot == "px4" else (START,)
            assert await r.command(*again) == 0
            assert r.vehicle.autopilot.flight.behaviour.seq == last
            await r.until(lambda: len(r.of("MISSION_ITEM_REACHED")) == 2)
            assert r.last["MISSION_ITEM_REACHED"].seq == last
            assert await state() == mavlink.MISSION_STATE_COMPLETE

    virtually(scenario())


def test_without_a_takeoff_px4_climbs_and_flies(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await ready(r)
            items = [item(0, WAYPOINT, 0, z=4.0, **at(r, 6.0, 0.0)), item(1, LAND, 0)]
            assert await upload(r, 0, items) == 0
            await begin(r)
            await r.until(lambda: r.height_m > 3.5)
            assert abs(r.vehicle.truth().pose.position_ned_m[0]) < 0.5
            await r.until(lambda: not r.armed)
            assert [m.seq for m in r.of("MISSION_ITEM_REACHED")] == [0, 1]

    virtually(scenario())


def test_without_a_takeoff_arducopter_refuses(rig: Any, virtually: Scenario) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await ready(r)
            items = mission(r, item(0, WAYPOINT, 0, z=4.0, **at(r, 6.0, 0.0)), item(0, LAND, 0))
            assert await upload(r, 0, items) == 0
            assert await r.command(MODE, 1, 4) == 0
            assert await r.command(ARM, 1) == 0
            assert await r.command(START) == mavlink.MAV_RESULT_FAILED
            assert await r.command(START, 1) == mavlink.MAV_RESULT_DENIED
            await asyncio.sleep(0.1)
            assert "Auto: Missing Takeoff Cmd" in r.texts()
            assert r.custom_mode == 4

    virtually(scenario())


def test_px4_does_not_start_or_arm_for_a_mission_that_is_not_there(
    rig: Any, virtually: Scenario
) -> None:
    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await ready(r)
            assert await r.command(START) == mavlink.MAV_RESULT_DENIED
            assert await r.command(MODE, 1, 4, 4) == 0
            assert await r.command(ARM, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            items = [item(0, TAKEOFF, 0, z=3.0)]
            assert await upload(r, 0, items) == 0
            assert await r.command(START, 7) == mavlink.MAV_RESULT_DENIED
            assert await r.command(START, math.nan) == mavlink.MAV_RESULT_DENIED
            assert await r.command(START) == 0
            assert r.armed

    virtually(scenario())


PLACE = {"x": 473977400, "y": 85455900, "z": 3.0}


@pytest.mark.parametrize(
    ("given", "px4", "ardupilot"),
    [
        (item(0, 31000, 0, **PLACE), "UNSUPPORTED", "UNSUPPORTED"),
        (item(0, 82, 0, **PLACE), "UNSUPPORTED", "ACCEPTED"),
        (item(0, 18, 0, **PLACE), "UNSUPPORTED", "ACCEPTED"),
        (item(0, 16, 0, frame=10, **PLACE), "UNSUPPORTED_FRAME", "ACCEPTED"),
        (item(0, 16, 0, frame=1, **PLACE), "UNSUPPORTED_FRAME", "UNSUPPORTED_FRAME"),
        (item(0, 183, 0, params=(1.0, 1500.0, 0.0, 0.0)), "ACCEPTED", "ACCEPTED"),
        (item(0, 16, 0, params=(math.nan, 0.0, 0.0, 0.0), **PLACE), "ACCEPTED", "INVALID_PARAM1"),
        (item(0, 16, 0, params=(0.0, 0.0, math.inf, 0.0), **PLACE), *("INVALID_PARAM3",) * 2),
        (item(0, 16, 0, params=(0.0, 0.0, 0.0, math.nan), **PLACE), "ACCEPTED", "ACCEPTED"),
        (item(0, 16, 0, **(PLACE | {"x": 2_000_000_000})), *("INVALID_PARAM5_X",) * 2),
        (item(0, 16, 0, **(PLACE | {"y": -2_000_000_000})), *("INVALID_PARAM6_Y",) * 2),
        (item(0, 16, 0, **(PLACE | {"z": math.nan})), *("INVALID_PARAM7",) * 2),
        (item(0, 16, 0, **(PLACE | {"z": 3e6})), *("INVALID_PARAM7",) * 2),
    ],
)
def test_each_mission_item_has_its_answer_at_upload(
    rig: Any, virtually: Scenario, given: Any, px4: str, ardupilot: str
) -> None:
    async def scenario(autopilot: str, said: str) -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            result = await upload(r, 0, mission(r, given))
            assert result == getattr(mavlink, f"MAV_MISSION_{said}")

    virtually(scenario("px4", px4))
    virtually(scenario("ardupilot", ardupilot))


@BOTH
def test_an_item_in_floats_that_is_no_place(rig: Any, virtually: Scenario, autopilot: str) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await asyncio.sleep(1.0)
            r.send(mavlink.MAVLink_mission_count_message(1, 1, 2, 0))
            await asyncio.sleep(0.1)
            r.send(mavlink.MAVLink_mission_item_message(
                1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, math.nan, 8.5, 3.0
            ))  # fmt: skip
            await asyncio.sleep(0.1)
            assert r.last["MISSION_ACK"].type == mavlink.MAV_MISSION_INVALID_PARAM5_X
            # Out of an upload an item is refused, and not left without an answer.
            r.send(item(0, 16, 0, **PLACE))
            await asyncio.sleep(0.1)
            assert r.last["MISSION_ACK"].type == mavlink.MAV_MISSION_ERROR

    virtually(scenario())


def test_arducopter_stays_for_the_time_of_its_turns_and_goes_by_its_splines(
    rig: Any, virtually: Scenario
) -> None:
    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await ready(r)
            items = mission(
                r,
                item(0, TAKEOFF, 0, z=3.0),
                item(0, TURNS, 0, z=3.0, params=(2.0, 0.0, 0.0, 0.0), **at(r, 4.0, 0.0)),
                item(0, SPLINE, 0, z=3.0, **at(r, 4.0, 6.0)),
                item(0, LAND, 0),
            )
            assert await upload(r, 0, items) == 0
            await begin(r)
            await r.until(lambda: 1 in [m.seq for m in r.of("MISSION_ITEM_REACHED")])
            await r.until(lambda: math.hypot(*there(r, 4.0, 0.0)) < 0.5)
            took_s = await r.until(lambda: 2 in [m.seq for m in r.of("MISSION_ITEM_REACHED")])
            assert took_s == pytest.approx(36.0, abs=3.0)
            await r.until(lambda: 3 in [m.seq for m in r.of("MISSION_ITEM_REACHED")])
            assert math.hypot(*there(r, 4.0, 6.0)) < 2.5

    virtually(scenario())


def there(r: Any, north_m: float, east_m: float) -> tuple[float, float]:
    """Return how far the vehicle is from a place, north and east."""
    north, east, _ = r.vehicle.truth().pose.position_ned_m
    return north - north_m, east - east_m


@BOTH
def test_a_takeoff_without_a_place_is_reached_at_its_height(
    rig: Any, virtually: Scenario, autopilot: str
) -> None:
    """Latitude and longitude of 0 are "here": a height over that place is beneath the horizon."""

    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await ready(r)
            items = mission(
                r, item(0, TAKEOFF, 0, z=3.0), item(0, WAYPOINT, 0, z=3.0, **at(r, 8, 0))
            )
            assert await upload(r, 0, items) == 0
            await begin(r)
            await r.until(lambda: len(r.of("MISSION_ITEM_REACHED")) == 1)
            assert r.height_m > 2.0

    virtually(scenario())


@BOTH
def test_a_landing_with_a_place_is_there(rig: Any, virtually: Scenario, autopilot: str) -> None:
    """PX4 and ArduCopter fly to the place of a LAND at their height, and land there."""

    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await ready(r)
            items = mission(
                r,
                item(0, TAKEOFF, 0, z=3.0),
                item(0, WAYPOINT, 0, z=3.0, **at(r, 4.0, 0.0)),
                item(0, LAND, 0, **at(r, 4.0, 6.0)),
            )
            assert await upload(r, 0, items) == 0
            await begin(r)
            await r.until(lambda: math.hypot(*there(r, 4.0, 6.0)) < 2.5)
            assert r.height_m > 2.0, "first there, then down"
            await r.until(lambda: not r.armed)
            assert math.hypot(*there(r, 4.0, 6.0)) < 0.5
            assert [m.seq for m in r.of("MISSION_ITEM_REACHED")][-1] == len(items) - 1

    virtually(scenario())


def test_arducopter_keeps_its_height_at_a_waypoint_with_a_height_of_zero(
    rig: Any, virtually: Scenario
) -> None:
    """LOITER_TIME at 0, 0, 0 is "stay here" (ModeAuto::loc_from_cmd): it flew into the ground."""

    async def scenario() -> None:
        async with rig(autopilot="ardupilot") as r:
            await ready(r)
            stay = item(0, mavlink.MAV_CMD_NAV_LOITER_TIME, 0, params=(5.0, 0.0, 0.0, 0.0))
            await upload(r, 0, mission(r, item(0, TAKEOFF, 0, z=3.0), stay, item(0, LAND, 0)))
            await begin(r)
            await r.until(lambda: 2 in [m.seq for m in r.of("MISSION_ITEM_REACHED")])
            assert r.height_m == pytest.approx(3.0, abs=0.5)
            await r.until(lambda: not r.armed)

    virtually(scenario())


@pytest.mark.parametrize(
    ("yaw_deg", "east_m", "headed_deg"),
    [(120.0, 6.0, 120.0), (math.nan, 6.0, 0.0), (math.nan, 30.0, 90.0)],
)
def test_px4_has_the_heading_of_its_waypoint(
    rig: Any, virtually: Scenario, yaw_deg: float, east_m: float, headed_deg: float
) -> None:
    """Without one it turns to a place beyond NAV_ACC_RAD (FlightTaskAuto), MPC_YAW_MODE 0."""

    async def scenario() -> None:
        async with rig(autopilot="px4") as r:
            await ready(r)
            way = item(0, WAYPOINT, 0, z=3.0, params=(0.0, 0.0, 0.0, yaw_deg), **at(r, 0.0, east_m))
            assert await upload(r, 0, mission(r, item(0, TAKEOFF, 0, z=3.0), way)) == 0
            await begin(r)
            await r.until(lambda: len(r.of("MISSION_ITEM_REACHED")) == 2)
            headed = math.degrees(r.vehicle.truth().pose.yaw_rad)
            assert headed == pytest.approx(headed_deg, abs=8.0)

    virtually(scenario())


@BOTH
def test_a_mission_that_is_uploaded_in_flight_does_not_change_the_one_that_is_flown(
    rig: Any, virtually: Scenario, autopilot: str
) -> None:
    async def scenario() -> None:
        async with rig(autopilot=autopilot) as r:
            await ready(r)
            first = mission(
                r,
                item(0, TAKEOFF, 0, z=3.0),
                item(0, WAYPOINT, 0, z=3.0, **at(r, 15.0, 0.0)),
                item(0, LAND, 0),
            )
            assert await upload(r, 0, first) == 0
            await begin(r)
            await r.until(lambda: len(r.of("MISSION_ITEM_REACHED")) == 1)
            other = item(0, WAYPOINT, 0, z=3.0, **at(r, -30.0, 0.0))
            assert await upload(r, 0, mission(r, item(0, TAKEOFF, 0, z=3.0), other)) == 0
            await r.until(lambda: not r.armed)
            assert r.vehicle.truth().pose.position_ned_m[0] == pytest.approx(15.0, abs=1.5)

    virtually(scenario())
