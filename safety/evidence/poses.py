"""Positions of one vehicle as evidence: they arrive, are finite and agree with others; pure."""

import math

from safety.evidence.agreement import Agreement, Disagreement, OwnVelocity, StandingStill
from safety.evidence.flown_coverage import FlownCoverage
from safety.evidence.terms import SignalTerms
from safety.model.samples import PoseSample, ReferenceSample, StageSample

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

    @property
    def compared_with(self) -> tuple[str, ...]:
        """Return the other sources with which this vehicle's positions were compared."""
        return tuple(name for name, one in self._agreements.items() if one.count)

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

    def pose(self, sample: PoseSample) -> None:
        """Take a pose of the judged source."""
        if not is_finite(sample):
            self.find(sample.t_s, f"{NOT_A_NUMBER} at {sample.t_s:.2f} s")
            return
        self.take(sample.t_s)
        for agreement in self._agreements.values():
            self._disagree(agreement.pose(sample))
        if self._own_velocity is not None:
            self._disagree(self._own_velocity.pose(sample))
        self.hold_against_last(self.unrounded(sample.pose.position_ned_m, sample), sample)
        if self._still is not None:
            self._still.pose(sample)

    def reference(self, sample: ReferenceSample) -> None:
        """Compare the poses with another source's position of the vehicle."""
        agreement = self._agreements.get(sample.source)
        if agreement is not None:
            self._disagree(agreement.reference(sample))
            if self._still is not None and self.in_the_air:
                self._disagree(self._still.reference(sample))

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
