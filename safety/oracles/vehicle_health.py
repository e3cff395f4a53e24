"""Oracles of a vehicle's own reports: faults, silence of its link, landed at the end."""

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import LinkSample, StageSample, StateSample
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    Parameters,
    Terms,
    Windowed,
    oracle,
)
from wil_campaign.worlds.figures import distinct_text


class LinkParameters(Windowed):
    """max_gap_s: the longest silence of the vehicle's link, in seconds."""

    max_gap_s: float = Field(gt=0, description="the longest silence that is allowed")


_ON_GROUND_WITHIN_S = 1.0
"""How long after it is heard to have disarmed near the ground a vehicle may report that it landed.

HEARTBEAT and EXTENDED_SYS_STATE are streams of their own, which come in no order: a PX4 whose
COM_DISARM_LAND is short is heard to be disarmed before it is heard to stand on the ground.
"""
_DISARMED = "disarmed in flight"


class VehicleFault(Oracle):
    """The oracle of the vehicle's own faults, and of disarming in flight."""

    reports = frozenset({"heartbeat", "landed_state", "estimator"})

    def __init__(self, terms: Terms) -> None:
        super().__init__(terms)
        self._seen = False
        self._was_flying = False
        self._faults: list[tuple[str, float]] = []
        self._disarmed_s: float | None = None
        """When it was heard to have disarmed near the ground, until it reports that it landed."""

    def on_state(self, sample: StateSample) -> Flags:
        """Take a vehicle's state; each new fault is a flag."""
        if sample.landed:
            self._disarmed_s = None
        if not self.stages.open:
            return NO_FLAGS
        self._seen = True
        fault = sample.fault
        if self._was_flying and not sample.armed and sample.landed is False:
            if self.stages.near_ground:
                self._disarmed_s = sample.t_s
            else:
                fault = fault or _DISARMED
        self._was_flying = sample.armed and sample.landed is False
        return self._fail(fault, sample.t_s) if fault is not None else NO_FLAGS

    def on_tick(self, t_s: float) -> Flags:
        """Fail a vehicle that has disarmed near the ground and did not land in time."""
        since_s = self._disarmed_s
        if since_s is None or t_s <= since_s + _ON_GROUND_WITHIN_S:
            return NO_FLAGS
        self._disarmed_s = None
        return self._fail(_DISARMED, since_s, flag_s=t_s)

    def _fail(self, fault: str, at_s: float, *, flag_s: float | None = None) -> Flags:
        if any(text == fault for text, _ in self._faults):
            return NO_FLAGS
        self._faults.append((fault, at_s))
        return self.flag(at_s if flag_s is None else flag_s, f"{self.vehicle}: {fault}")

    def result(self, t_s: float) -> OracleResult:
        """Return FAIL with the texts of the vehicle's faults, at the time of the first."""
        del t_s
        if not self._seen:
            return self.invalid("no state seen")
        faults = list(self._faults)
        if self._disarmed_s is not None:
            faults.append((_DISARMED, self._disarmed_s))
        if not faults:
            return self.verdict(passed=True)
        texts = "; ".join(text for text, _ in faults)
        return self.verdict(passed=False, at_s=faults[0][1], detail=texts)


class LinkOracle(Oracle):
    """The oracle of the vehicle's link: no gap above the limit, from takeoff to landing.

    A gap is flagged when it ends. One that does not end is the loss of the vehicle, which the guard
    reports as an ERROR.
    """

    def __init__(self, terms: Terms, *, max_gap_s: float) -> None:
        super().__init__(terms)
        self._max_gap_s = max_gap_s
        self._since_s: float | None = None
        self._has_samples = False
        self._worst: tuple[float, float] = (0.0, 0.0)

    def on_stage(self, sample: StageSample) -> Flags:
        """Take a stage: the link's window opens with the takeoff command, until landing."""
        self._worst = self._worst_at(sample.t_s)
        self.stages.reach(sample)
        if self.stages.open and self._since_s is None:
            self._since_s = sample.t_s
            self._worst = (0.0, sample.t_s)
        return NO_FLAGS

    def on_received(self, sample: LinkSample) -> Flags:
        """Take a sign of life of the vehicle; one that follows too long a gap is flagged."""
        if not self.stages.open or self._since_s is None:
            return NO_FLAGS
        since_s, self._since_s, self._has_samples = self._since_s, sample.t_s, True
        gap_s = sample.t_s - since_s
        if gap_s > self._worst[0]:
            self._worst = (gap_s, sample.t_s)
        if gap_s <= self._max_gap_s:
            return NO_FLAGS
        silent = distinct_text(gap_s, self._max_gap_s, digits=1)
        text = f"{self.vehicle} was silent for {silent} s, more than {self._max_gap_s:g} s"
        return self.flag(sample.t_s, text)

    def result(self, t_s: float) -> OracleResult:
        """Return the longest gap of the vehicle's link."""
        if not self._has_samples:
            return self.invalid("nothing was received from the vehicle in flight")
        gap_s, at_s = self._worst_at(t_s)
        margin_s = self._max_gap_s - gap_s
        return self.verdict(
            passed=margin_s >= 0.0,
            actual=gap_s,
            limit=self._max_gap_s,
            unit="s",
            margin=margin_s,
            at_s=at_s,
        )

    def _worst_at(self, t_s: float) -> tuple[float, float]:
        """Return the longest gap of the link up to now, the present one included."""
        if not self.stages.open or self._since_s is None:
            return self._worst
        now = (t_s - self._since_s, t_s)
        return now if now[0] > self._worst[0] else self._worst


class LandedOracle(Oracle):
    """The oracle that the vehicle ends on the ground and disarmed, by its last report."""

    reports = frozenset({"heartbeat", "landed_state"})

    def __init__(self, terms: Terms) -> None:
        super().__init__(terms)
        self._last: StateSample | None = None

    def on_state(self, sample: StateSample) -> Flags:
        """Take a vehicle's state: landed, armed."""
        self._last = sample
        return NO_FLAGS

    def result(self, t_s: float) -> OracleResult:
        """Return PASS only for a vehicle that last reported landed and disarmed."""
        del t_s
        last = self._last
        if last is None:
            return self.invalid("no state seen")
        faults = []
        if last.armed:
            faults.append("still armed")
        if last.landed is None:
            faults.append("never reported whether it is on the ground")
        elif not last.landed:
            faults.append("not on the ground")
        detail = " and ".join(faults)
        return self.verdict(passed=not faults, at_s=last.t_s, detail=detail)


@oracle("vehicle_fault", "reports no fault in flight", Windowed, fail_fast=True)
def vehicle_fault(terms: Terms, parameters: Windowed, context: OracleContext) -> Oracle:
    """Return the oracle of the vehicle's own faults."""
    del parameters, context
    return VehicleFault(terms)


@oracle("link", "is never silent for longer than max_gap_s", LinkParameters)
def link(terms: Terms, parameters: LinkParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the vehicle's link gaps."""
    del context
    return LinkOracle(terms, max_gap_s=parameters.max_gap_s)


@oracle("landed", "is landed and disarmed at the end", Parameters, at_the_end=True)
def landed(terms: Terms, parameters: Parameters, context: OracleContext) -> Oracle:
    """Return the oracle that the vehicle ends landed and disarmed."""
    del parameters, context
    return LandedOracle(terms)
