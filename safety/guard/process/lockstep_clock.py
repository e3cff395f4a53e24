"""Leads the scaled clock where all vehicles follow it: guard, orchestrator, vehicles in lockstep.

Time waits for the process that is late, as `clocks/lockstep.py` has it. One that hangs is
found by the wall clock: a vehicle that does not get on for `STALL_S` ends the run. An
orchestrator that does not is waited for no more, and the guard's watch for its silence sees to the
rest; once the guard has taken over, time waits for an orchestrator no longer than `HURRY_S`.
"""

import time
from collections.abc import Callable

from wil_campaign.foundation.clocks.lockstep import Lockstep
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.progress import ClockProgressReporter
from wil_campaign.foundation.clocks.sim_clock_controller import STALL_S, ClockSegment
from wil_campaign.safety.guard.core.commands import Trouble
from wil_campaign.safety.guard.process.run_clock import PaceSetup, RunClock

ORCHESTRATOR = "orchestrator"
HURRY_S = 0.5
_GUARD = "guard"


class LockstepClock(RunClock):
    """A run clock that waits for the orchestrator and all vehicles.

    took_over: whether the guard has latched.
    """

    def __init__(
        self,
        *,
        setup: PaceSetup,
        loop: PacedLoop,
        publish: Callable[[ClockSegment], None],
        trouble: Callable[[Trouble], None],
        took_over: Callable[[], bool],
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(setup=setup, loop=loop, publish=publish, trouble=trouble, wall=wall)
        self._paced = loop
        self._took_over = took_over
        self._lockstep = Lockstep(nominal=setup.nominal)
        for name in (_GUARD, ORCHESTRATOR, *setup.followers):
            self._lockstep.join(name)

    def reached(self, name: str, run_s: float) -> None:
        """Take how far a process has come; the clock advances if all have come so far."""
        self._lockstep.report(name, run_s)
        if self._begun is not None and self._lockstep.extend(self._wall()):
            self._send(self._lockstep.segment)

    def leave(self, name: str) -> None:
        """Wait no more for a process that has ended."""
        self._lockstep.leave(name)

    def _begin(self, segment: ClockSegment) -> None:
        self._lockstep.begin(segment)
        # The guard itself reads what vehicles have sent before time advances.
        ClockProgressReporter(loop=self._paced, report=lambda run_s: self.reached(_GUARD, run_s))

    def _advance(self, wall_s: float) -> ClockSegment:
        lockstep = self._lockstep
        lockstep.step()
        for name in self._setup.followers:
            if lockstep.is_silent(name, wall_s, STALL_S):
                lockstep.leave(name)
                lockstep.extend(wall_s)  # else those that waited for it would be next
                self._report_stall(name)
        patience_s = HURRY_S if self._took_over() else STALL_S
        if lockstep.is_silent(ORCHESTRATOR, wall_s, patience_s):
            lockstep.give_up(ORCHESTRATOR)
        lockstep.extend(wall_s)
        return lockstep.segment
