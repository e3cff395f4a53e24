"""The embedded vehicles fly the flight of step responses as their firmwares do."""

import pytest

from tests.vehicles.embedded.fidelity.comparison import (
    distances,
    load_flights,
    load_series,
    median_distances,
    pitch_distance_deg,
    scatter,
)
from tests.vehicles.embedded.fidelity.step_flight import fly_steps
from wil_campaign.plugins.step_response.comparison import LIMIT, compare_figures, load_ranges
from wil_campaign.plugins.step_response.event_order import OrderRow
from wil_campaign.plugins.step_response.figures import figures_of
from wil_campaign.plugins.step_response.segments import Series

FARTHEST_M = 0.15
SCATTERS = {"px4": {"back 0.4", "back 0.8", "back 1.5"}, "ardupilot": set()}
"""Two flights of PX4 are 0.17 to 0.24 m from each other there, 0.5 m at most: docs/decisions/0047.

They begin where the stop before ended, and that is where the velocity estimate said so.
"""

Flight = tuple[str, Series, list[OrderRow]]


FLOWN = [("px4", "jsbsim"), ("ardupilot", "jsbsim"), ("px4", "compiled"), ("ardupilot", "compiled")]


@pytest.fixture(scope="module", params=FLOWN, ids=" ".join)
def flight(request: pytest.FixtureRequest) -> Flight:
    autopilot, physics = request.param
    return autopilot, *fly_steps(autopilot, physics=physics)


@pytest.fixture(scope="module")
def px4() -> Series:
    return fly_steps("px4")[0]


def test_every_figure_is_within_reach_of_the_firmware(flight: Flight) -> None:
    autopilot, flown, _ = flight
    rows = compare_figures(load_ranges(autopilot), figures_of(flown))
    assert len(rows) == 22
    assert [row for row in rows if row.beyond] == []


def test_each_segment_is_where_the_firmware_is(flight: Flight) -> None:
    autopilot, flown, _ = flight
    apart = distances(load_series(autopilot), flown)
    assert len(apart) == 16
    far = {k: v for k, v in apart.items() if v > FARTHEST_M and k not in SCATTERS[autopilot]}
    assert far == {}


def test_px4_is_no_farther_from_the_firmwares_flights_than_they_are_from_each_other(
    px4: Series,
) -> None:
    """Not even as far as the one of the ten that is the farthest from the other nine."""
    firmware = load_flights()
    assert len(firmware) == 10
    most = {segment: max(each) for segment, each in scatter(firmware).items()}
    apart = median_distances(firmware, px4)
    assert len(apart) == 16
    assert {k: v for k, v in apart.items() if v > most[k]} == {}


@pytest.mark.parametrize("segment", ["speed 0.8", "speed 1.5", "stop 1.5", "position 2"])
def test_px4_pitches_as_and_when_the_firmware_does(px4: Series, segment: str) -> None:
    assert pitch_distance_deg(load_series("px4"), px4, segment, 2.0) < 0.5


def test_events_follow_each_other_as_the_firmware_has_them(flight: Flight) -> None:
    assert len(flight[2]) == 7
    assert [row for row in flight[2] if row.beyond] == []


def test_another_gain_is_seen() -> None:
    flown, _ = fly_steps("px4", parameters={"MPC_XY_VEL_P_ACC": 1.2})
    off = {
        (row.segment, row.name)
        for row in compare_figures(load_ranges("px4"), figures_of(flown))
        if row.beyond
    }
    assert ("speed 0.8", "t63_s") in off


def test_a_figure_beyond_the_limit_is_seen() -> None:
    ranges = {
        "yaw 60": {"t90_s": (1.0, 1.2), "overshoot_deg": (4.0, 4.1)},
        "stop": {"d": (1.0, 1.0)},
    }
    rows = compare_figures(ranges, {"yaw 60": {"t90_s": 1.5, "overshoot_deg": 0.5}})
    assert [row.off for row in rows[:2]] == pytest.approx([0.25, -3.5 / 5.0 * LIMIT])
    assert [row.beyond for row in rows] == [True, False, True]
