"""The embedded vehicles fly the flight of step responses as their firmwares do."""

import pytest

from tests.vehicles.embedded.fidelity.comparison import (
    LIMIT,
    compare,
    distances,
    load_figures,
    load_series,
)
from tests.vehicles.embedded.fidelity.step_flight import Autopilot, Series, figures_of, fly_steps

FARTHEST_M = 0.15
SCATTERS = {"px4": {"back 0.4", "back 0.8", "back 1.5"}, "ardupilot": set()}
"""They begin where the stop before ended, which differs by 0.25 m between PX4's own flights."""


@pytest.fixture(scope="module", params=["px4", "ardupilot"])
def flight(request: pytest.FixtureRequest) -> tuple[Autopilot, Series]:
    return request.param, fly_steps(request.param)


def test_every_figure_is_within_reach_of_the_firmware(flight: tuple[Autopilot, Series]) -> None:
    autopilot, flown = flight
    rows = compare(load_figures(autopilot), figures_of(flown))
    assert len(rows) == 22
    assert [row for row in rows if row.beyond] == []


def test_each_segment_is_where_the_firmware_is(flight: tuple[Autopilot, Series]) -> None:
    autopilot, flown = flight
    apart = distances(load_series(autopilot), flown)
    assert len(apart) == 16
    far = {k: v for k, v in apart.items() if v > FARTHEST_M and k not in SCATTERS[autopilot]}
    assert far == {}


def test_a_figure_beyond_the_limit_is_seen() -> None:
    ranges = {
        "yaw 60": {"t90_s": (1.0, 1.2), "overshoot_deg": (4.0, 4.1)},
        "stop": {"d": (1.0, 1.0)},
    }
    rows = compare(ranges, {"yaw 60": {"t90_s": 1.5, "overshoot_deg": 0.5}})
    assert [row.off for row in rows[:2]] == pytest.approx([0.25, -3.5 / 5.0 * LIMIT])
    assert [row.beyond for row in rows] == [True, False, True]
