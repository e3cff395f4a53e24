"""The base for signals of a pose: in the air they must not repeat to the last bit."""

from abc import abstractmethod

from wil_campaign.safety.evidence.coverage import SignalCoverage
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample, StageSample, StateSample
from wil_campaign.worlds.frames import norm

_GRID_M = 0.022
"""Two steps of the grid of a simulator's ground truth: a smaller movement may repeat."""
_LEVEL_M = 0.1
"""By how much the height of a simulated vehicle at rest may differ from where it stood."""
_STANDS_S = 3.0
"""The longest time after touchdown until an autopilot reports that the vehicle has landed."""


class FlownCoverage(SignalCoverage):
    """Coverage of a signal of poses; a value that repeats to the last bit in the air is a fault.

    Two measurements of a vehicle in the air never agree to the last bit: noise changes the lowest
    digits of an estimate and of motion capture. Values repeat where a source behind a relay has
    ended, a tracker repeats its last pose, or an estimator has stopped.
    """

    def __init__(self, terms: SignalTerms, *, what: str) -> None:
        super().__init__(terms)
        self._what = what
        self._landed: bool | None = None
        self._value: tuple[float, ...] | None = None
        self._still_since_s: float | None = None
        self._ground_down_m: float | None = None

    @property
    def in_the_air(self) -> bool:
        """Return whether the poses are of a flying vehicle, by its report and the stage."""
        return self.stages.open and (self._landed is False or not self.stages.near_ground)

    @abstractmethod
    def pose(self, sample: PoseSample) -> None:
        """Take a pose of the judged source."""

    @abstractmethod
    def reference(self, sample: ReferenceSample) -> None:
        """Take another source's pose of the vehicle."""

    def stage(self, sample: StageSample) -> None:
        """Take a stage for the coverage of poses."""
        was_up = self.in_the_air
        super().stage(sample)
        self._restart_if_lifted(was_up=was_up)

    def state(self, sample: StateSample) -> None:
        """Take whether the vehicle reports to be on the ground, for the coverage of poses."""
        was_up, self._landed = self.in_the_air, sample.landed
        self._restart_if_lifted(was_up=was_up)

    def unrounded(self, value: tuple[float, ...], sample: PoseSample) -> tuple[float, ...]:
        """Return a value that no flying vehicle repeats: with the attitude if it is rounded."""
        return (*value, *sample.pose.q_wxyz) if self.terms.on_grid else value

    def may_stand(self, sample: PoseSample) -> bool:
        """Return whether a pose may be of a vehicle that stands: before takeoff, after landing.

        An autopilot reports a takeoff before it leaves the ground, and its landing seconds after.
        """
        down_m, ground_m = sample.pose.position_ned_m[2], self._ground_down_m
        if self._landed:
            self._ground_down_m = down_m
            return True
        return (
            self.stages.near_ground and ground_m is not None and abs(down_m - ground_m) <= _LEVEL_M
        )

    def hold_against_last(self, value: tuple[float, ...], sample: PoseSample) -> None:
        """Find a fault if a value stays the same, to the last bit, for longer than allowed."""
        t_s = sample.t_s
        before, self._value = self._value, value
        if value != before or self._still_since_s is None or not self.in_the_air:
            self._still_since_s = t_s
            return
        since_s, limit_s = self._still_since_s, self._most_still_s(sample)
        if t_s - since_s > limit_s:
            message = f"it repeats one {self._what} for {t_s - since_s:.2f} s"
            self.find(since_s + limit_s, f"{message} while the vehicle is in the air")

    def _most_still_s(self, sample: PoseSample) -> float:
        """Return for how long a value may stay the same.

        A simulated vehicle on the ground does not move at all before its autopilot reports landed,
        nor before it takes off. Its velocity distinguishes that from a source that has stopped: at
        that velocity it may not move by more than the source resolves.
        """
        limit_s = self.terms.limit_s
        if not (self.terms.on_grid and self.stages.near_ground):
            return limit_s
        moves_m_s = norm(sample.velocity_ned_m_s)
        return max(limit_s, min(_STANDS_S, _GRID_M / moves_m_s if moves_m_s else _STANDS_S))

    def _restart_if_lifted(self, *, was_up: bool) -> None:
        if self.in_the_air and not was_up:
            self._still_since_s = None
