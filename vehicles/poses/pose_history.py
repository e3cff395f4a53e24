"""The history of a vehicle's pose: samples, interpolated in time; pure."""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Literal

from wil_campaign.worlds.frames import Pose, Vec3, add, scale

PoseKind = Literal["interpolated", "predicted", "latest", "none"]


@dataclass(frozen=True, slots=True)
class PoseAt:
    """A pose of the history at a moment: interpolated, predicted or the latest.

    kind: "interpolated" between two samples, or a sample itself; "predicted" from the last
    sample by its velocity; "latest" is the last sample, too old to predict from; "none" when the
    moment lies before all samples or within a gap too long to bridge (pose is None then).
    gap_s: between the two samples; otherwise from the nearest sample to the moment; infinite
    when there is no sample.
    """

    pose: Pose | None
    kind: PoseKind
    gap_s: float


_NOTHING = PoseAt(None, "none", math.inf)
_COMPACT_AFTER = 256


class PoseHistory:
    """The history of poses of the last `horizon_s`.

    max_gap_s: samples further apart are not interpolated between. max_prediction_s: how far
    beyond the last sample it is extrapolated by its velocity.
    """

    def __init__(
        self, horizon_s: float, *, max_gap_s: float = 0.2, max_prediction_s: float = 0.02
    ) -> None:
        self._horizon_s = horizon_s
        self._max_gap_s = max_gap_s
        self._max_prediction_s = max_prediction_s
        self._times: list[float] = []
        self._poses: list[Pose] = []
        self._velocity_ned_m_s: Vec3 | None = None
        self._first = 0
        self._last_s = -math.inf
        self.rejected = 0

    def __len__(self) -> int:
        """Return how many poses the history has within the horizon."""
        return len(self._times) - self._first

    def add(self, t_s: float, pose: Pose, velocity_ned_m_s: Vec3 | None = None) -> bool:
        """Add a pose to the history; return whether it was taken.

        A sample that is not newer than the last is rejected and counted in `rejected`.
        """
        times = self._times
        if not t_s > self._last_s or t_s == math.inf:
            self.rejected += 1
            return False
        self._last_s = t_s
        times.append(t_s)
        self._poses.append(pose)
        self._velocity_ned_m_s = velocity_ned_m_s
        self._forget(t_s - self._horizon_s)
        return True

    def at(self, t_s: float) -> PoseAt:
        """Return the history's pose at a moment, interpolated (linear, slerp) or predicted."""
        times = self._times
        after = bisect_right(times, t_s, self._first)
        if not times:
            return _NOTHING
        if after == len(times):
            return self._beyond(t_s - times[-1])
        if after == self._first:
            return PoseAt(None, "none", times[after] - t_s)
        before = after - 1
        gap_s = times[after] - times[before]
        since_s = t_s - times[before]
        if since_s == 0.0:
            return PoseAt(self._poses[before], "interpolated", 0.0)
        if gap_s > self._max_gap_s:
            return PoseAt(None, "none", gap_s)
        pose = self._poses[before].interpolate(self._poses[after], since_s / gap_s)
        return PoseAt(pose, "interpolated", gap_s)

    def latest(self) -> PoseAt:
        """Return the history's last pose as it is, to align by "latest"."""
        return PoseAt(self._poses[-1], "latest", 0.0) if self._poses else _NOTHING

    def rate_hz(self, over_s: float) -> float | None:
        """Return the recent rate of poses; None with fewer than two."""
        times = self._times
        first = max(self._first, bisect_left(times, self._last_s - over_s))
        spanned_s = times[-1] - times[first] if len(times) - first > 1 else 0.0
        return (len(times) - 1 - first) / spanned_s if spanned_s > 0.0 else None

    def sample_before(self, t_s: float) -> tuple[float, Pose] | None:
        """Return time and pose of the last one at or before a moment; None without."""
        index = bisect_right(self._times, t_s, self._first) - 1
        return (self._times[index], self._poses[index]) if index >= self._first else None

    def sample_after(self, t_s: float) -> tuple[float, Pose] | None:
        """Return time and pose of the first one after a moment; None without."""
        index = bisect_right(self._times, t_s, self._first)
        return (self._times[index], self._poses[index]) if index < len(self._times) else None

    def _beyond(self, ahead_s: float) -> PoseAt:
        last = self._poses[-1]
        if ahead_s == 0.0:
            return PoseAt(last, "interpolated", 0.0)
        if self._velocity_ned_m_s is None or ahead_s > self._max_prediction_s:
            return PoseAt(last, "latest", ahead_s)
        moved = add(last.position_ned_m, scale(self._velocity_ned_m_s, ahead_s))
        return PoseAt(Pose(moved, last.q_wxyz), "predicted", ahead_s)

    def _forget(self, before_s: float) -> None:
        times, first = self._times, self._first
        # The last sample before the horizon stays: it brackets the horizon's first moment.
        while first + 1 < len(times) and times[first + 1] <= before_s:
            first += 1
        if first >= _COMPACT_AFTER:
            del times[:first]
            del self._poses[:first]
            first = 0
        self._first = first
