"""Resamples poses to even times, for the maps and their cursor; pure."""

import bisect
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

from wil_campaign.orchestrator.report.model import Point, VehicleTrack
from wil_campaign.orchestrator.report.reading.distances import TimedPose

_STEP_S = 0.1
_MOST = 400
"""Poses of a track; a longer flight has a larger step."""


@dataclass(frozen=True, slots=True)
class EvenTimes:
    """Times from begin_s, every step_s; count: their number."""

    begin_s: float
    step_s: float
    count: int

    @classmethod
    def over(cls, span_s: Point) -> "EvenTimes":
        """Return the times of a span: ten per second, fewer for a long span."""
        length_s = max(0.0, span_s[1] - span_s[0])
        step_s = max(_STEP_S, length_s / _MOST)
        return cls(span_s[0], step_s, int(length_s / step_s) + 1)

    def times(self) -> list[float]:
        """Return the times."""
        return [self.begin_s + index * self.step_s for index in range(self.count)]


def poses_from(poses: Sequence[TimedPose], begin_s: float) -> Sequence[TimedPose]:
    """Return the poses from a time on."""
    return poses[bisect.bisect_left(poses, begin_s, key=itemgetter(0)) :]


def even_poses(poses: Sequence[TimedPose], times: EvenTimes) -> list[TimedPose]:
    """Return the newest pose at each time; the first one before it, none after the last."""
    if not poses:
        return []
    stamps = [t_s for t_s, _ in poses]
    shown = [t_s for t_s in times.times() if t_s <= stamps[-1] + times.step_s]
    newest = (max(0, bisect.bisect_right(stamps, t_s) - 1) for t_s in shown)
    return [(t_s, poses[index][1]) for t_s, index in zip(shown, newest, strict=True)]


def even_track_of(
    vehicle: str, source: str, poses: Sequence[TimedPose], times: EvenTimes
) -> VehicleTrack:
    """Return the track of even poses."""
    places = tuple(pose.position_ned_m for _, pose in poses)
    return VehicleTrack(vehicle, source, times.begin_s, times.step_s, places)
