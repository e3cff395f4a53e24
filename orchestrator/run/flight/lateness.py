"""How late this machine runs the loop of a flight on the wall clock, as the cause of an INVALID."""

import asyncio
from collections import deque
from dataclasses import dataclass, field

from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.safety.model.verdict import DecisiveEvent

_TICK_S = 0.02
"""As often as setpoints and judged poses come."""
LATE_S = 0.05
"""Lateness that counts: two and a half periods of setpoints and judged poses."""
_BEFORE_S, _AFTER_S = 0.2, 1.0
"""How long before a lateness a gap that it explains may begin, and how long after it one counts."""
_KEPT = 1000
_TIMED = ("evidence", "mixing", "sync")
"""Where the decisive events come from that say that something was late, apart, or missing."""


@dataclass(slots=True, kw_only=True)
class MachineLateness:
    """Records when the run's loop was late, and decides a run by it that is INVALID for that.

    remedy: in words.
    """

    run_state: RunState
    remedy: str
    _late: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_KEPT))

    def __post_init__(self) -> None:
        self.run_state.on_decisive(self._explain)

    async def run(self) -> None:
        """Measure the lateness until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due_s = loop.time() + _TICK_S
            await asyncio.sleep(_TICK_S)
            self.note(due_s, loop.time())

    def note(self, due_s: float, woken_s: float) -> None:
        """Note when the loop was due to run, and when it did."""
        if woken_s - due_s >= LATE_S:
            self._late.append((due_s, woken_s))

    def _explain(self, event: DecisiveEvent) -> None:
        """Decide the run by the lateness that explains an INVALID."""
        if event.kind != "INVALID" or event.source.partition("/")[0] not in _TIMED:
            return
        overlapping = [
            (woken_s - due_s, due_s)
            for due_s, woken_s in self._late
            if due_s - _BEFORE_S <= event.t_s <= woken_s + _AFTER_S
        ]
        if not overlapping:
            return
        late_s, at_s = max(overlapping)
        text = f"this machine was late by {late_s:.2f} s{self._when(at_s)}; {self.remedy}"
        # It is the cause of the event, and so comes before it.
        t_s = min(at_s, event.t_s)
        self.run_state.decide("INVALID", text, t_s=t_s, source="machine/clock", ends_flight=False)

    def _when(self, t_s: float) -> str:
        goal_s = self.run_state.entered_s.get("goal")
        if goal_s is None or t_s < goal_s:
            return " before the goal"
        return f", {t_s - goal_s:.2f} s after the goal"


def lateness_remedy(*, virtual: bool) -> str:
    """Return what to do about a late machine. virtual: whether the campaign can be flown so."""
    return "fly it by --clock virtual, or on a free machine" if virtual else "fly on a free machine"
