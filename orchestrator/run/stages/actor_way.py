"""The path of an actor: its object's motion as pose and velocity over time; pure."""

import math
from itertools import pairwise

from wil_campaign.worlds.frames import Pose, Vec3, scale, subtract
from wil_campaign.worlds.scene.motion import Leg, Motion

_STEP_S = 0.05
_MOST_STEPS = 200
"""Into how many steps a long delay is divided at most, to find where on its path an actor is."""


class ActorWay:
    """The path of an actor along a motion that begins with a vertical climb.

    climb_m: height of that climb.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        begin, first = motion.begin.position_ned_m, motion.waypoints[0].position_ned_m
        self.climb_m = begin[2] - first[2]
        corners = [begin, *(one.position_ned_m for one in motion.waypoints)]
        self._stretches = tuple(pairwise(corners))

    def pose_at(self, since_s: float) -> Pose:
        """Return the pose of the motion at a time since its start."""
        leg = self._leg_at(since_s)
        return leg.begin.interpolate(leg.end, leg.share(since_s))

    def velocity_at(self, since_s: float) -> Vec3:
        """Return the velocity of the motion (NED) at a time since its start."""
        here, there = self.pose_at(since_s), self.pose_at(since_s + _STEP_S)
        return scale(subtract(there.position_ned_m, here.position_ned_m), 1.0 / _STEP_S)

    def speed_at(self, since_s: float) -> float:
        """Return the speed of the current leg at a time since the motion's start."""
        return self._leg_at(since_s).speed_m_s

    @property
    def duration_s(self) -> float:
        """Return how long the motion takes."""
        return self._motion.duration_s

    def _leg_at(self, since_s: float) -> Leg:
        ends_later = (one for one in self._motion.legs if since_s < one.begin_s + one.duration_s)
        return next(ends_later, self._motion.legs[-1])

    def distance_m(self, place_ned_m: Vec3) -> float:
        """Return the distance of a position from the nearest point of the path."""
        return min(_distance_m(place_ned_m, begin, end) for begin, end in self._stretches)


class ActorProgress:
    """How far an actor has come along its path: the furthest place of it that it has reached.

    It counts as at that place of the path, between the furthest reached and the one where the
    motion is now, that is nearest to it: it never goes back, nor ahead of the motion, however
    often the path leads through one place.
    """

    def __init__(self, way: ActorWay) -> None:
        self._way = way
        self._reached_s = 0.0

    def behind_s(self, place_ned_m: Vec3, since_s: float) -> float:
        """Return how long before a time since its start the motion was where the actor is then."""
        now_s = min(since_s, self._way.duration_s)
        span_s = now_s - self._reached_s
        if span_s <= 0.0:
            return 0.0
        count = math.ceil(min(span_s / _STEP_S, _MOST_STEPS))
        times_s = [now_s - span_s * step / count for step in range(count + 1)]

        def off_m(t_s: float) -> float:
            return math.dist(self._way.pose_at(t_s).position_ned_m, place_ned_m)

        # The latest of equally near ones comes first: where the motion only turns, it waits.
        self._reached_s = max(self._reached_s, min(times_s, key=off_m))
        return now_s - self._reached_s


def _distance_m(place: Vec3, begin: Vec3, end: Vec3) -> float:
    """Return the distance of a position from a straight segment."""
    along = subtract(end, begin)
    length2 = sum(one * one for one in along)
    off = subtract(place, begin)
    share = 0.0 if length2 == 0.0 else sum(a * b for a, b in zip(off, along, strict=True)) / length2
    nearest = scale(along, min(max(share, 0.0), 1.0))
    return math.dist(off, nearest)
