"""Motion of objects along waypoints at given speeds, from a time or an event on.

Pure: the pose depends on the time and on when events happened, on nothing else.

The speed profile of a leg: constant, or with constant acceleration at both ends; pure.

A leg's time runs from 0 to 1 and so does its way. `ramp` is the share of the time in which speed
rises, and again that in which it falls: 0 for a constant speed, 0.5 for a leg that is too short
to reach its speed.
"""

import bisect
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from wil_campaign.worlds.frames import (
    Pose,
    Vec3,
    angle_between,
    euler_from_quat,
    norm,
    quat_from_euler,
    subtract,
)


def ramped_leg(length_m: float, speed_m_s: float, acceleration_m_s2: float) -> tuple[float, float]:
    """Return the time (s) and the ramp of a leg from rest to rest, at most at a speed."""
    if length_m <= 0.0:
        return 0.0, 0.0
    if speed_m_s * speed_m_s >= acceleration_m_s2 * length_m:
        return 2.0 * math.sqrt(length_m / acceleration_m_s2), 0.5
    rise_s = speed_m_s / acceleration_m_s2
    duration_s = length_m / speed_m_s + rise_s
    return duration_s, rise_s / duration_s


def ramped_leg_share(time_share: float, ramp: float) -> float:
    """Return the share of a ramped leg's length that is completed at a share of its time."""
    if ramp <= 0.0:
        return time_share
    left = 1.0 - time_share
    if min(time_share, left) < ramp:
        end = min(time_share, left)
        part = end * end / (2.0 * ramp * (1.0 - ramp))
        return part if time_share < left else 1.0 - part
    return (time_share - ramp / 2.0) / (1.0 - ramp)


Moment = Literal["takeoff", "at_height", "goal", "done"]
MOMENTS: tuple[Moment, ...] = get_args(Moment)
"""Events of a run that a motion may wait for: the takeoff command, both vehicles at height,
t0 (the goal is given), the autonomy is done."""
TURN_RATE_RAD_S = math.pi
"""The fastest turn of an object: a leg that is too short for its turn takes longer."""


@dataclass(frozen=True, slots=True)
class StartAtTime:
    """Motion begins at a time on the scene's clock, in seconds."""

    at_s: float = 0.0

    def started_s(self, events: Mapping[str, float]) -> float | None:
        """Return when the motion began; None while it has not."""
        del events
        return self.at_s

    @property
    def waits_for(self) -> str | None:
        """Return the event that the motion waits for: none."""
        return None


@dataclass(frozen=True, slots=True)
class StartOnEvent:
    """Motion begins a delay after an event; not before the event has a time."""

    event: str
    delay_s: float = 0.0

    def started_s(self, events: Mapping[str, float]) -> float | None:
        """Return when the motion began after its event; None while it has not."""
        at_s = events.get(self.event)
        return None if at_s is None else at_s + self.delay_s

    @property
    def waits_for(self) -> str | None:
        """Return the event that the motion waits for."""
        return self.event


Start = StartAtTime | StartOnEvent


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A motion's waypoint: where, how fast, and the heading to turn to (radians; None keeps it).

    A leg that is too short for its turn at TURN_RATE_RAD_S is flown more slowly.
    """

    position_ned_m: Vec3
    speed_m_s: float
    yaw_rad: float | None = None


@dataclass(frozen=True, slots=True)
class MotionLeg:
    """A leg of a motion: a straight way between two poses; turns go evenly with the way.

    speed_m_s: the waypoint's. ramp: as of `speed_ramp`; 0 is a constant speed.
    """

    begin_s: float
    duration_s: float
    begin: Pose
    end: Pose
    length_m: float
    turn_rad: float
    speed_m_s: float = 0.0
    ramp: float = 0.0

    def share(self, since_s: float) -> float:
        """Return the share of the leg that is completed at a time of the motion."""
        time_share = (since_s - self.begin_s) / self.duration_s
        return ramped_leg_share(min(max(time_share, 0.0), 1.0), self.ramp)

    def is_even(self, first_s: float, last_s: float) -> bool:
        """Return whether the leg is straight, unturned and at one speed between two times."""
        rise_s = self.ramp * self.duration_s
        begin_s, end_s = self.begin_s + rise_s, self.begin_s + self.duration_s - rise_s
        return self.turn_rad == 0.0 and begin_s <= first_s and last_s <= end_s


@dataclass(frozen=True, slots=True)
class LegStride:
    """Where on its leg a moving object is: how far along, of which length, at which speed."""

    along_m: float
    length_m: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class MotionTravel:
    """How far a moving object went between two times: bounds for any of its points."""

    length_m: float
    turn_rad: float


AT_REST = MotionTravel(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ObjectMotion:
    """An object's motion through waypoints from its pose; `loop` repeats for ever.

    Times of events and `start` are on one clock, seconds. Where a loop closes, the last leg
    leads back to the beginning at the speed of the first waypoint. acceleration_m_s2: every leg
    begins and ends at rest; None: speeds change at once. speed_sd_m_s: what `drawn` varies by.
    """

    begin: Pose
    waypoints: tuple[Waypoint, ...]
    start: Start = StartAtTime()
    loop: bool = False
    acceleration_m_s2: float | None = None
    speed_sd_m_s: float = 0.0
    legs: tuple[MotionLeg, ...] = field(init=False, repr=False, compare=False)
    _begins_s: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        legs = _legs(self.begin, self.waypoints, self.acceleration_m_s2, loop=self.loop)
        object.__setattr__(self, "legs", legs)
        object.__setattr__(self, "_begins_s", tuple(leg.begin_s for leg in legs))

    @property
    def duration_s(self) -> float:
        """Return how long one round of the motion takes."""
        return self.legs[-1].begin_s + self.legs[-1].duration_s if self.legs else 0.0

    def drawn(self, rng: np.random.Generator) -> "ObjectMotion":
        """Return the motion with each waypoint's speed drawn anew.

        Normal about the waypoint's speed with a standard deviation of speed_sd_m_s, cut at three
        of them and at a tenth of the speed: nothing stands still or goes backwards.
        """
        if self.speed_sd_m_s == 0.0:
            return self
        drawn = (min(max(float(rng.standard_normal()), -3.0), 3.0) for _ in self.waypoints)
        waypoints = tuple(
            replace(
                waypoint,
                speed_m_s=max(waypoint.speed_m_s + x * self.speed_sd_m_s, waypoint.speed_m_s / 10),
            )
            for waypoint, x in zip(self.waypoints, drawn, strict=True)
        )
        return replace(self, waypoints=waypoints, speed_sd_m_s=0.0)

    def pose_at(self, t_s: float, events: Mapping[str, float]) -> Pose:
        """Return the moving object's pose at a time, given when each event happened."""
        since_s = self._since_start_s(t_s, events)
        if since_s <= 0.0 or not self.legs:
            return self.begin
        if since_s >= self.duration_s and not self.loop:
            return self.legs[-1].end
        since_s %= self.duration_s
        leg = self._leg_at(since_s)
        return leg.begin.interpolate(leg.end, leg.share(since_s))

    def stride_at(self, t_s: float, events: Mapping[str, float]) -> LegStride | None:
        """Return where on its leg the object is; None before the first and after the last."""
        since_s = self._since_start_s(t_s, events)
        if since_s <= 0.0 or not self.legs or (since_s >= self.duration_s and not self.loop):
            return None
        since_s %= self.duration_s
        leg = self._leg_at(since_s)
        return LegStride(leg.share(since_s) * leg.length_m, leg.length_m, leg.speed_m_s)

    def _leg_at(self, since_s: float) -> MotionLeg:
        return self.legs[bisect.bisect_right(self._begins_s, since_s) - 1]

    def travel(self, from_s: float, to_s: float, events: Mapping[str, float]) -> MotionTravel:
        """Return how far the motion goes and turns between two times; exact, also at corners."""
        first_s = max(0.0, self._since_start_s(from_s, events))
        last_s = max(0.0, self._since_start_s(to_s, events))
        if not self.legs or last_s <= first_s:
            return AT_REST
        if self.loop:
            return self._travel_round(first_s, last_s)
        return self._travel_once(first_s, last_s)

    def is_even(self, from_s: float, to_s: float, events: Mapping[str, float]) -> bool:
        """Return whether the motion between two times is rest, or straight, even and unturned."""
        first_s, last_s = self._since_start_s(from_s, events), self._since_start_s(to_s, events)
        if not self.legs or last_s <= 0.0 or (first_s >= self.duration_s and not self.loop):
            return True
        if self.loop and first_s > 0.0:
            rounds = math.floor(first_s / self.duration_s)
            first_s, last_s = (each - rounds * self.duration_s for each in (first_s, last_s))
        return any(leg.is_even(first_s, last_s) for leg in self.legs)

    def _since_start_s(self, t_s: float, events: Mapping[str, float]) -> float:
        started_s = self.start.started_s(events)
        return -1.0 if started_s is None else t_s - started_s

    def _travel_once(self, first_s: float, last_s: float) -> MotionTravel:
        length_m = turn_rad = 0.0
        # The one before the first as well: by rounding its end may be a moment later.
        begin = max(0, bisect.bisect_right(self._begins_s, first_s) - 2)
        end = bisect.bisect_right(self._begins_s, last_s)
        for leg in self.legs[begin:end]:
            share = leg.share(last_s) - leg.share(first_s)
            if share > 0.0:
                length_m += share * leg.length_m
                turn_rad += share * leg.turn_rad
        return MotionTravel(length_m, turn_rad)

    def _travel_round(self, first_s: float, last_s: float) -> MotionTravel:
        before, after = self._travel_since_start(first_s), self._travel_since_start(last_s)
        return MotionTravel(
            max(0.0, after.length_m - before.length_m), max(0.0, after.turn_rad - before.turn_rad)
        )

    def _travel_since_start(self, since_s: float) -> MotionTravel:
        rounds = math.floor(since_s / self.duration_s)
        part = self._travel_once(0.0, since_s - rounds * self.duration_s)
        return MotionTravel(
            part.length_m + rounds * sum(leg.length_m for leg in self.legs),
            part.turn_rad + rounds * sum(leg.turn_rad for leg in self.legs),
        )


def _legs(
    begin: Pose, waypoints: tuple[Waypoint, ...], acceleration_m_s2: float | None, *, loop: bool
) -> tuple[MotionLeg, ...]:
    legs: list[MotionLeg] = []
    at, begin_s = begin, 0.0
    for speed_m_s, end in _route(begin, waypoints, loop=loop):
        leg = _leg(begin_s, at, end, speed_m_s, acceleration_m_s2)
        if leg.duration_s > 0.0:
            legs.append(leg)
            at, begin_s = leg.end, leg.begin_s + leg.duration_s
    return tuple(legs)


def _route(
    begin: Pose, waypoints: tuple[Waypoint, ...], *, loop: bool
) -> Iterator[tuple[float, Pose]]:
    """Return the speed to each pose of a motion, and the pose.

    A waypoint's yaw turns the object about the vertical: roll and pitch of the begin stay.
    """
    q_wxyz = begin.q_wxyz
    roll_rad, pitch_rad, _ = euler_from_quat(q_wxyz)
    for each in waypoints:
        if each.yaw_rad is not None:
            q_wxyz = quat_from_euler(roll_rad, pitch_rad, each.yaw_rad)
        yield each.speed_m_s, Pose(each.position_ned_m, q_wxyz)
    if loop and waypoints:
        yield waypoints[0].speed_m_s, begin


def _leg(
    begin_s: float, begin: Pose, end: Pose, speed_m_s: float, acceleration_m_s2: float | None
) -> MotionLeg:
    """Return the motion's leg between two poses; it takes at least as long as turning does."""
    turn_rad = angle_between(begin.q_wxyz, end.q_wxyz)
    length_m = norm(subtract(end.position_ned_m, begin.position_ned_m))
    duration_s, ramp = length_m / speed_m_s, 0.0
    if acceleration_m_s2 is not None:
        duration_s, ramp = ramped_leg(length_m, speed_m_s, acceleration_m_s2)
    duration_s = max(duration_s, turn_rad / TURN_RATE_RAD_S / (1.0 - ramp))
    return MotionLeg(begin_s, duration_s, begin, end, length_m, turn_rad, speed_m_s, ramp)
