"""Tracks of scene objects that vehicles fly: poses as they are reported in flight.

All other motion follows from the times of events (`motion.py`). Both together are the history of a
run, from which a scene computes the pose of every object.
"""

import bisect
from collections.abc import Mapping, Sequence
from itertools import pairwise

from wil_campaign.worlds.frames import Pose, Vec3, add, angle_between, norm, scale, subtract
from wil_campaign.worlds.scene.motion import AT_REST, MotionTravel

AHEAD_S = 0.1
"""For how long a pose is extrapolated at its velocity: five periods of reports."""
_STILL_M = 1e-6
_STILL_RAD = 1e-6


class ObjectTrack:
    """The poses of one flown object over time; straight and even between two of them.

    It has no pose before the first. After the last it is extrapolated for AHEAD_S, then it rests.
    """

    def __init__(self) -> None:
        self._times_s: list[float] = []
        self._poses: list[Pose] = []
        self._velocity_ned_m_s: Vec3 = (0.0, 0.0, 0.0)

    @property
    def last_s(self) -> float | None:
        """Return the time of the track's last pose; None before the first."""
        return self._times_s[-1] if self._times_s else None

    def add(self, t_s: float, pose: Pose, velocity_ned_m_s: Vec3) -> bool:
        """Add a pose to the track; return whether it was later than the last and so added."""
        if self._times_s and t_s <= self._times_s[-1]:
            return False
        self._times_s.append(t_s)
        self._poses.append(pose)
        self._velocity_ned_m_s = velocity_ned_m_s
        return True

    def pose_at(self, t_s: float) -> Pose | None:
        """Return the track's pose at a time; None before the first."""
        index = bisect.bisect_right(self._times_s, t_s)
        if index == 0:
            return None
        if index == len(self._times_s):
            ahead_s = min(t_s - self._times_s[-1], AHEAD_S)
            last = self._poses[-1]
            moved = add(last.position_ned_m, scale(self._velocity_ned_m_s, ahead_s))
            return Pose(moved, last.q_wxyz)
        before_s, after_s = self._times_s[index - 1], self._times_s[index]
        share = (t_s - before_s) / (after_s - before_s)
        return self._poses[index - 1].interpolate(self._poses[index], share)

    def travel(self, from_s: float, to_s: float) -> MotionTravel:
        """Return how far the track goes and turns between two times, along all its poses."""
        if to_s <= from_s:
            return AT_REST
        length_m = turn_rad = 0.0
        poses = [self.pose_at(t_s) for t_s in (from_s, *self._corners_s(from_s, to_s), to_s)]
        known = [pose for pose in poses if pose is not None]
        for before, after in pairwise(known):
            length_m += norm(subtract(after.position_ned_m, before.position_ned_m))
            turn_rad += angle_between(before.q_wxyz, after.q_wxyz)
        return MotionTravel(length_m, turn_rad)

    def is_even(self, from_s: float, to_s: float) -> bool:
        """Return whether the track rests between two times, or goes straight and unturned."""
        travel = self.travel(from_s, to_s)
        if travel.turn_rad > _STILL_RAD:
            return False
        return travel.length_m < _STILL_M or not self._corners_s(from_s, to_s)

    def _corners_s(self, from_s: float, to_s: float) -> Sequence[float]:
        """Return the times strictly between two at which the track may change its velocity."""
        first = bisect.bisect_right(self._times_s, from_s)
        last = bisect.bisect_left(self._times_s, to_s)
        corners = self._times_s[first:last]
        end_s = self._times_s[-1] + AHEAD_S if self._times_s else to_s
        return [*corners, end_s] if from_s < end_s < to_s else corners


class RunHistory(dict[str, float]):
    """The times of a run's events, and the tracks of the objects that vehicles fly.

    tracks: by the object's name. A plain mapping of events is a history in which nothing is flown.
    """

    def __init__(self, tracks: Mapping[str, ObjectTrack] | None = None) -> None:
        super().__init__()
        self.tracks: dict[str, ObjectTrack] = dict(tracks or {})

    def add_pose(self, name: str, t_s: float, pose: Pose, velocity_ned_m_s: Vec3) -> None:
        """Add a pose to the track of an object, which begins with it."""
        self.tracks.setdefault(name, ObjectTrack()).add(t_s, pose, velocity_ned_m_s)


def object_track_of(name: str, events: Mapping[str, float]) -> ObjectTrack | None:
    """Return the track of an object in a run's history; None if no vehicle flies it."""
    return events.tracks.get(name) if isinstance(events, RunHistory) else None
