"""How things move: along waypoints at given speeds, from a time or an event on.

Pure: the pose depends on the time and on when events happened, on nothing else.
"""

import bisect
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from worlds.frames import Pose, Vec3, angle_between, norm, quat_from_euler, subtract

Moment = Literal["takeoff", "at_height", "goal", "done"]
MOMENTS: tuple[Moment, ...] = get_args(Moment)
"""What happens in a run that motion may wait for: the takeoff command, both vehicles at height,
t0 (the goal is given), the autonomy is done."""
TURN_RATE_RAD_S = math.pi
"""How fast a thing turns at most: where a way is too short for its turn, it takes longer."""


@dataclass(frozen=True, slots=True)
class StartAt:
    """Motion begins at a time on the scene's clock, in seconds."""

    at_s: float = 0.0

    def started_s(self, events: Mapping[str, float]) -> float | None:
        """Return when the motion began; None while it has not."""
        del events
        return self.at_s


@dataclass(frozen=True, slots=True)
class StartOn:
    """Motion begins a delay after an event; not before the event has a time."""

    event: str
    delay_s: float = 0.0

    def started_s(self, events: Mapping[str, float]) -> float | None:
        """Return when the motion began after its event; None while it has not."""
        at_s = events.get(self.event)
        return None if at_s is None else at_s + self.delay_s


Start = StartAt | StartOn


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A motion's waypoint: where, how fast, and the heading to turn to (radians; None keeps it).

    A way too short to turn on at TURN_RATE_RAD_S is gone more slowly.
    """

    position_ned_m: Vec3
    speed_m_s: float
    yaw_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Leg:
    """A leg of a motion: a straight way between two poses at constant speed and turning rate."""

    begin_s: float
    duration_s: float
    begin: Pose
    end: Pose
    length_m: float
    turn_rad: float


@dataclass(frozen=True, slots=True)
class Travel:
    """How far a moving object went between two times: bounds for any of its points."""

    length_m: float
    turn_rad: float


AT_REST = Travel(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Motion:
    """An object's motion through waypoints from its pose; `loop` repeats for ever.

    Times of events and `start` are on one clock, seconds. Where a loop closes, the last leg
    leads back to the beginning at the speed of the first waypoint.
    """

    begin: Pose
    waypoints: tuple[Waypoint, ...]
    start: Start = StartAt()
    loop: bool = False
    legs: tuple[Leg, ...] = field(init=False, repr=False, compare=False)
    _begins_s: tuple[float, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        legs = _legs(self.begin, self.waypoints, loop=self.loop)
        object.__setattr__(self, "legs", legs)
        object.__setattr__(self, "_begins_s", tuple(leg.begin_s for leg in legs))

    @property
    def duration_s(self) -> float:
        """Return how long one round of the motion takes."""
        return self.legs[-1].begin_s + self.legs[-1].duration_s if self.legs else 0.0

    def pose_at(self, t_s: float, events: Mapping[str, float]) -> Pose:
        """Return the moving object's pose at a time, given when each event happened."""
        since_s = self._since_start_s(t_s, events)
        if since_s <= 0.0 or not self.legs:
            return self.begin
        if since_s >= self.duration_s:
            if not self.loop:
                return self.legs[-1].end
            since_s %= self.duration_s
        leg = self.legs[bisect.bisect_right(self._begins_s, since_s) - 1]
        return leg.begin.interpolate(leg.end, (since_s - leg.begin_s) / leg.duration_s)

    def travel(self, from_s: float, to_s: float, events: Mapping[str, float]) -> Travel:
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
        return any(
            leg.turn_rad == 0.0
            and leg.begin_s <= first_s
            and last_s <= leg.begin_s + leg.duration_s
            for leg in self.legs
        )

    def _since_start_s(self, t_s: float, events: Mapping[str, float]) -> float:
        started_s = self.start.started_s(events)
        return -1.0 if started_s is None else t_s - started_s

    def _travel_once(self, first_s: float, last_s: float) -> Travel:
        length_m = turn_rad = 0.0
        for leg in self.legs:
            end_s = leg.begin_s + leg.duration_s
            share = (min(last_s, end_s) - max(first_s, leg.begin_s)) / leg.duration_s
            if share > 0.0:
                length_m += share * leg.length_m
                turn_rad += share * leg.turn_rad
        return Travel(length_m, turn_rad)

    def _travel_round(self, first_s: float, last_s: float) -> Travel:
        before, after = self._travel_since_start(first_s), self._travel_since_start(last_s)
        return Travel(
            max(0.0, after.length_m - before.length_m), max(0.0, after.turn_rad - before.turn_rad)
        )

    def _travel_since_start(self, since_s: float) -> Travel:
        rounds = math.floor(since_s / self.duration_s)
        part = self._travel_once(0.0, since_s - rounds * self.duration_s)
        return Travel(
            part.length_m + rounds * sum(leg.length_m for leg in self.legs),
            part.turn_rad + rounds * sum(leg.turn_rad for leg in self.legs),
        )


def _legs(begin: Pose, waypoints: tuple[Waypoint, ...], *, loop: bool) -> tuple[Leg, ...]:
    """Return the legs of a motion through waypoints, back to the begin for a loop."""
    route = [*waypoints]
    if loop and waypoints:
        route.append(Waypoint(begin.position_ned_m, waypoints[0].speed_m_s, begin.yaw_rad))
    legs: list[Leg] = []
    at, begin_s = begin, 0.0
    for waypoint in route:
        leg = _leg(begin_s, at, waypoint)
        if leg.duration_s > 0.0:
            legs.append(leg)
            at, begin_s = leg.end, leg.begin_s + leg.duration_s
    return tuple(legs)


def _leg(begin_s: float, begin: Pose, waypoint: Waypoint) -> Leg:
    """Return the motion's leg to a waypoint; it takes at least as long as turning does."""
    upright = waypoint.yaw_rad is not None
    q_wxyz = quat_from_euler(0.0, 0.0, waypoint.yaw_rad or 0.0) if upright else begin.q_wxyz
    turn_rad = angle_between(begin.q_wxyz, q_wxyz)
    length_m = norm(subtract(waypoint.position_ned_m, begin.position_ned_m))
    duration_s = max(length_m / waypoint.speed_m_s, turn_rad / TURN_RATE_RAD_S)
    return Leg(
        begin_s, duration_s, begin, Pose(waypoint.position_ned_m, q_wxyz), length_m, turn_rad
    )
