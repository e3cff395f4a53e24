"""Vehicles of two autopilots leave the ground together, though each takes its own time."""

from collections.abc import Callable
from pathlib import Path

import pytest

from wil_campaign.orchestrator.run_results.run_result import RunResult

Fly = Callable[..., tuple[RunResult, Path]]
HOVER = (
    "autonomy={use: autonomies/straight.py:StraightAutonomy, with: {speed_m_s: 0.3, for_s: 0.5}}",
    "vehicles.twin.autopilot=px4",
    "vehicles.twin.params={}",
    "vehicles.real.params={}",
    "inject={}",
    "oracles={landed: {}}",
)
"""An ArduCopter lifts 1.6 s after its command, a PX4 2.9 s."""


def flown(fly_run: Fly, *sets: str) -> RunResult:
    result, _ = fly_run("avoid-ardupilot", "default", sets=(*HOVER, *sets), has_cameras=False)
    return result


def test_a_mixed_pair_leaves_the_ground_together(fly_run: Fly) -> None:
    result = flown(fly_run)
    assert (result.verdict, result.reason) == ("PASS", "")
    sync = result.sync
    assert sync.takeoff_skew_s is not None
    assert sync.takeoff_skew_s < 0.3
    assert sync.command_skew_s == pytest.approx(1.3, abs=0.1)
    assert sync.liftoff_delays_s == pytest.approx({"real": 1.6, "twin": 2.9}, abs=0.15)


def test_a_pair_commanded_together_leaves_the_ground_apart(fly_run: Fly) -> None:
    result = flown(fly_run, "sync.takeoff=command")
    assert result.verdict == "INVALID"
    assert result.reason.startswith("takeoff skew 1.")
    assert result.sync.command_skew_s == 0.0
