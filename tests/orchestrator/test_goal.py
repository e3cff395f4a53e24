"""The goal is flown until the subject is done, and the other vehicle is waited for."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, cast

import pytest

from orchestrator.clock import run_on
from orchestrator.run.course import Course
from orchestrator.run.goal import GoalFlight


class FakePilot:
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


async def flown(real_s: float, twin_s: float, within_s: float = 60.0) -> tuple[Course, Any, float]:
    loop = asyncio.get_running_loop()
    course = Course(time=loop.time)
    pilots = {"real": FakePilot(real_s), "twin": FakePilot(twin_s)}
    goal = GoalFlight(
        pilots=cast("Any", pilots),
        subject="real",
        course=course,
        events={},
        started=lambda _name, _t_s: None,
        notify=lambda _name, _t_s: None,
        within_s=within_s,
    )
    t0_s = course.enter("goal")
    await goal.fly(t0_s)
    return course, pilots, loop.time() - t0_s


def on_virtual_time(flight: Coroutine[Any, Any, Any]) -> Any:
    return run_on("virtual", flight)


@pytest.mark.parametrize(
    ("real_s", "twin_s", "over_s"),
    [(3.0, 1.0, 3.0), (3.0, 4.0, 4.0), (3.0, 4.9, 4.9), (3.0, 9.0, 5.0)],
)
def test_the_twin_is_waited_for_a_while_when_the_subject_is_done(
    real_s: float, twin_s: float, over_s: float
) -> None:
    course, pilots, took_s = on_virtual_time(flown(real_s, twin_s))
    assert took_s == pytest.approx(over_s)
    assert course.reached("done")
    assert course.entered_s["done"] - course.entered_s["goal"] == pytest.approx(real_s)
    assert pilots["twin"].done.is_set() is (twin_s < real_s + 2.0)
    assert all(pilot.ended_s is not None for pilot in pilots.values())


def test_a_twin_that_is_done_first_does_not_end_the_goal() -> None:
    course, _, took_s = on_virtual_time(flown(70.0, 1.0))
    assert took_s == pytest.approx(60.0)
    assert not course.reached("done")
    assert [(event.kind, event.source) for event in course.decisive] == [("FAIL", "goal")]
