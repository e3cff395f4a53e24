"""The history of a vehicle's true state over the last second, interpolated in time."""

from bisect import bisect_right
from dataclasses import replace

from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.sensors.truth import Truth, motor_speeds
from wil_campaign.worlds.frames import Pose, Vec3, add, scale

_HORIZON_S = 1.0
_MAX_GAP_S = 0.2
"""Samples farther apart are not interpolated between."""
_COMPACT_AFTER = 512


class TruthHistory:
    """The history of a vehicle's truth, interpolated in between (linear, slerp)."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._samples: list[TruthSample] = []

    def add(self, sample: TruthSample) -> None:
        """Add a sample to the truth history; one not newer than the last is left out."""
        if self._times and sample.t_s <= self._times[-1]:
            return
        self._times.append(sample.t_s)
        self._samples.append(sample)
        if len(self._times) > _COMPACT_AFTER:
            old = max(0, bisect_right(self._times, sample.t_s - _HORIZON_S) - 1)
            del self._times[:old], self._samples[:old]

    def at(self, t_s: float) -> Truth | None:
        """Return the truth at a moment; None before the history, and after a long silence.

        After the last sample, for as long as a gap may be, it is the last sample's, moved on by its
        velocity.
        """
        after = bisect_right(self._times, t_s)
        if after == 0:
            return None
        before = self._samples[after - 1]
        if after == len(self._times):
            ahead_s = t_s - before.t_s
            return _predict_truth(before, ahead_s) if ahead_s <= _MAX_GAP_S else None
        following = self._samples[after]
        gap_s = following.t_s - before.t_s
        if gap_s > _MAX_GAP_S:
            return None
        return _interpolate_truth(before, following, (t_s - before.t_s) / gap_s)


def truth_of(sample: TruthSample) -> Truth:
    """Return the truth that sensors sample from a truth sample."""
    return Truth(
        pose=sample.pose,
        velocity_ned_m_s=sample.velocity_ned_m_s,
        rates_frd_rad_s=sample.rates_frd_rad_s,
        specific_force_frd_m_s2=sample.specific_force_frd_m_s2,
        motor_speeds_rad_s=motor_speeds(sample.thrusts_n),
    )


def _predict_truth(sample: TruthSample, ahead_s: float) -> Truth:
    """Return the truth a moment after a sample: with its attitude, moved on by its velocity."""
    truth = truth_of(sample)
    moved_ned_m = scale(sample.velocity_ned_m_s, ahead_s)
    position_ned_m = add(truth.pose.position_ned_m, moved_ned_m)
    return replace(truth, pose=Pose(position_ned_m, truth.pose.q_wxyz))


def _interpolate_truth(before: TruthSample, after: TruthSample, share: float) -> Truth:
    if share == 0.0:
        return truth_of(before)
    a, b = truth_of(before), truth_of(after)
    speeds = zip(a.motor_speeds_rad_s, b.motor_speeds_rad_s, strict=True)
    return Truth(
        pose=a.pose.interpolate(b.pose, share),
        velocity_ned_m_s=_mean(a.velocity_ned_m_s, b.velocity_ned_m_s, share),
        rates_frd_rad_s=_mean(a.rates_frd_rad_s, b.rates_frd_rad_s, share),
        specific_force_frd_m_s2=_mean(a.specific_force_frd_m_s2, b.specific_force_frd_m_s2, share),
        motor_speeds_rad_s=tuple((1.0 - share) * one + share * other for one, other in speeds),
    )


def _mean(a: Vec3, b: Vec3, share: float) -> Vec3:
    """Return the weighted mean of two vectors of the truth history."""
    return add(scale(a, 1.0 - share), scale(b, share))
