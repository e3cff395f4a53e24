"""How the scaled clock keeps processes in lockstep that all run on it; pure.

Processes of one machine get the processor when its scheduler likes. Where they lead the clock by
what the wall says, one that gets it late flies, judges or commands by a time that has left those of
the others. Here time waits for whoever is late: each process reports how far it has come, and the
clock stands `LEAD_S` after the one that has come least far. A busy machine attains less pace, and
the flight is the same by its own clock.

The clock is a straight line at the nominal pace that ends somewhere. While all are in time its end
is moved on before anyone gets there, so that all run on one line, whenever they hear of it. Where
all stand at its end, the next line begins there. So nobody is ever ahead of the clock.
"""

from vehicles.clocks.sim_clock_controller import STEP_S, Segment

LEAD_S = 0.06
"""By how much of its own time the clock may be ahead of the process that has come least far: a
setpoint, an image or a position is older by so much at most for want of a processor. PX4 needs a
setpoint every second, and a picture is mixed within a tenth of one."""
REPORT_S = 0.02
"""How often, by the run clock, a process reports how far it has come, at least."""

_LEAST_S = REPORT_S / 2.0


class Lockstep:
    """Decides how far the run clock may go; until `begin` the clock is the wall's.

    nominal: how many times real time the clock runs while all are in time.
    """

    def __init__(self, *, nominal: float) -> None:
        self._nominal = nominal
        self._segment = Segment(0.0, 0.0, 1.0)
        self._followers: dict[str, _Follower] = {}
        self._steps = self._extended_step = 0
        self._extended_s = 0.0

    @property
    def segment(self) -> Segment:
        """Return the present segment of the lockstep clock."""
        return self._segment

    def join(self, name: str) -> None:
        """Have the clock wait for a process, as soon as that has reported."""
        self._followers[name] = _Follower()

    def leave(self, name: str) -> None:
        """Wait for a process no more: it has ended."""
        self._followers.pop(name, None)

    def begin(self, segment: Segment) -> None:
        """Start the lockstep clock where the wall's was: all are at that moment."""
        run_s, wall_s = segment.run_s, segment.wall_s
        for follower in self._followers.values():
            follower.hear(run_s)
        self._extended_s, self._extended_step = wall_s, self._steps
        self._segment = Segment(wall_s, run_s, self._nominal, LEAD_S / self._nominal)

    def report(self, name: str, run_s: float) -> None:
        """Take that a process has done all that was due until a moment of the run clock."""
        if name in self._followers:
            self._followers[name].hear(run_s)

    def step(self) -> None:
        """Count a step of whoever leads: every `STEP_S` of the wall's time, if it gets so far."""
        self._steps += 1

    def is_silent(self, name: str, wall_s: float, patience_s: float) -> bool:
        """Return whether the clock has waited for this process for so long.

        Half of the time has to be of our own steps: a machine that was asleep has stalled nobody.
        """
        one = self._followers.get(name)
        awaited = self._awaited_s()
        if one is None or not one.awaited or one.run_s > min(awaited):
            return False
        steps = self._steps - self._extended_step
        return wall_s - self._extended_s > patience_s and steps * STEP_S >= patience_s / 2.0

    def give_up(self, name: str) -> None:
        """Wait for a process no more until it reports again."""
        self._followers[name].awaited = False

    def extend(self, wall_s: float) -> bool:
        """Move the end of the clock on as far as all allow; return whether it was."""
        last = self._segment
        end_s = last.end_s
        stands = wall_s - last.wall_s >= last.holds_s
        run_s = min(self._awaited_s(), default=last.at(wall_s)) + LEAD_S
        if run_s < end_s + (1e-6 if stands else _LEAST_S):
            return False
        if stands:
            last = Segment(wall_s, end_s, self._nominal)
        holds_s = (run_s - last.run_s) / self._nominal
        self._segment = Segment(last.wall_s, last.run_s, self._nominal, holds_s)
        self._extended_s, self._extended_step = wall_s, self._steps
        return True

    def _awaited_s(self) -> list[float]:
        """Return how far each process has come that the clock waits for."""
        return [one.run_s for one in self._followers.values() if one.awaited]


class _Follower:
    """A process that follows the clock: how far it has come, and whether the clock waits for it."""

    def __init__(self) -> None:
        self.awaited = False
        self.run_s = 0.0

    def hear(self, run_s: float) -> None:
        """Take a report of the process."""
        self.run_s = max(self.run_s, run_s)
        self.awaited = True
