"""The samples of one signal over its window: first, last, how many, and the largest gap; pure."""

import math
from dataclasses import dataclass

from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import StageSample
from wil_campaign.safety.oracles.oracle_terms import StageTracker
from wil_campaign.worlds.figures import distinct_value_text

_PATIENCE_S = 0.5
"""How late samples may be before their absence counts: a delayed sample has its own time, and
closes the gap when it arrives."""


@dataclass(frozen=True, slots=True)
class CoverageFault:
    """A fault in a signal's coverage: it proves nothing. at_s: since when; reason: the text."""

    at_s: float
    reason: str


class SignalCoverage:
    """The coverage of a signal over time; `fault` is the first reason why it is INVALID.

    A gap begins with the window or with a sample, and ends with the next sample or with the window.
    Samples may arrive late: their own times count.

    A gap counts from the moment at which it exceeds the limit. One in which the vehicle's whole
    link was silent counts from its end: that silence is judged by `link` and by the guard first.
    """

    def __init__(self, terms: SignalTerms) -> None:
        self.terms = terms
        self.stages = StageTracker(terms.window)
        self.fault: CoverageFault | None = None
        self.caveat = ""
        """What a PASS by this signal has to be read with."""
        self._newest_s = -math.inf
        self._first_s: float | None = None
        self._last_s: float | None = None
        self._count = 0
        self._gap: tuple[float, float | None] = (0.0, None)
        self._arrived = False
        self._quiet_since_s: float | None = None
        self._last_sample_s: float | None = None
        self._silence_s = 0.0
        self._of_link: str | None = None

    def received(self, t_s: float) -> None:
        """Record that something arrived over the vehicle's link, to explain coverage gaps."""
        if self._last_sample_s is not None:
            self._silence_s = max(self._silence_s, t_s - self._last_sample_s)
        self._last_sample_s = t_s

    def stage(self, sample: StageSample) -> None:
        """Take a stage: it opens or closes the window that the signal has to cover."""
        self.stages.reach(sample)
        end_s = self.stages.end_s
        if sample.stage == "end" and end_s is not None and self._newest_s < end_s:
            self._close_gap(end_s)
        if sample.stage == "end" and self._of_link is not None:
            self.find(sample.t_s, self._of_link)

    def observe(self, t_s: float) -> None:
        """Take a sample: the signal covers this moment."""
        if not t_s > self._newest_s:
            return
        self._arrived = True
        begin_s, end_s = self.stages.begin_s, self.stages.end_s
        if begin_s is None:
            self._newest_s = t_s
            return
        until_s = t_s if end_s is None else min(t_s, end_s)
        self._close_gap(until_s)
        self._silence_s = 0.0
        self._newest_s = t_s
        if begin_s <= t_s == until_s:
            self._count += 1
            self._first_s = t_s if self._first_s is None else self._first_s
            self._last_s = t_s

    def tick(self, t_s: float) -> None:
        """Take that time has passed: the end of a signal is detected without another sample."""
        if self._of_link is not None:
            self.find(t_s, self._of_link)
        if self._arrived or self._quiet_since_s is None:
            self._arrived, self._quiet_since_s = False, t_s
            return
        since_s = self._since_s
        if not self.stages.open or since_s is None:
            return
        silent_s = t_s - max(self._quiet_since_s, since_s)
        if silent_s <= self.terms.limit_s + _PATIENCE_S:
            return
        if self._is_link_silent(t_s - silent_s, t_s):
            return  # The vehicle may be lost, which the guard decides.
        self.find(since_s + self.terms.limit_s, f"no sample for {t_s - since_s:.2f} s")

    def find(self, at_s: float, what: str) -> None:
        """Record a fault that makes the signal INVALID; only the first one counts."""
        if self.fault is None:
            terms = self.terms
            name = f"{terms.signal} of {terms.vehicle} from {terms.source}"
            self.fault = CoverageFault(at_s, f"{name}: {what}{self.stages.since(at_s, lead='; ')}")

    def result(self) -> EvidenceResult | None:
        """Return the evidence of the signal's coverage; None when its window never opened."""
        if self.stages.begin_s is None and self.fault is None:
            return None
        terms = self.terms
        return EvidenceResult(
            signal=terms.signal,
            vehicle=terms.vehicle,
            source=terms.source,
            required=terms.required,
            first_s=self._first_s,
            last_s=self._last_s,
            count=self._count,
            largest_gap_s=self._gap[0],
            gap_at_s=self._gap[1],
            limit_s=terms.limit_s,
            verdict="PASS" if self.fault is None else "INVALID",
            reason="" if self.fault is None else self.fault.reason,
            compared_with=self.compared_with,
            caveat=self.caveat,
        )

    @property
    def compared_with(self) -> tuple[str, ...]:
        """Return the other sources with which the covered signal was compared."""
        return ()

    @property
    def _since_s(self) -> float | None:
        """Return when the coverage gap that lasts until now began; None before the window."""
        begin_s = self.stages.begin_s
        return None if begin_s is None else max(begin_s, self._newest_s)

    def _close_gap(self, until_s: float) -> None:
        since_s = self._since_s
        if since_s is None or until_s <= since_s:
            return
        gap_s, limit_s = until_s - since_s, self.terms.limit_s
        if gap_s > self._gap[0]:
            self._gap = (gap_s, since_s)
        if gap_s > limit_s:
            gap = f"no sample for {distinct_value_text(gap_s, limit_s)} s against {limit_s:g} s"
            if self._is_link_silent(since_s, until_s):
                self._of_link = self._of_link or gap
            else:
                self.find(since_s + limit_s, gap)

    def _is_link_silent(self, since_s: float, until_s: float) -> bool:
        if not self.terms.over_link:
            return False
        if self._last_sample_s is None:
            return True
        # The arrival that ends a silence may be taken just before or just after its sample.
        silence_s = max(self._silence_s, until_s - self._last_sample_s)
        return silence_s >= (until_s - since_s) / 2.0
