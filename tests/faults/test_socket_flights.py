"""Two of the flights that must fail on sockets; `python bench/must_fail.py` flies sixty."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.faults.alterations import POSSIBLE, Alteration
from tests.faults.socket_flights import SECOND_VEHICLE, draw_on_sockets, inject

WALL = replace(
    draw_on_sockets(0),
    cause="wall",
    mode="sim",
    vehicle="twin",
    autopilot="px4",
    judged_by="mocap",
    signal="mocap",
    stage="goal",
    after_s=0.5,
    alteration=Alteration("freeze", (0.0, 0.0, 0.0), 0.0),
)
"""Motion capture that repeats its last pose with new stamps, before a wall is touched."""
STALL_S = 5.0
"""A busy machine, which may hold up the poses, is no fault in them."""


async def test_a_wall_is_touched_over_relays_that_alter_nothing(tmp_path: Path) -> None:
    outcome = await inject(WALL, tmp_path, disturbed=False, stall_s=STALL_S)
    assert (outcome.verdict, outcome.reason) == ("FAIL", "twin touched wall.box")


async def test_motion_capture_that_repeats_itself_before_a_wall_proves_nothing(
    tmp_path: Path,
) -> None:
    outcome = await inject(WALL, tmp_path, stall_s=STALL_S)
    assert outcome.verdict == "INVALID", outcome.reason
    assert outcome.reason.startswith("pose of twin from mocap: it "), outcome.reason


@pytest.mark.no_turn("flies nothing")
def test_the_sixty_alter_mavlink_motion_capture_and_pictures() -> None:
    drawn = [draw_on_sockets(seed) for seed in range(60)]
    assert draw_on_sockets(7) == drawn[7]
    assert {"position", "mocap", "picture"} <= {one.signal for one in drawn}
    field = [one for one in drawn if one.signal not in POSSIBLE]
    assert {"heading", "estimator's hold", "second sender", "ground station"} == {
        one.signal for one in field
    }
    assert SECOND_VEHICLE in {one.kind for one in field}
    assert all(one.kind in POSSIBLE[one.signal] for one in drawn if one not in field)
    # What is judged is attached: no truth stands beside it.
    assert all(one.lone for one in drawn)
    assert all(one.mode == "wil" for one in drawn if one.signal == "picture")
