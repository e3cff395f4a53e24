"""What signals of a pose have in common: whether they are of a vehicle in the air, and repeat."""

from abc import abstractmethod

from safety.evidence.coverage import Coverage
from safety.evidence.terms import SignalTerms
from safety.model.samples import PoseSample, ReferenceSample, StageSample, StateSample
from worlds.frames import norm

_GRID_M = 0.022
"""Two steps of the grid that a simulator's ground truth comes on: what moves less may repeat."""
_STANDS_S = 3.0
"""So long after it has come down, at most, autopilots report that a vehicle has landed."""


class FlownCoverage(Coverage):
    """Coverage of a signal of poses; what repeats to the last bit in the air is no new sample.

    No vehicle in the air is measured twice alike to the last bit: noise alone moves the lowest
    digits of an estimate and of motion capture. A source that has ended behind a relay, a tracker
    that fills in its last pose, and an estimator that has stopped look like this.
    """

    def __init__(self, terms: SignalTerms, *, what: str) -> None:
        super().__init__(terms)
        self._what = what
        self._landed: bool | None = None
        self._value: tuple[float, ...] | None = None
        self._still_since_s: float | None = None

    @property
    def in_the_air(self) -> bool:
        """Return whether the poses are of a flying vehicle, by its report and the stage."""
        return self.stages.open and (self._landed is False or not self.stages.near_ground)

    @abstractmethod
    def pose(self, sample: PoseSample) -> None:
        """Note a pose of the judged source."""

    @abstractmethod
    def reference(self, sample: ReferenceSample) -> None:
        """Note another source's pose of the vehicle."""

    def stage(self, sample: StageSample) -> None:
        """Note a stage for the coverage of poses."""
        was_up = self.in_the_air
        super().stage(sample)
        self._restart_if_lifted(was_up=was_up)

    def state(self, sample: StateSample) -> None:
        """Note whether the vehicle reports to be on the ground, for the coverage of poses."""
        was_up, self._landed = self.in_the_air, sample.landed
        self._restart_if_lifted(was_up=was_up)

    def unrounded(self, value: tuple[float, ...], sample: PoseSample) -> tuple[float, ...]:
        """Return a value that no flying vehicle repeats: with its attitude where it is rounded."""
        return (*value, *sample.pose.q_wxyz) if self.terms.on_grid else value

    def hold_against_last(self, value: tuple[float, ...], sample: PoseSample) -> None:
        """Find a value that stays the same, to the last bit, for longer than a gap may last."""
        t_s = sample.t_s
        before, self._value = self._value, value
        if value != before or self._still_since_s is None or not self.in_the_air:
            self._still_since_s = t_s
            return
        since_s, limit_s = self._still_since_s, self._most_still_s(sample)
        if t_s - since_s > limit_s:
            message = f"it repeats one {self._what} from {since_s:.2f} s on"
            self.find(since_s + limit_s, f"{message} while the vehicle is in the air")

    def _most_still_s(self, sample: PoseSample) -> float:
        """Return for how long a value may stay the same.

        A simulated vehicle that has come down stands to the last bit before its autopilot says so,
        and before it leaves the ground too. What it says of its velocity tells standing from a
        source that has stopped: at that it may not move by more than the source resolves.
        """
        limit_s = self.terms.limit_s
        if not (self.terms.on_grid and self.stages.near_ground):
            return limit_s
        moves_m_s = norm(sample.velocity_ned_m_s)
        return max(limit_s, min(_STANDS_S, _GRID_M / moves_m_s if moves_m_s else _STANDS_S))

    def _restart_if_lifted(self, *, was_up: bool) -> None:
        if self.in_the_air and not was_up:
            self._still_since_s = None
