"""Watches the mixing budgets while the goal is flown: beyond one the run is INVALID."""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop
from wil_campaign.orchestrator.state.mixtures import MixedFrame
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.recipes.pipeline.budgets import RateWatch, budget_breach
from wil_campaign.recipes.visibility.coverage import uncovered_objects

STALLED_S = 1.0
"""Shortest time without a mixture after which the run is INVALID."""
_STALLED_PERIODS = 3.0
_DUE_PERIODS = 2.0
"""In so much time of a goal at least one mixture is delivered, however it begins in a period."""
_SETTLE_S = 0.6
"""How long a breach waits before it counts, so that a lost vehicle shows as silent first."""


@dataclass(slots=True)
class _WatchedMixing:
    loop: MixingLoop
    rate: RateWatch
    period_s: float

    @property
    def stalled_s(self) -> float:
        """Return the longest time without a mixture while the goal is flown."""
        return max(STALLED_S, _STALLED_PERIODS * self.period_s)


class MixingBudgetWatch:
    """Watches mixing budgets: a mixture that exceeds one makes the run INVALID.

    is_any_silent: whether no message has arrived from some vehicle for a while. That silence is
    judged by `link` and by the guard first: a breach counts only once messages arrive from all
    vehicles, and from then on.
    """

    def __init__(self, *, run_state: RunState, is_any_silent: Callable[[float], bool]) -> None:
        self._run_state = run_state
        self._is_any_silent = is_any_silent
        self._watched: dict[str, _WatchedMixing] = {}
        self._doubt: tuple[float, str] | None = None
        self._has_waited = False
        """Whether a vehicle was silent since the doubt."""
        self._is_over = self._has_decided = False
        run_state.on_stage(self._stage)

    def watch(self, loop: MixingLoop, period_s: float) -> None:
        """Watch a mixing loop's budget too. period_s: of its mixtures."""
        rate = RateWatch(loop.mixer.combination.budget)
        self._watched[loop.name] = _WatchedMixing(loop, rate, period_s)

    @property
    def loops(self) -> Sequence[MixingLoop]:
        """Return the mixing loops whose budgets are watched."""
        return [watched_mixing.loop for watched_mixing in self._watched.values()]

    def frame(self, frame: MixedFrame) -> None:
        """Check a mixture against its budget."""
        watched = self._watched[frame.name]
        provenance = frame.mixed.provenance
        if frame.mixed.reading is not None:
            watched.rate.delivered(frame.mixed.reading.arrived_s)
        if self._run_state.stage != "goal":
            return
        if provenance.dropped is not None:
            self.note_breach(frame.name, provenance.detail or provenance.dropped)
            return
        budget = watched.loop.mixer.combination.budget
        breach = budget_breach(budget, provenance)
        if breach is not None:
            self.note_breach(frame.name, str(breach))
        limit_px = budget.max_registration_error_px
        if limit_px is not None and frame.unbounded:
            self.note_breach(
                frame.name, f"max_registration_error_px: {limit_px:g}, and {frame.unbounded}"
            )
        self._check_frame_visibility(watched.loop, frame)

    def _check_frame_visibility(self, loop: MixingLoop, frame: MixedFrame) -> None:
        """Check a mixture's visibility of the virtual objects."""
        if loop.probe is None or frame.visibility is None:
            return
        fault = loop.probe.coverage.observe(frame.visibility)
        if fault is not None:
            self.note_breach(loop.name, fault.text + loop.probe.why_nothing())

    def note_breach(self, name: str, reason: str) -> None:
        """Note the breach of a mixing budget while the goal is flown; the first one counts."""
        self.note_doubt(f"mixing of {name}: {reason}")

    def note_doubt(self, reason: str) -> None:
        """Note a sensor without valid readings while the goal is flown; the first counts."""
        if self._run_state.stage == "goal" and self._doubt is None:
            self._doubt = (asyncio.get_running_loop().time(), reason)

    async def run(self, alive: Callable[[], None]) -> None:
        """Watch for missing mixtures, and decide by breaches; until cancelled.

        alive: called four times a second.
        """
        loop, is_decided = asyncio.get_running_loop(), False
        while True:
            alive()
            await asyncio.sleep(STALLED_S / 4)
            if self._run_state.stage == "goal":
                for watched in self._watched.values():
                    for reason in self._missing(watched, loop.time()):
                        self.note_breach(watched.loop.name, reason)
            if self._doubt is None or is_decided:
                continue
            t_s, reason = self._doubt
            if self._is_any_silent(loop.time()):
                self._has_waited = True
            elif loop.time() - t_s > _SETTLE_S:
                at_s = None if self._has_waited else t_s
                self._run_state.decide("INVALID", reason, t_s=at_s, source="mixing")
                is_decided = True

    def _missing(self, watched: _WatchedMixing, now_s: float) -> Iterator[str]:
        """Yield why too few mixtures have come by now."""
        last_s = watched.loop.statistics.last_delivery_s or 0.0
        since_s = max(last_s, self._run_state.entered_s["goal"])
        if now_s - since_s > watched.stalled_s:
            reason = f"no mixed reading for more than {watched.stalled_s:g} s"
            if why := watched.loop.statistics.last_miss:
                reason += f": {why}"
            yield reason
        breach = watched.rate.breach(now_s)
        if breach is not None:
            yield str(breach)

    def _stage(self, stage: Stage, t_s: float) -> None:
        if stage == "goal":
            for watched in self._watched.values():
                watched.rate.start(t_s)
        elif self._run_state.reached("goal") and not self._is_over:
            self._is_over = True
            self._check_delivery(t_s)
            self._check_visibility()
            # What has a reason already needs none of the last second.
            if stage == "done" and not self._has_decided and not self._is_any_silent(t_s):
                self._check_since_last_look(t_s)

    def _check_since_last_look(self, done_s: float) -> None:
        """Check that mixtures came until the end of the goal: `run` looks four times a second."""
        for watched in self._watched.values():
            for reason in self._missing(watched, done_s):
                self._decide_invalid(f"mixing of {watched.loop.name}: {reason}")
                return

    def _check_delivery(self, done_s: float) -> None:
        """Check that mixtures were delivered, also in a flight too short to call it stalled.

        A slow sensor may have none; that all have none counts after STALLED_S, however slow.
        """
        goal_s, missing = self._run_state.entered_s["goal"], 0
        for watched in self._watched.values():
            due_s = min(STALLED_S, _DUE_PERIODS * watched.period_s)
            if done_s - goal_s <= due_s:
                continue
            statistics = watched.loop.statistics
            if (statistics.last_delivery_s or 0.0) >= goal_s:
                continue
            missing += 1
            is_slow = done_s - goal_s <= _DUE_PERIODS * watched.period_s
            if is_slow and missing < len(self._watched):
                continue
            reason = "no mixed reading while the goal was flown"
            if statistics.last_miss:
                reason += f": {statistics.last_miss}"
            self._decide_invalid(f"mixing of {watched.loop.name}: {reason}")
            return

    def _check_visibility(self) -> None:
        """Check after the goal's flight what all its mixtures showed."""
        probes = {
            name: watched.loop.probe
            for name, watched in self._watched.items()
            if watched.loop.probe is not None
        }
        for name, probe in probes.items():
            fault = probe.coverage.never_shown()
            if fault is not None:
                self._decide_invalid(f"mixing of {name}: {fault.text}{probe.why_nothing()}")
                return
        # Mixtures that only the twin's autonomy perceives prove nothing about the judged vehicle.
        judged = [
            probe
            for name, probe in probes.items()
            if "real" in self._watched[name].loop.mixer.publish
        ]
        fault = uncovered_objects(probe.coverage for probe in judged)
        if fault is not None:
            why = judged[0].why_nothing() if len(judged) == 1 else ""
            self._decide_invalid(f"mixing: {fault.text}{why}")

    def _decide_invalid(self, reason: str) -> None:
        if self._doubt is None:
            self._has_decided = True
            self._run_state.decide("INVALID", reason, source="mixing", ends_flight=False)
