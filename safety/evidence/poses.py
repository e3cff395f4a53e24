"""Positions of one vehicle as evidence: they arrive, are finite and agree with others; pure."""

import math

from wil_campaign.safety.evidence.agreement import (
    Agreement,
    Disagreement,
    OwnVelocity,
    StandingStill,
)
from wil_campaign.safety.evidence.flown_coverage import FlownCoverage
from wil_campaign.safety.evidence.heading import HeadingAgreement
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.samples import (
    HeadingSample,
    PoseSample,
    ReferenceSample,
    StageSample,
    StateSample,
)

NOT_A_NUMBER = "it is not a number"


class PoseCoverage(FlownCoverage):
    """Coverage of positions: they are finite, change in the air, and agree with other sources."""

    def __init__(self, terms: SignalTerms) -> None:
        super().__init__(terms, what="position")
        self._agreements = {
            source: Agreement(judged=terms.accuracy, other=accuracy, source=source)
            for source, accuracy in terms.references.items()
            if terms.accuracy is not None
        }
        states_velocity = terms.accuracy is not None and terms.accuracy.velocity_m_s is not None
        self._own_velocity = OwnVelocity() if states_velocity else None
        self._still = StandingStill() if terms.on_grid else None
        self._heading = (
            HeadingAgreement(terms.accuracy, terms.references)
            if terms.by_estimate and terms.accuracy is not None
            else None
        )

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
            if self._still is not None:
                self._still.restart()

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
        if not is_finite(sample):
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
        if self._heading is not None:
            self._disagree(self._heading.pose(sample))

    def reference(self, sample: ReferenceSample) -> None:
        """Compare the poses with another source's position of the vehicle."""
        if self._heading is not None:
            self._heading.reference(sample)
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


def is_finite(sample: PoseSample) -> bool:
    """Return whether all numbers of a pose are finite."""
    # One sum, because infinities and NaN survive it and a thousand poses come in a second.
    total = sum(sample.pose.position_ned_m) + sum(sample.pose.q_wxyz)
    return math.isfinite(total + sum(sample.velocity_ned_m_s) + sample.t_s)
