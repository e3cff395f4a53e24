"""Who stands still is noticed: tasks that give no sign, stages that do not end."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from wil_campaign.campaigns.setup.case_setup import SyncSetup
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.run.flight.watchdog import Watchdog, stage_patience_s
from wil_campaign.orchestrator.state.run_state import RunState, Stage

Act = Callable[[RunState, Watchdog], Awaitable[None]]


def watched(act: Act, *, patience_s: float = 1000.0) -> tuple[RunState, float]:
    """Return the course after an act, and how long that took."""

    async def main() -> tuple[RunState, float]:
        loop = asyncio.get_running_loop()
        run_state = RunState(time=loop.time)
        watchdog = Watchdog(
            run_state=run_state, patience_s={"start": patience_s, "goal": patience_s}
        )
        running = asyncio.create_task(watchdog.run(), name="watchdog")
        await act(run_state, watchdog)
        running.cancel()
        await asyncio.wait([running])
        return run_state, loop.time()

    return run_virtual(main())


async def signs(watchdog: Watchdog, name: str, count: int) -> None:
    sign = watchdog.watch(name)
    for _ in range(count):
        sign()
        await asyncio.sleep(0.5)


def test_a_task_that_gives_no_sign_any_more_ends_the_run() -> None:
    async def act(run_state: RunState, watchdog: Watchdog) -> None:
        watchdog.watch("never begun")
        await signs(watchdog, "judging", 40)
        assert not run_state.over.is_set()
        await run_state.over.wait()

    run_state, ended_s = watched(act)
    (decision,) = run_state.decisive
    assert (decision.kind, decision.source) == ("ERROR", "watchdog")
    assert decision.text.startswith("judging was blocked")
    assert ended_s == pytest.approx(30.0, abs=1.1)


@pytest.mark.parametrize("stage", ["start", "goal"])
def test_a_stage_that_does_not_end_ends_the_run(stage: Stage) -> None:
    async def act(run_state: RunState, watchdog: Watchdog) -> None:
        if stage != "start":
            await asyncio.sleep(40.0)
            run_state.enter(stage)
        await run_state.over.wait()

    run_state, ended_s = watched(act, patience_s=50.0)
    assert run_state.decisive[0].text.startswith(f"the flight hangs in stage {stage}, 50 s")
    assert ended_s == pytest.approx(50.0 if stage == "start" else 90.0, abs=1.1)


def test_a_hold_does_not_use_up_the_patience_of_the_watchdog() -> None:
    async def act(run_state: RunState, watchdog: Watchdog) -> None:
        run_state.hold()
        await asyncio.sleep(300.0)
        run_state.release()
        await asyncio.sleep(45.0)

    run_state, _ = watched(act, patience_s=50.0)
    assert run_state.decisive == []


@pytest.mark.parametrize("dead", [False, True])
def test_a_pass_needs_a_last_sign_of_all(dead: bool) -> None:
    async def act(run_state: RunState, watchdog: Watchdog) -> None:
        lives = asyncio.create_task(signs(watchdog, "judging", 100))
        dies = asyncio.create_task(signs(watchdog, "trajectory", 100))
        await asyncio.sleep(5.2)
        if dead:
            dies.cancel()
        await watchdog.last_signs()
        lives.cancel()
        dies.cancel()
        await asyncio.wait([lives, dies])

    run_state, ended_s = watched(act)
    names = [one.text.split(" was blocked")[0] for one in run_state.decisive]
    assert names == ["trajectory"] * dead
    assert ended_s == pytest.approx(7.2 if dead else 5.6, abs=0.2)


def test_every_stage_may_last_longer_than_its_own_time_out() -> None:
    sync = SyncSetup(
        identify_timeout_s=30.0,
        ready_timeout_s=90.0,
        takeoff_timeout_s=30.0,
        takeoff_tolerance_m=0.2,
        goal_timeout_s=600.0,
        landing_timeout_s=60.0,
        max_command_skew_s=1.0,
        max_takeoff_skew_s=1.0,
        max_t0_skew_s=1.0,
    )
    patience_s = stage_patience_s(sync)
    assert patience_s["goal"] > sync.goal_timeout_s
    assert patience_s["takeoff"] > sync.takeoff_timeout_s
    assert set(patience_s) == {
        *("start", "identify", "ready", "arm", "takeoff", "at_height"),
        *("goal", "done", "land"),
    }
