"""Watchdog of a run: a blocked task ends it as ERROR, for the flight was not observed."""

import asyncio
from collections.abc import Callable, Mapping

from wil_campaign.campaigns.setup.case_setup import SyncSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage

_LOOK_S, _LAST_LOOK_S = 0.5, 0.1
_LOOKS_WITHOUT_A_SIGN = 20
"""Counted in turns of the event loop, not in time: a suspended machine blocks no task."""
_BLOCKED = "{} was blocked: the vehicles were not observed meanwhile"
_SPARE_S = 60.0
"""How long a stage may take beyond the campaign's time-out: preflight, uploads, retries."""

Sign = Callable[[], None]
"""Tells the watchdog that a task is alive; costs next to nothing."""


def stage_patience_s(sync: SyncSetup) -> Mapping[Stage, float]:
    """Return how long the watchdog lets each stage last."""
    own: dict[Stage, float] = {
        "identify": sync.identify_timeout_s,
        "ready": sync.ready_timeout_s,
        "takeoff": sync.takeoff_timeout_s,
        "goal": sync.goal_timeout_s,
        "land": sync.landing_timeout_s,
    }
    others: tuple[Stage, ...] = ("start", "arm", "at_height", "done")
    return {stage: s + _SPARE_S for stage, s in {**dict.fromkeys(others, 0.0), **own}.items()}


class Watchdog:
    """Ends a run as ERROR when one of its tasks is silent, or its flight hangs.

    Every stage has its own time-outs; the watchdog catches the task that should have applied them.
    patience_s: how long each stage may last, without the operator's holds. pace: of the run clock,
    in times real time: the tasks of the run are no faster for it.
    """

    def __init__(
        self, *, run_state: RunState, patience_s: Mapping[Stage, float], pace: float = 1.0
    ) -> None:
        self._look_s, self._last_look_s = _LOOK_S * pace, _LAST_LOOK_S * pace
        self._run_state = run_state
        self._patience_s = patience_s
        self._silent: dict[str, int] = {}
        self._awaited: set[str] = set()
        self._stage = run_state.stage
        self._looks = 0

    def watch(self, name: str) -> Sign:
        """Watch a task; return what it has to call at least twice in ten seconds."""

        def sign() -> None:
            self._silent[name] = 0
            self._awaited.discard(name)

        return sign

    async def run(self) -> None:
        """Watch until a task hangs, or until cancelled."""
        while not self._run_state.over.is_set():
            await asyncio.sleep(self._look_s)
            if fault := self._find_silent_task() or self._find_hanging_stage():
                self._run_state.decide("ERROR", fault, source="watchdog")
        await self._run_state.reaching("end")

    async def last_signs(self) -> None:
        """Wait for one more sign of life of all watched tasks after the flight: a PASS needs it.

        To be called while nothing has decided the run.
        """
        self._awaited = set(self._silent)
        for _ in range(_LOOKS_WITHOUT_A_SIGN):
            if not self._awaited:
                return
            await asyncio.sleep(self._last_look_s)
        names = " and ".join(sorted(self._awaited))
        self._run_state.decide("ERROR", _BLOCKED.format(names), source="watchdog")

    def _find_silent_task(self) -> str:
        for name in self._silent:
            self._silent[name] += 1
            if self._silent[name] > _LOOKS_WITHOUT_A_SIGN:
                return _BLOCKED.format(name)
        return ""

    def _find_hanging_stage(self) -> str:
        if self._run_state.stage != self._stage or self._run_state.held:
            self._stage, self._looks = self._run_state.stage, 0
        self._looks += 1
        patience_s = self._patience_s.get(self._stage)
        if patience_s is None or self._looks * self._look_s <= patience_s:
            return ""
        return f"the flight hangs in stage {self._stage}, {patience_s:g} s after it was entered"
