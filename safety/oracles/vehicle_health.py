"""Oracles of a vehicle's own reports: faults, silence of its link, landed at the end."""

import math

from pydantic import Field

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import LinkSample, PoseSample, StageSample, StateSample
from wil_campaign.safety.oracles.oracle import (
    NO_FLAGS,
    Flags,
    Oracle,
    OracleContext,
    OracleParameters,
    OracleTerms,
    Windowed,
    oracle,
)
from wil_campaign.worlds.figures import distinct_value_text


class LinkParameters(Windowed):
    """max_gap_s: the longest silence of the vehicle's link, in seconds."""

    max_gap_s: float = Field(gt=0, description="the longest silence that is allowed")


_REPORTED_WITHIN_S = 1.2
"""How long after the one a vehicle may report the other: that it disarmed, that it landed.

HEARTBEAT and EXTENDED_SYS_STATE are streams of their own, which come in no order: a PX4 whose
COM_DISARM_LAND is short is heard to be disarmed before it is heard to stand on the ground, and one
that disarms in the air to have landed, for its autopilot reports so of any disarmed vehicle.
"""
_STILL_S, _FALLEN_M = 0.3, 0.2
"""After this time a vehicle that disarmed in the air has fallen farther: 0.44 m."""
_DISARMED = "disarmed in flight"


class _End:
    """The end of a flight that may be a landing or a fall: from its first report, at down_m."""

    def __init__(self, at_s: float, down_m: float | None, *, has_landed: bool) -> None:
        self.at_s = at_s
        self.has_landed = has_landed
        self.falls = False
        self._down_m = down_m
        self._stands = False

    def observe(self, t_s: float, down_m: float) -> None:
        """Observe a position after the report."""
        if self._down_m is None or t_s < self.at_s:
            return
        self.falls = self.falls or down_m > self._down_m + _FALLEN_M
        self._stands = self._stands or t_s >= self.at_s + _STILL_S

    @property
    def is_landing(self) -> bool:
        """Return whether it is reported to stand, and does not fall."""
        return self.has_landed and self._stands and not self.falls


class VehicleFaultOracle(Oracle):
    """The oracle of the vehicle's own faults, and of disarming in flight.

    A vehicle disarmed in flight that falls from where it disarmed or reported the ground, does not
    report the ground in time, or is armed again too soon to have landed.
    """

    reports = frozenset({"heartbeat", "landed_state", "estimator"})

    def __init__(self, terms: OracleTerms) -> None:
        super().__init__(terms)
        self._seen = False
        self._was_flying = self._is_armed = False
        self._faults: list[tuple[str, float]] = []
        self._flew_s = -math.inf
        self._down_m: float | None = None
        self._end: _End | None = None

    def on_pose(self, sample: PoseSample) -> Flags:
        """Take a pose: a disarmed vehicle that falls has disarmed in flight."""
        self._down_m = sample.pose.position_ned_m[2]
        if self._end is None:
            return NO_FLAGS
        self._end.observe(sample.t_s, self._down_m)
        return self._judge_end(sample.t_s)

    def on_state(self, sample: StateSample) -> Flags:
        """Take a vehicle's state; each new fault is a flag."""
        was_flying, flies = self._was_flying, sample.armed and sample.landed is False
        was_armed, is_rearmed = self._is_armed, sample.armed and not self._is_armed
        self._was_flying, self._is_armed = flies, sample.armed
        if self._end is not None and sample.landed:
            self._end.has_landed = True
        flags = NO_FLAGS
        is_sudden = sample.t_s < self._flew_s + _STILL_S
        if self._end is not None and is_rearmed and (is_sudden or not self._end.has_landed):
            flags = self._fail(_DISARMED, self._end.at_s, flag_s=sample.t_s)
            self._end = None
        if not self.stages.open:
            return self._judge_end(sample.t_s)
        self._seen = True
        has_ended = (was_flying and not flies) or (was_armed and not sample.armed)
        if flies:
            self._flew_s, self._end = sample.t_s, None
        elif has_ended and self._end is None and sample.landed is not None:
            self._end = _End(sample.t_s, self._down_m, has_landed=sample.landed)
        if sample.fault is not None:
            return (*flags, *self._fail(sample.fault, sample.t_s, flag_s=sample.t_s))
        return (*flags, *self._judge_end(sample.t_s))

    def on_tick(self, t_s: float) -> Flags:
        """Fail a vehicle that has disarmed and did not report the ground in time."""
        return self._judge_end(t_s)

    def _judge_end(self, t_s: float) -> Flags:
        """Judge the end of a flight as far as its reports and positions have come."""
        end = self._end
        if end is None:
            return NO_FLAGS
        is_late = t_s > end.at_s + _REPORTED_WITHIN_S
        if not self._is_armed and (end.falls or (is_late and not end.has_landed)):
            self._end = None
            return self._fail(_DISARMED, end.at_s, flag_s=t_s)
        if end.is_landing or (is_late and not end.falls):
            self._end = None
        return NO_FLAGS

    def _fail(self, fault: str, at_s: float, *, flag_s: float) -> Flags:
        if any(text == fault for text, _ in self._faults):
            return NO_FLAGS
        self._faults.append((fault, at_s))
        return self.flag(flag_s, f"{self.vehicle}: {fault}")

    def result(self, t_s: float) -> OracleResult:
        """Return FAIL with the texts of the vehicle's faults, at the time of the first."""
        del t_s
        if not self._seen:
            return self.invalid("no state seen")
        faults = list(self._faults)
        if self._end is not None and not self._is_armed and not self._end.has_landed:
            faults.append((_DISARMED, self._end.at_s))
        if not faults:
            return self.verdict(passed=True)
        texts = "; ".join(text for text, _ in faults)
        return self.verdict(passed=False, at_s=faults[0][1], detail=texts)


class LinkOracle(Oracle):
    """The oracle of the vehicle's link: no gap above the limit, from takeoff to landing.

    A gap is flagged when it ends. One that does not end is the loss of the vehicle, which the guard
    reports as an ERROR.
    """

    def __init__(self, terms: OracleTerms, *, max_gap_s: float) -> None:
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
        silent = distinct_value_text(gap_s, self._max_gap_s, digits=1)
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

    def __init__(self, terms: OracleTerms) -> None:
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
def vehicle_fault(terms: OracleTerms, parameters: Windowed, context: OracleContext) -> Oracle:
    """Return the oracle of the vehicle's own faults."""
    del parameters, context
    return VehicleFaultOracle(terms)


@oracle("link", "is never silent for longer than max_gap_s", LinkParameters)
def link(terms: OracleTerms, parameters: LinkParameters, context: OracleContext) -> Oracle:
    """Return the oracle of the vehicle's link gaps."""
    del context
    return LinkOracle(terms, max_gap_s=parameters.max_gap_s)


@oracle("landed", "is landed and disarmed at the end", OracleParameters, at_the_end=True)
def landed(terms: OracleTerms, parameters: OracleParameters, context: OracleContext) -> Oracle:
    """Return the oracle that the vehicle ends landed and disarmed."""
    del parameters, context
    return LandedOracle(terms)
