"""How late this machine runs the loop of a flight on the wall clock, as the cause of a red run."""

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.model.verdict import DecisiveEvent

_TICK_S = 0.02
"""As often as setpoints and judged poses come."""
LATE_S = 0.05
"""Lateness that counts: two and a half periods of setpoints and judged poses."""
_UNCOMMANDED_S = 0.5
"""Lateness that explains a failsafe: setpoints were missing for as long. PX4's COM_OF_LOSS_T is 1 s
by default, and the guard reports a silent orchestrator after 0.4 s unless it was late as well."""
_BEFORE_S, _AFTER_S = 0.2, 1.0
"""How long before a lateness a gap that it explains may begin, and how long after it one counts."""
_KEPT = 1000
_AT_ONCE_S = 0.01
"""Clocks that were read within so long were read at one time."""
_TIMED = ("evidence", "mixing", "sync")
"""Where the decisive events come from that say that something was late, apart, or missing."""


@dataclass(slots=True, kw_only=True)
class MachineLateness:
    """Records when the run's loop was late, and decides a run as INVALID that is red for that.

    A suspended machine was late by no clock that stood with it: that decides the run where a
    vehicle flew on (`flies_on`). remedy: in words. holding: returns the vehicle whose autonomy has
    lately kept the loop from running, and how; None for none. What comes of that is its failure.
    """

    run_state: RunState
    remedy: str
    flies_on: bool = False
    holding: Callable[[], tuple[str, str] | None] = lambda: None
    _late: deque[tuple[float, float, tuple[str, str] | None]] = field(
        default_factory=lambda: deque(maxlen=_KEPT)
    )
    _explained: list[DecisiveEvent] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.run_state.on_decisive(self._explain)

    async def run(self) -> None:
        """Measure the lateness until cancelled."""
        loop, before_s = asyncio.get_running_loop(), _suspended_s()
        while True:
            due_s = loop.time() + _TICK_S
            await asyncio.sleep(_TICK_S)
            self.note(due_s, loop.time())
            now_s = _suspended_s()
            if now_s is not None:
                self.note_suspended(due_s, now_s - (now_s if before_s is None else before_s))
                before_s = now_s

    def note_suspended(self, at_s: float, for_s: float) -> None:
        """Note for how long the machine was suspended since a time, seconds."""
        state = self.run_state
        if not self.flies_on or for_s < LATE_S:
            return
        if state.reached("takeoff") and not state.reached("landed"):
            text = f"this machine was suspended for {for_s:.2f} s{self._when(at_s)}: what was flown"
            state.decide("INVALID", f"{text} meanwhile is not known", t_s=at_s, source="machine")

    def note(self, due_s: float, woken_s: float) -> None:
        """Note when the loop was due to run, and when it did.

        A loop that wakes late reads its sockets before its timers, so that what came of the
        lateness may be decided by now.
        """
        if woken_s - due_s >= LATE_S:
            held = self.holding() if woken_s - due_s >= _UNCOMMANDED_S else None
            self._late.append((due_s, woken_s, held))
            for event in tuple(self.run_state.decisive):
                self._explain(event)

    def _explain(self, event: DecisiveEvent) -> None:
        """Decide the run by the lateness that explains an event."""
        least_s = _explaining_s(event)
        overlapping = [
            (woken_s - due_s, due_s, held)
            for due_s, woken_s, held in self._late
            if woken_s - due_s >= least_s and due_s - _BEFORE_S <= event.t_s <= woken_s + _AFTER_S
        ]
        if not overlapping or event in self._explained:
            return
        self._explained.append(event)
        late_s, at_s, held = max(overlapping, key=lambda one: one[:2])
        # It is the cause of the event, and so comes before it.
        t_s = min(at_s, event.t_s)
        if held is not None:
            name, how = held
            text, source = f"the autonomy of {name} {how}", f"autonomy/{name}"
            self.run_state.decide("FAIL", text, t_s=t_s, source=source, ends_flight=False)
            return
        text = f"this machine was late by {late_s:.2f} s{self._when(at_s)}; {self.remedy}"
        self.run_state.decide("INVALID", text, t_s=t_s, source="machine/clock", ends_flight=False)

    def _when(self, t_s: float) -> str:
        goal_s = self.run_state.entered_s.get("goal")
        if goal_s is None or t_s < goal_s:
            return " before the goal"
        return f", {t_s - goal_s:.2f} s after the goal"


def _suspended_s() -> float | None:
    """Return for how long this machine was suspended since its start; None to ask again."""
    first_s = time.clock_gettime(time.CLOCK_MONOTONIC)
    since_boot_s = time.clock_gettime(time.CLOCK_BOOTTIME)
    last_s = time.clock_gettime(time.CLOCK_MONOTONIC)
    return since_boot_s - first_s if last_s - first_s < _AT_ONCE_S else None


def _explaining_s(event: DecisiveEvent) -> float:
    """Return how much lateness explains an event, in seconds; infinite where none does."""
    if event.kind == "INVALID" and event.source.partition("/")[0] in _TIMED:
        return LATE_S
    is_failsafe = event.kind == "FAIL" and event.source.startswith("guard.failsafe/")
    return _UNCOMMANDED_S if is_failsafe else math.inf


def lateness_remedy(*, virtual: bool) -> str:
    """Return what to do about a late machine. virtual: whether the campaign can be flown so."""
    return "fly it by --clock virtual, or on a free machine" if virtual else "fly on a free machine"
