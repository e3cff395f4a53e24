"""The distance of a pair is measured however late poses come, or the run proves nothing."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_on_clock
from wil_campaign.orchestrator.run.stages.twin_monitor import TwinMonitor
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.worlds.frames import Pose

RATE_HZ = 50.0
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


async def _fly(
    late_s: float,
    apart_m: float,
    gap_s: float,
    silent_s: tuple[float, float],
    but_at_s: float,
    *,
    is_link_silent: bool,
) -> tuple[TwinMonitor, RunState]:
    """Fly a goal of 4 s; the real vehicle's poses come so late, one every `gap_s`.

    silent_s: from when to when there are none of the twin, since t0, but one at `but_at_s`.
    """
    loop = asyncio.get_running_loop()
    run_state = RunState(time=loop.time)
    monitor = TwinMonitor(coupling="free", limit_m=1.0, max_gap_s=0.5, run_state=run_state)
    monitor.attach("twin", needed_by=())
    drivers = tuple(SimpleNamespace(state=SimpleNamespace(last_received_s=9e9)) for _ in range(2))
    contexts: Any = tuple(
        SimpleNamespace(poses=PoseHistory(2.0), driver=driver, name=name)
        for driver, name in zip(drivers, ("real", "twin"), strict=True)
    )
    real, twin = (context.poses for context in contexts)
    await asyncio.sleep(7.0)  # the run clock is not the goal's
    t0_s, due_s = run_state.enter("goal"), 0.0
    watching = asyncio.create_task(monitor.run(contexts, lambda: None))
    for tick in range(round(5.0 * RATE_HZ)):
        t_s = t0_s + tick / RATE_HZ
        if is_link_silent and silent_s[0] <= t_s - t0_s < silent_s[1]:
            drivers[1].state.last_received_s = t0_s + silent_s[0]
        else:
            drivers[1].state.last_received_s = t_s
        is_lone = tick == round(but_at_s * RATE_HZ)
        if is_lone or not silent_s[0] <= t_s - t0_s < silent_s[1]:
            twin.add(t_s, Pose((0.0, apart_m, 0.0), UPRIGHT))
        if t_s - late_s >= due_s:
            real.add(t_s - late_s, Pose((0.0, 0.0, 0.0), UPRIGHT))
            due_s = t_s - late_s + gap_s
        if tick == round(4.0 * RATE_HZ):
            run_state.enter("done")
            run_state.enter("land")
        await asyncio.sleep(1.0 / RATE_HZ)
    run_state.enter("landed")
    watching.cancel()
    return monitor, run_state


def flown(
    late_s: float,
    apart_m: float,
    gap_s: float = 0.02,
    silent_s: tuple[float, float] = (9.0, 9.0),
    but_at_s: float = 9.0,
    *,
    is_link_silent: bool = False,
) -> tuple[TwinMonitor, RunState]:
    found: list[tuple[TwinMonitor, RunState]] = []

    async def main() -> None:
        found.append(
            await _fly(late_s, apart_m, gap_s, silent_s, but_at_s, is_link_silent=is_link_silent)
        )

    run_on_clock("virtual", main())
    return found[0]


@pytest.mark.parametrize("late_s", [0.0, 0.15, 0.6])
def test_a_pair_apart_is_invalid_however_late_its_poses_are(late_s: float) -> None:
    monitor, run_state = flown(late_s, 1.5)
    assert monitor.result().distance_max_m == pytest.approx(1.5)
    (event,) = run_state.decisive
    assert (event.kind, event.source) == ("INVALID", "sync/twin")
    assert event.text.startswith("real and twin were 1.50 m apart")


@pytest.mark.parametrize("late_s", [0.0, 0.15, 0.6])
def test_a_pair_that_keeps_together_is_measured_and_passes(late_s: float) -> None:
    monitor, run_state = flown(late_s, 0.5)
    assert monitor.result().distance_p50_m == pytest.approx(0.5)
    assert run_state.decisive == []


def test_a_pair_apart_is_invalid_also_between_poses_that_are_far_apart() -> None:
    monitor, run_state = flown(0.0, 1.5, gap_s=0.3)
    assert monitor.result().distance_max_m == pytest.approx(1.5)
    (event,) = run_state.decisive
    assert event.text.startswith("real and twin were 1.50 m apart")


def test_a_distance_that_was_never_measured_proves_nothing() -> None:
    monitor, run_state = flown(0.003, 1.5, gap_s=0.7)
    assert monitor.result().distance_max_m is None
    (event,) = run_state.decisive
    assert (event.kind, event.source) == ("INVALID", "sync/twin")
    assert "was never measured" in event.text


@pytest.mark.parametrize(("is_link_silent", "at_s"), [(False, 1.55), (True, 5.0)])
def test_a_gap_of_a_silent_link_counts_after_what_judges_that_silence(
    is_link_silent: bool, at_s: float
) -> None:
    _, run_state = flown(0.0, 0.2, silent_s=(1.02, 2.5), is_link_silent=is_link_silent)
    (event,) = run_state.decisive
    assert "was not measured from 1.05 s to 2.45 s" in event.text
    assert event.t_s - run_state.entered_s["goal"] == pytest.approx(at_s, abs=0.02)


@pytest.mark.parametrize(
    ("silent_s", "said"),
    [
        ((0.51, 9.0), "was not measured from 0.55 s to 3.85 s after the goal"),
        ((0.0, 0.79), "was not measured from 0.05 s to 0.75 s"),
        ((2.01, 2.79), "was not measured from 2.05 s to 2.75 s"),
    ],
)
@pytest.mark.parametrize("late_s", [0.0, 0.6])
def test_a_distance_that_was_not_measured_for_too_long_proves_nothing(
    silent_s: tuple[float, float], said: str, late_s: float
) -> None:
    monitor, run_state = flown(late_s, 0.2, silent_s=silent_s)
    assert monitor.result().distance_max_m == pytest.approx(0.2)
    (event,) = run_state.decisive
    assert (event.kind, event.source) == ("INVALID", "sync/twin")
    assert said in event.text
    assert not run_state.over.is_set()


@pytest.mark.parametrize("silent_s", [(1.01, 1.49), (3.7, 9.0)])
def test_a_permitted_gap_of_poses_is_no_gap_of_the_distance(silent_s: tuple[float, float]) -> None:
    monitor, run_state = flown(0.0, 0.2, silent_s=silent_s)
    assert monitor.result().distance_max_m == pytest.approx(0.2)
    assert run_state.decisive == []


def test_permitted_gaps_one_after_another_are_no_gap_of_the_distance() -> None:
    monitor, run_state = flown(0.0, 0.2, silent_s=(1.01, 1.9), but_at_s=1.46)
    assert monitor.result().distance_max_m == pytest.approx(0.2)
    assert run_state.decisive == []


@pytest.mark.parametrize(
    ("needed_by", "vehicle", "stage", "decided"),
    [
        (("lidar",), "twin", "goal", ["INVALID"]),
        ((), "twin", "goal", []),
        (("lidar",), "intruder", "goal", []),
        (("lidar",), "twin", "done", []),
    ],
)
def test_a_twin_that_lands_alone_takes_the_mixture_that_needs_it_along(
    needed_by: tuple[str, ...], vehicle: str, stage: Stage, decided: list[str]
) -> None:
    """Its sensors may go on where it stands: no reading is missing, and no distance is measured."""
    run_state = RunState(time=lambda: 7.0)
    monitor = TwinMonitor(coupling="free", limit_m=1.0, max_gap_s=0.5, run_state=run_state)
    monitor.attach("twin", needed_by=needed_by)
    run_state.enter("goal")
    run_state.enter(stage)
    run_state.drop_out(vehicle, "left its fence")
    assert [one.kind for one in run_state.decisive] == decided
    if decided:
        assert "the mixture of lidar" in run_state.decisive[0].text
        assert not run_state.over.is_set()
