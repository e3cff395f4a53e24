"""The goal is flown until the subject is done, and the other vehicle is waited for."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, cast

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_on_clock
from wil_campaign.orchestrator.run.stages.goal_flight import GoalFlight
from wil_campaign.orchestrator.state.run_state import RunState


class FakeRunner:
    """An autonomy that is done after a time."""

    def __init__(self, done_after_s: float) -> None:
        self.done = asyncio.Event()
        self.ended_s: float | None = None
        self._done_after_s = done_after_s

    def on_first_setpoint(self, watcher: Callable[[str, float], None]) -> None:
        """Give none."""

    async def fly(self) -> None:
        """Fly on until cancelled, as an autonomy that holds its last position does."""
        loop = asyncio.get_running_loop()
        try:
            await asyncio.sleep(self._done_after_s)
            self.done.set()
            await asyncio.sleep(1000.0)
        finally:
            self.ended_s = loop.time()


async def flown(
    real_s: float, twin_s: float, within_s: float = 60.0
) -> tuple[RunState, Any, float]:
    loop = asyncio.get_running_loop()
    run_state = RunState(time=loop.time)
    runners = {"real": FakeRunner(real_s), "twin": FakeRunner(twin_s)}
    goal = GoalFlight(
        runners=cast("Any", runners),
        subject="real",
        run_state=run_state,
        events={},
        started=lambda _name, _t_s: None,
        notify=lambda _name, _t_s: None,
        within_s=within_s,
    )
    t0_s = run_state.enter("goal")
    await goal.fly(t0_s)
    return run_state, runners, loop.time() - t0_s


def on_virtual_time(flight: Coroutine[Any, Any, Any]) -> Any:
    return run_on_clock("virtual", flight)


@pytest.mark.parametrize(
    ("real_s", "twin_s", "over_s"),
    [(3.0, 1.0, 3.0), (3.0, 4.0, 4.0), (3.0, 4.9, 4.9), (3.0, 9.0, 5.0)],
)
def test_the_twin_is_waited_for_a_while_when_the_subject_is_done(
    real_s: float, twin_s: float, over_s: float
) -> None:
    run_state, runners, took_s = on_virtual_time(flown(real_s, twin_s))
    assert took_s == pytest.approx(over_s)
    assert run_state.reached("done")
    assert run_state.entered_s["done"] - run_state.entered_s["goal"] == pytest.approx(real_s)
    assert runners["twin"].done.is_set() is (twin_s < real_s + 2.0)
    assert all(runner.ended_s is not None for runner in runners.values())


def test_a_twin_that_is_done_first_does_not_end_the_goal() -> None:
    run_state, _, took_s = on_virtual_time(flown(70.0, 1.0))
    assert took_s == pytest.approx(60.0)
    assert not run_state.reached("done")
    assert [(event.kind, event.source) for event in run_state.decisive] == [("FAIL", "goal")]
