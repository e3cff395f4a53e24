"""The run clock that the guard leads in lockstep: who hangs is found by the wall's clock."""

import asyncio
from collections.abc import Callable

from wil_campaign.foundation.clocks.lockstep import LEAD_S
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.sim_clock_controller import STALL_S, STEP_S, ClockSegment
from wil_campaign.safety.guard.core.commands import Trouble, VehicleGone
from wil_campaign.safety.guard.process.lockstep_clock import HURRY_S, ORCHESTRATOR, LockstepClock
from wil_campaign.safety.guard.process.run_clock import PaceSetup


class Wall:
    """A wall clock that is moved by hand, in a paced loop."""

    def __init__(self, loop: PacedLoop) -> None:
        self.loop = loop
        self.began_s = self.now_s = loop.time()
        self.published: list[ClockSegment] = []
        self.troubles: list[Trouble] = []
        self.took_over = False
        self.step: Callable[[], object] = lambda: None
        self.clock = LockstepClock(
            setup=PaceSetup(nominal=4.0, followers=("real", "twin")),
            loop=self.loop,
            publish=self.published.append,
            trouble=self.troubles.append,
            took_over=lambda: self.took_over,
            wall=lambda: self.now_s,
        )
        loop.call_wall_later = self._later  # type: ignore[method-assign]

    @property
    def end_s(self) -> float:
        """By how much the clock may be ahead of where it began."""
        return self.published[-1].end_s - self.began_s

    def _later(self, delay_s: float, callback: Callable[[], object]) -> asyncio.Handle:
        self.step = callback
        return asyncio.Handle(callback, (), self.loop)

    def steps(self, for_s: float, **late_by_s: float) -> None:
        """Have time pass in which all report but those that are late by so much and more."""
        for _ in range(round(for_s / STEP_S)):
            self.now_s += STEP_S
            for name in ("guard", ORCHESTRATOR, "real", "twin"):
                if late_by_s.get(name, 0.0) == 0.0:
                    self.clock.reached(name, self.published[-1].end_s)
            self.step()


def led(test: Callable[[Wall], None]) -> None:
    async def run() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        wall = Wall(loop)
        wall.clock.begin()
        test(wall)
        wall.clock.close()

    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        runner.run(run())


def test_a_vehicle_that_hangs_is_reported_once_and_waited_for_no_more() -> None:
    def test(wall: Wall) -> None:
        wall.steps(1.0)
        gone_s = wall.end_s
        wall.steps(STALL_S - 0.2, twin=1.0)
        assert wall.end_s - gone_s <= LEAD_S + 1e-6
        assert wall.troubles == []
        wall.steps(1.0, twin=1.0)
        text = "the simulation of twin hangs: its time has not advanced for 5 s; the simulator "
        assert wall.troubles == [VehicleGone("twin", f"{text}hangs or was stopped")]
        gone_s = wall.end_s
        wall.steps(STALL_S + 1.0, twin=1.0)
        assert wall.end_s - gone_s > 100 * LEAD_S
        assert len(wall.troubles) == 1
        wall.steps(STALL_S + 1.0, twin=1.0, real=1.0)
        assert [trouble.vehicle for trouble in wall.troubles] == ["twin", "real"]

    led(test)


def test_a_vehicle_that_waited_for_one_that_hangs_is_in_no_trouble() -> None:
    def test(wall: Wall) -> None:
        wall.steps(1.0)
        wall.steps(STALL_S + 1.0, real=1.0)
        assert [trouble.vehicle for trouble in wall.troubles] == ["real"]

    led(test)


def test_a_hanging_orchestrator_is_no_trouble_of_a_vehicle_and_is_awaited_again() -> None:
    def test(wall: Wall) -> None:
        wall.steps(1.0)
        gone_s = wall.end_s
        wall.steps(STALL_S - 0.2, orchestrator=1.0)
        assert wall.end_s - gone_s <= LEAD_S + 1e-6
        wall.steps(1.0, orchestrator=1.0)
        assert wall.end_s - gone_s > 5 * LEAD_S
        wall.steps(1.0)
        gone_s = wall.end_s
        wall.steps(STALL_S - 0.2, orchestrator=1.0)
        assert wall.end_s - gone_s <= LEAD_S + 1e-6
        assert wall.troubles == []

    led(test)


def test_a_guard_that_has_taken_over_waits_half_a_second_for_the_orchestrator() -> None:
    def test(wall: Wall) -> None:
        wall.steps(1.0)
        wall.steps(HURRY_S - 0.1, orchestrator=1.0)
        gone_s = wall.end_s
        wall.took_over = True
        wall.steps(0.3, orchestrator=1.0)
        assert wall.end_s > gone_s
        assert wall.troubles == []

    led(test)


def test_an_orchestrator_that_has_ended_is_waited_for_no_more() -> None:
    def test(wall: Wall) -> None:
        wall.steps(1.0)
        wall.clock.leave(ORCHESTRATOR)
        gone_s = wall.end_s
        wall.steps(0.5, orchestrator=1.0)
        assert wall.end_s - gone_s > 5 * LEAD_S

    led(test)
