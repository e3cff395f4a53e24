"""Positions of one vehicle as evidence: they arrive, are numbers and move with it; pure."""

import math

from safety.evidence.agreement import Agreement, Disagreement, OwnVelocity
from safety.evidence.coverage import Coverage
from safety.evidence.terms import SignalTerms
from safety.model.samples import PoseSample, ReferenceSample, StageSample, StateSample
from worlds.frames import Vec3

NOT_A_NUMBER = "it is not a number"


class PoseCoverage(Coverage):
    """Coverage of poses; one that repeats to the last bit in the air is no new sample.

    No vehicle in the air is measured twice at one place to the last bit: noise alone moves the
    lowest digits of an estimate and of motion capture. A source that has ended behind a relay, a
    tracker that fills in its last pose, and an estimator that has stopped look like this.
    """

    def __init__(self, terms: SignalTerms) -> None:
        super().__init__(terms)
        self._agreements = {
            source: Agreement(judged=terms.accuracy, other=accuracy, source=source)
            for source, accuracy in terms.references.items()
            if terms.accuracy is not None
        }
        states_velocity = terms.accuracy is not None and terms.accuracy.velocity_m_s is not None
        self._own_velocity = OwnVelocity() if states_velocity else None
        self._landed: bool | None = None
        self._place: Vec3 | None = None
        self._still_since_s: float | None = None

    @property
    def in_the_air(self) -> bool:
        """Return whether the poses are of a flying vehicle, by its report and the stage."""
        return self.stages.open and (self._landed is False or not self.stages.near_ground)

    @property
    def compared_with(self) -> tuple[str, ...]:
        """Return the other sources that gave this vehicle's position beside the poses."""
        return tuple(name for name, one in self._agreements.items() if one.count)

    def stage(self, sample: StageSample) -> None:
        """Note a stage for the coverage of poses."""
        was_up, was_open = self.in_the_air, self.stages.open
        super().stage(sample)
        if self.stages.open and not was_open:
            for agreement in self._agreements.values():
                agreement.restart()
            if self._own_velocity is not None:
                self._own_velocity.restart()
        if self.in_the_air and not was_up:
            self._still_since_s = None

    def state(self, sample: StateSample) -> None:
        """Note whether the vehicle reports to be on the ground, for the coverage of poses."""
        was_up, self._landed = self.in_the_air, sample.landed
        if self.in_the_air and not was_up:
            self._still_since_s = None

    def pose(self, sample: PoseSample) -> None:
        """Note a pose of the judged source."""
        place = sample.pose.position_ned_m
        if not is_finite(sample):
            self.find(sample.t_s, f"{NOT_A_NUMBER} at {sample.t_s:.2f} s")
            return
        self.take(sample.t_s)
        for agreement in self._agreements.values():
            self._disagree(agreement.pose(sample))
        if self._own_velocity is not None:
            self._disagree(self._own_velocity.pose(sample))
        before, self._place = self._place, place
        if place != before or self._still_since_s is None or not self.in_the_air:
            self._still_since_s = sample.t_s
            return
        since_s, limit_s = self._still_since_s, self.terms.limit_s
        if sample.t_s - since_s > limit_s:
            said = (
                f"it repeats one position from {since_s:.2f} s on while the vehicle is in the air"
            )
            self.find(since_s + limit_s, said)

    def reference(self, sample: ReferenceSample) -> None:
        """Compare the poses with another source's position of the vehicle."""
        agreement = self._agreements.get(sample.source)
        if agreement is not None:
            self._disagree(agreement.reference(sample))

    def _disagree(self, found: Disagreement | None) -> None:
        if found is not None and self.stages.open:
            self.find(found.at_s, found.text)


def is_finite(sample: PoseSample) -> bool:
    """Return whether all numbers of a pose are finite."""
    # One sum: infinities and NaN survive it, and a pose comes a thousand times a second.
    total = sum(sample.pose.position_ned_m) + sum(sample.pose.q_wxyz)
    return math.isfinite(total + sum(sample.velocity_ned_m_s) + sample.t_s)
