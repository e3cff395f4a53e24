"""Keeps the processes of a scaled clock in lockstep; pure.

The processes of a machine get the processor when its scheduler decides. If each followed the wall
clock, one that is scheduled late would fly, judge or command at another time than the others. Here
time waits for the slowest: each process reports its progress, and the clock stops `LEAD_S` after
the least progress. A busy machine attains less pace, and the flight is the same by its own clock.

The clock is a line at the nominal pace with an end. While all processes keep up, its end is
extended before any of them reaches it, so that all run on one line, whenever they learn of it.
Where all have stopped at its end, the next line begins there. So no process is ever ahead of the
clock.
"""

from wil_campaign.foundation.clocks.sim_clock_controller import STEP_S, ClockSegment

LEAD_S = 0.06
"""By how much of its own time the clock may be ahead of the slowest process: a setpoint, an image
or a position is older by so much at most for want of a processor. PX4 needs a setpoint every
second, and an image is mixed within a tenth of a second."""
REPORT_S = 0.02
"""A process reports its progress at least this often, by the run clock."""

_LEAST_S = REPORT_S / 2.0


class Lockstep:
    """Decides how far the run clock may go; until `begin` it is the wall clock.

    nominal: how many times real time the clock runs while all processes keep up.
    """

    def __init__(self, *, nominal: float) -> None:
        self._nominal = nominal
        self._segment = ClockSegment(0.0, 0.0, 1.0)
        self._followers: dict[str, _Follower] = {}
        self._steps = self._extended_step = 0
        self._extended_s = 0.0

    @property
    def segment(self) -> ClockSegment:
        """Return the present segment of the lockstep clock."""
        return self._segment

    def join(self, name: str) -> None:
        """Have the clock wait for a process, from its first report on."""
        self._followers[name] = _Follower()

    def leave(self, name: str) -> None:
        """Stop waiting for a process: it has ended."""
        self._followers.pop(name, None)

    def begin(self, segment: ClockSegment) -> None:
        """Start the lockstep clock at the wall clock's present time: all processes are there."""
        run_s, wall_s = segment.run_s, segment.wall_s
        for follower in self._followers.values():
            follower.receive_report(run_s)
        self._extended_s, self._extended_step = wall_s, self._steps
        self._segment = ClockSegment(wall_s, run_s, self._nominal, LEAD_S / self._nominal)

    def report(self, name: str, run_s: float) -> None:
        """Take the report that a process has done all that was due until a run-clock time."""
        if name in self._followers:
            self._followers[name].receive_report(run_s)

    def step(self) -> None:
        """Count a step of the leading process: one every `STEP_S` of wall time, when scheduled."""
        self._steps += 1

    def is_silent(self, name: str, wall_s: float, patience_s: float) -> bool:
        """Return whether the clock has waited for this process longer than patience_s.

        The leader must have run for half of that time: after a suspend of the machine no process
        counts as stalled.
        """
        one = self._followers.get(name)
        awaited = self._awaited_progress_s()
        if one is None or not one.awaited or one.run_s > min(awaited):
            return False
        steps = self._steps - self._extended_step
        return wall_s - self._extended_s > patience_s and steps * STEP_S >= patience_s / 2.0

    def give_up(self, name: str) -> None:
        """Stop waiting for a process until it reports again."""
        self._followers[name].awaited = False

    def extend(self, wall_s: float) -> bool:
        """Extend the end of the clock as far as all processes allow; return whether it changed."""
        last = self._segment
        end_s = last.end_s
        has_stopped = wall_s - last.wall_s >= last.holds_s
        run_s = min(self._awaited_progress_s(), default=last.at(wall_s)) + LEAD_S
        if run_s < end_s + (1e-6 if has_stopped else _LEAST_S):
            return False
        if has_stopped:
            last = ClockSegment(wall_s, end_s, self._nominal)
        holds_s = (run_s - last.run_s) / self._nominal
        self._segment = ClockSegment(last.wall_s, last.run_s, self._nominal, holds_s)
        self._extended_s, self._extended_step = wall_s, self._steps
        return True

    def _awaited_progress_s(self) -> list[float]:
        return [follower.run_s for follower in self._followers.values() if follower.awaited]


class _Follower:
    """A process that follows the clock: its progress, and whether the clock waits for it."""

    def __init__(self) -> None:
        self.awaited = False
        self.run_s = 0.0

    def receive_report(self, run_s: float) -> None:
        self.run_s = max(self.run_s, run_s)
        self.awaited = True
