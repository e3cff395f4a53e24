"""The evidence of a run: all its signals, their faults, and the decisive events of these."""

from collections.abc import Callable, Iterable, Mapping

from wil_campaign.safety.evidence.coverage import CoverageFault, SignalCoverage
from wil_campaign.safety.evidence.flown_coverage import FlownCoverage
from wil_campaign.safety.evidence.motion import AttitudeCoverage, VelocityCoverage
from wil_campaign.safety.evidence.poses import (
    NOT_A_NUMBER,
    PoseCoverage,
    is_finite_reference,
    is_pose_finite,
)
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.oracle_results import EvidenceResult
from wil_campaign.safety.model.samples import (
    DoubtSample,
    DropOutSample,
    GroundSpeedSample,
    HeadingSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    ReportSample,
    StageSample,
    StateSample,
)
from wil_campaign.safety.model.verdict import DecisiveEvent

POSE, VELOCITY, ATTITUDE = "pose", "velocity", "attitude"
SOURCE = "evidence/"
"""The prefix of the source of every decisive event of evidence."""

_Key = tuple[str, str]
"""A signal and its vehicle."""
_FLOWN: Mapping[str, Callable[[SignalTerms], FlownCoverage]] = {
    POSE: PoseCoverage,
    VELOCITY: VelocityCoverage,
    ATTITUDE: AttitudeCoverage,
}


class Evidence:
    """Collects a run's evidence; `events` grows by each required signal that proves nothing.

    Pure and online as oracles are: the same samples give the same evidence when judged again.
    """

    def __init__(self, signals: Iterable[SignalTerms] = ()) -> None:
        self._signals: dict[_Key, SignalCoverage] = {}
        self._ended: set[_Key] = set()
        self._flown: dict[str, list[tuple[_Key, FlownCoverage]]] = {}
        for terms in signals:
            if (terms.signal, terms.vehicle) in self._signals:
                raise ValueError(f"{terms.signal} of {terms.vehicle} is declared twice")
            self._signals[terms.signal, terms.vehicle] = self._coverage(terms)
        self._doubts: dict[_Key, tuple[DoubtSample, CoverageFault]] = {}
        self._decided: set[_Key] = set()
        self.events: list[DecisiveEvent] = []

    def pose(self, sample: PoseSample) -> bool:
        """Add a pose to the evidence; return whether it is finite, so that it can be judged."""
        finite = is_pose_finite(sample)
        for key, known in self._flown.get(sample.vehicle, ()):
            if finite or key[0] == POSE:
                known.pose(sample)
                self._settle(key, known)
        if finite or (POSE, sample.vehicle) in self._signals:
            return finite
        self.doubt(DoubtSample(sample.t_s, sample.vehicle, POSE, "its source", NOT_A_NUMBER))
        return False

    def reference(self, sample: ReferenceSample) -> bool:
        """Add another source's pose of a vehicle to the evidence; return whether it is finite."""
        if not is_finite_reference(sample):
            return False
        for key, known in self._flown.get(sample.vehicle, ()):
            known.reference(sample)
            self._settle(key, known)
        return True

    def needs_ground_speed(self, vehicle: str) -> bool:
        """Return whether a vehicle's velocity is judged, and other speeds are evidence."""
        return (VELOCITY, vehicle) in self._signals

    def ground_speed(self, sample: GroundSpeedSample) -> None:
        """Add another source's horizontal speed of a vehicle to the evidence."""
        key = (VELOCITY, sample.vehicle)
        known = self._signals.get(key)
        if isinstance(known, VelocityCoverage) and key not in self._ended:
            known.ground_speed(sample)
            self._settle(key, known)

    def needs_heading(self, vehicle: str) -> bool:
        """Return whether a vehicle's pose is its own estimate, whose heading is evidence."""
        known = self._signals.get((POSE, vehicle))
        return known is not None and known.terms.by_estimate

    def heading(self, sample: HeadingSample) -> None:
        """Add a comparison of a vehicle's estimated heading to the evidence."""
        key = (POSE, sample.vehicle)
        known = self._signals.get(key)
        if isinstance(known, PoseCoverage) and key not in self._ended:
            known.heading(sample)
            self._settle(key, known)

    def report(self, sample: ReportSample) -> None:
        """Add to the evidence that a sample of another signal has arrived."""
        key = (sample.signal, sample.vehicle)
        if key in self._signals and key not in self._ended:
            self._signals[key].observe(sample.t_s)
            self._settle(key, self._signals[key])

    def state(self, sample: StateSample) -> None:
        """Add a vehicle's state to the evidence: whether it is in the air, what it has lost."""
        for key, known in self._flown.get(sample.vehicle, ()):
            known.state(sample)
            self._settle(key, known)

    def received(self, sample: LinkSample) -> None:
        """Add to the evidence that something arrived over a vehicle's link."""
        for _, signal in self._judged():
            if signal.terms.vehicle == sample.vehicle:
                signal.received(sample.t_s)

    def stage(self, sample: StageSample) -> None:
        """Add a stage to the evidence."""
        for key, signal in self._judged():
            if sample.vehicle in {None, signal.terms.vehicle}:
                signal.stage(sample)
                self._settle(key, signal)

    def tick(self, t_s: float) -> None:
        """Add the passing of time to the evidence."""
        for key, signal in self._judged():
            signal.tick(t_s)
            self._settle(key, signal)

    def drop_out(self, sample: DropOutSample) -> None:
        """End the evidence of a vehicle that left the flight, except for required signals."""
        vehicle = sample.vehicle
        for key, signal in self._judged():
            if signal.terms.vehicle == vehicle and not signal.terms.required:
                signal.stage(StageSample(sample.t_s, "end", vehicle))
                self._ended.add(key)
        if vehicle in self._flown:
            flown = self._flown[vehicle]
            self._flown[vehicle] = [one for one in flown if one[0] not in self._ended]

    def doubt(self, sample: DoubtSample) -> None:
        """Add a doubt to the evidence: a signal is not credible, and the run proves nothing."""
        key = (sample.signal, sample.vehicle)
        known = self._signals.get(key)
        if key in self._ended:
            return
        if known is not None:
            known.find(sample.t_s, sample.reason)
            self._settle(key, known)
        elif key not in self._doubts:
            name = f"{sample.signal} of {sample.vehicle} from {sample.source}"
            fault = CoverageFault(sample.t_s, f"{name}: {sample.reason}")
            self._doubts[key] = (sample, fault)
            self._decide(key, fault)

    def results(self) -> tuple[EvidenceResult, ...]:
        """Return the evidence of each signal whose window has opened, in their order."""
        seen = (signal.result() for signal in self._signals.values())
        doubted = (_result_of(*doubt) for doubt in self._doubts.values())
        return (*(result for result in seen if result is not None), *doubted)

    def _judged(self) -> list[tuple[_Key, SignalCoverage]]:
        return [signal for signal in self._signals.items() if signal[0] not in self._ended]

    def _coverage(self, terms: SignalTerms) -> SignalCoverage:
        kind = _FLOWN.get(terms.signal)
        if kind is None:
            return SignalCoverage(terms)
        coverage = kind(terms)
        key = (terms.signal, terms.vehicle)
        self._flown.setdefault(terms.vehicle, []).append((key, coverage))
        return coverage

    def _settle(self, key: _Key, signal: SignalCoverage) -> None:
        if signal.fault is not None and signal.terms.required and key not in self._decided:
            self._decide(key, signal.fault)

    def _decide(self, key: _Key, fault: CoverageFault) -> None:
        self._decided.add(key)
        source = SOURCE + "/".join(key)
        self.events.append(DecisiveEvent(fault.at_s, "INVALID", fault.reason, source))


def _result_of(sample: DoubtSample, fault: CoverageFault) -> EvidenceResult:
    """Return the evidence result of a signal in doubt."""
    return EvidenceResult(
        signal=sample.signal,
        vehicle=sample.vehicle,
        source=sample.source,
        required=True,
        first_s=None,
        last_s=None,
        count=0,
        largest_gap_s=0.0,
        gap_at_s=None,
        limit_s=0.0,
        verdict="INVALID",
        reason=fault.reason,
    )
