"""Positions of one vehicle as evidence: they arrive, are finite and agree with others; pure."""

import math
from collections import deque
from collections.abc import Mapping

from wil_campaign.safety.evidence.agreement import (
    SIGMAS,
    Disagreement,
    PositionAgreement,
    SourceAccuracy,
    StandingStill,
    VelocityAgreement,
)
from wil_campaign.safety.evidence.flown_coverage import FlownCoverage
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.evidence.turns import StepAgreement, TurnAgreement
from wil_campaign.safety.model.samples import (
    HeadingSample,
    PoseSample,
    ReferenceSample,
    StageSample,
    StateSample,
)
from wil_campaign.worlds.frames import heading_of, wrap_pi

NOT_A_NUMBER = "it is not a number"


class PoseCoverage(FlownCoverage):
    """Coverage of positions: they are finite, change in the air, and agree with other sources."""

    def __init__(self, terms: SignalTerms) -> None:
        super().__init__(terms, what="position")
        self._agreements = {
            source: PositionAgreement(judged=terms.accuracy, other=accuracy, source=source)
            for source, accuracy in terms.references.items()
            if terms.accuracy is not None
        }
        states_velocity = terms.accuracy is not None and terms.accuracy.velocity_m_s is not None
        self._own_velocity = VelocityAgreement() if states_velocity else None
        self._still = StandingStill() if terms.on_grid else None
        self._heading = self._turns = self._steps = None
        if terms.accuracy is not None and terms.by_estimate:
            self._heading = HeadingAgreement(terms.accuracy, terms.references)
        elif terms.accuracy is not None:
            self._turns = TurnAgreement(terms.accuracy, terms.references)
            self._steps = None if states_velocity else StepAgreement()

    @property
    def compared_with(self) -> tuple[str, ...]:
        """Return the other sources with which this vehicle's poses were compared."""
        headings = {} if self._heading is None else self._heading.sources
        places = {name: None for name, agreement in self._agreements.items() if agreement.count}
        return tuple(places | headings)

    def stage(self, sample: StageSample) -> None:
        """Take a stage for the coverage of poses."""
        was_open = self.stages.open
        super().stage(sample)
        if self.stages.open and not was_open:
            for agreement in self._agreements.values():
                agreement.restart()
            if self._own_velocity is not None:
                self._own_velocity.restart()
            for check in (self._still, self._turns, self._steps):
                if check is not None:
                    check.restart()

    def state(self, sample: StateSample) -> None:
        """Take whether the vehicle reports to be in the air, and what it has lost of its place."""
        super().state(sample)
        if not (self.terms.by_estimate and self.stages.open and sample.dead_reckoning):
            return
        lost = sample.dead_reckoning
        if not self.terms.permits_dead_reckoning:
            self.find(sample.t_s, f"{lost}: dead reckoning from then on")
            return
        known = self.caveat.split("; ") if self.caveat else []
        self.caveat = "; ".join(dict.fromkeys([*known, *lost.split("; ")]))

    def pose(self, sample: PoseSample) -> None:
        """Take a pose of the judged source."""
        if not is_pose_finite(sample):
            self.find(sample.t_s, NOT_A_NUMBER)
            return
        self.observe(sample.t_s)
        for agreement in self._agreements.values():
            self._disagree(agreement.pose(sample))
        if self._own_velocity is not None:
            self._disagree(self._own_velocity.pose(sample))
        self.hold_against_last(self.unrounded(sample.pose.position_ned_m, sample), sample)
        if self._still is not None:
            self._still.pose(sample, may_stand=self.may_stand(sample))
        for check in (self._heading, self._turns, self._steps):
            if check is not None:
                self._disagree(check.pose(sample))

    def reference(self, sample: ReferenceSample) -> None:
        """Compare the poses with another source's position of the vehicle."""
        for check in (self._heading, self._turns, self._steps):
            if check is not None:
                check.reference(sample)
        agreement = self._agreements.get(sample.source)
        if agreement is not None:
            self._disagree(agreement.reference(sample))
            if self._still is not None and self.in_the_air:
                self._disagree(self._still.reference(sample))

    def heading(self, sample: HeadingSample) -> None:
        """Compare the heading by which the poses are anchored with another source's."""
        if self._heading is not None:
            self._disagree(self._heading.heading(sample))

    def _disagree(self, found: Disagreement | None) -> None:
        if found is not None and self.stages.open:
            self.find(found.at_s, found.text)


def is_finite_reference(sample: ReferenceSample) -> bool:
    """Return whether all numbers of another source's pose are finite."""
    total = sum(sample.position_ned_m) + sum(sample.velocity_ned_m_s) + sum(sample.q_wxyz or ())
    return math.isfinite(total + sample.t_s)


def is_pose_finite(sample: PoseSample) -> bool:
    """Return whether all numbers of a pose are finite."""
    # One sum, because infinities and NaN survive it and a thousand poses come in a second.
    total = sum(sample.pose.position_ned_m) + sum(sample.pose.q_wxyz)
    return math.isfinite(total + sum(sample.velocity_ned_m_s) + sample.t_s)


_KEPT_S = 3.0
_STAMPS_S = 0.1
"""By how much the mapped times of two sources may differ."""


class HeadingAgreement:
    """Checks that an estimated heading agrees with other sources within SIGMAS of what all state.

    An estimate's frame is anchored by its heading on the ground. One that is wrong there, and
    corrected in flight, leaves the frame turned, and with it fence and judgement; one that becomes
    wrong in flight looks the same. Both headings, then and now, have the estimate's accuracy.

    accuracy: of the estimate. references: of other sources of its pose.
    """

    def __init__(self, accuracy: SourceAccuracy, references: Mapping[str, SourceAccuracy]) -> None:
        self._stated_rad = math.sqrt(2.0) * accuracy.attitude_rad
        self._references = references
        self._judged: deque[tuple[float, float]] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self.sources: dict[str, None] = {}
        """The sources with which the heading was compared."""

    def pose(self, sample: PoseSample) -> Disagreement | None:
        """Add a judged pose; return a disagreement with a reference of its time, or None."""
        self._judged.append((sample.t_s, sample.pose.yaw_rad))
        while self._judged[0][0] < sample.t_s - _KEPT_S:
            self._judged.popleft()
        found: Disagreement | None = None
        while self._waiting and self._waiting[0].t_s + _STAMPS_S <= sample.t_s:
            found = self._compare(self._waiting.popleft()) or found
        return found

    def reference(self, sample: ReferenceSample) -> None:
        """Add another source's pose of the vehicle."""
        if sample.q_wxyz is not None:
            self._waiting.append(sample)

    def heading(self, sample: HeadingSample) -> Disagreement | None:
        """Add a comparison with another source of headings; return a disagreement, or None."""
        self.sources[sample.source] = None
        return self._disagreement(sample.t_s, sample.turned_rad, sample.source, sample.accuracy_rad)

    def _compare(self, reference: ReferenceSample) -> Disagreement | None:
        other, t_s = self._references.get(reference.source), reference.t_s
        if other is None or reference.q_wxyz is None:
            return None
        heading_rad = heading_of(reference.q_wxyz)
        # Their stamps may go back: a source that steps in time is compared all the same.
        turned = [
            wrap_pi(one - heading_rad) for at_s, one in self._judged if abs(at_s - t_s) <= _STAMPS_S
        ]
        if not turned:
            return None
        nearest_rad = min(turned, key=abs)
        return self._disagreement(t_s, nearest_rad, reference.source, other.attitude_rad)

    def _disagreement(
        self, t_s: float, turned_rad: float, source: str, accuracy_rad: float
    ) -> Disagreement | None:
        limit_rad = SIGMAS * math.hypot(self._stated_rad, accuracy_rad)
        if abs(turned_rad) <= limit_rad:
            return None
        message = f"its heading is turned by {math.degrees(abs(turned_rad)):.1f} deg from where"
        message += f" {source} had it, and its frame was anchored by its heading"
        return Disagreement(t_s, f"{message}; the limit is {math.degrees(limit_rad):.1f} deg")
