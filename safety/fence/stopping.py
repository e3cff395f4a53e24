"""The path of a vehicle that is commanded to stop: the prediction behind the geofence; pure.

World frame, NED, metres and seconds.
"""

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from wil_campaign.worlds.frames import Vec3, add, norm, scale, subtract

__all__ = [
    "AccelerationEstimate",
    "StoppingPath",
    "VehicleMotion",
    "longest_path_m",
    "stopping_path",
    "velocities_ahead",
]

_STEADY: Vec3 = (0.0, 0.0, 0.0)
_SPAN_S = 0.3
"""Over how long velocities are compared: noise of 0.05 m/s then gives 0.24 m/s^2."""
_LEAST_SPAN_S = 0.15
_CONTINUES: Vec3 = (0.5, 0.5, 0.25)
"""For which part of the latency an acceleration lasts that was not commanded. That of a climb ends
sooner: an ArduCopter that leaves the ground has 3 m/s^2 for 0.3 s, and none after it."""
_APART_S = 0.05
"""The least time between stored velocities, whatever the rate of their source."""


class VehicleMotion(NamedTuple):
    """A vehicle's position and velocity in the world frame, and what changes the velocity.

    acceleration_ned_m_s2: as observed. commanded_ned_m_s: the commanded velocity; None if the
    vehicle is not commanded by velocity, or if that is not known.
    """

    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    acceleration_ned_m_s2: Vec3 = _STEADY
    commanded_ned_m_s: Vec3 | None = None


class StoppingPath(NamedTuple):
    """A predicted path to standstill: straight to where braking begins, then to where it ends."""

    braking_from_ned_m: Vec3
    end_ned_m: Vec3
    length_m: float


def velocities_ahead(
    motion: VehicleMotion, *, latency_s: float, braking_m_s2: float
) -> Iterator[Vec3]:
    """Yield the velocities that a vehicle may have when it begins to brake.

    First the present one; then the commanded one or, where that is not known, the one after its
    acceleration has lasted for half of the latency (vertically for a quarter): by then every
    autopilot has begun to end it. A change is limited to that by its braking: a velocity that jumps
    is a bad reading.
    """
    velocity, most = motion.velocity_ned_m_s, braking_m_s2 * latency_s
    yield velocity
    if motion.commanded_ned_m_s is not None:
        yield add(velocity, _at_most(subtract(motion.commanded_ned_m_s, velocity), most))
    elif motion.acceleration_ned_m_s2 != _STEADY:
        north, east, down = motion.acceleration_ned_m_s2
        continuing = (north * _CONTINUES[0], east * _CONTINUES[1], down * _CONTINUES[2])
        change = scale(continuing, latency_s)
        yield add(velocity, _at_most(change, 0.5 * most))


def longest_path_m(motion: VehicleMotion, *, latency_s: float, braking_m_s2: float) -> float:
    """Return an upper bound of the length of the stopping paths of this motion.

    A velocity towards a commanded one is no faster than the faster of the two; one changed by an
    acceleration is no faster than the sum of both.
    """
    speed_m_s = math.hypot(*motion.velocity_ned_m_s)
    if motion.commanded_ned_m_s is not None:
        speed_m_s = max(speed_m_s, math.hypot(*motion.commanded_ned_m_s))
    else:
        gained = min(math.hypot(*motion.acceleration_ned_m_s2), braking_m_s2)
        speed_m_s += 0.5 * gained * latency_s
    return speed_m_s * (latency_s + speed_m_s / (2.0 * braking_m_s2))


def stopping_path(
    motion: VehicleMotion, velocity_then_ned_m_s: Vec3, *, latency_s: float, braking_m_s2: float
) -> StoppingPath:
    """Return the path of a vehicle that is commanded to stop now.

    Over `latency_s` its velocity changes linearly from v to v', a path of (v + v') t / 2; from then
    on it brakes at a constant rate, v'^2 / (2 b).
    """
    half_s = 0.5 * latency_s
    flown = scale(add(motion.velocity_ned_m_s, velocity_then_ned_m_s), half_s)
    speed_m_s = norm(velocity_then_ned_m_s)
    braking_s = speed_m_s / (2.0 * braking_m_s2)
    begin = add(motion.position_ned_m, flown)
    end = add(begin, scale(velocity_then_ned_m_s, braking_s))
    return StoppingPath(begin, end, norm(flown) + speed_m_s * braking_s)


class AccelerationEstimate:
    """A vehicle's acceleration from its velocities: their change over the last 0.3 s.

    Zero until velocities span 0.15 s, and again after a gap longer than the whole span.
    """

    def __init__(self) -> None:
        self._velocities: deque[tuple[float, Vec3]] = deque()

    def update(self, velocity_ned_m_s: Vec3, t_s: float) -> Vec3:
        """Add a finite velocity with its time; return the acceleration, NED m/s^2."""
        recent = self._velocities
        if recent and not 0.0 <= t_s - recent[-1][0] <= _SPAN_S:
            recent.clear()
        # The oldest is removed only if the next one spans the time by itself.
        while len(recent) > 1 and t_s - recent[1][0] >= _SPAN_S:
            recent.popleft()
        if not recent or t_s - recent[-1][0] >= _APART_S:
            recent.append((t_s, velocity_ned_m_s))
        before_s, before = recent[0]
        elapsed_s = t_s - before_s
        if elapsed_s < _LEAST_SPAN_S:
            return _STEADY
        factor = 1.0 / elapsed_s
        return (
            (velocity_ned_m_s[0] - before[0]) * factor,
            (velocity_ned_m_s[1] - before[1]) * factor,
            (velocity_ned_m_s[2] - before[2]) * factor,
        )


def _at_most(change: Vec3, most: float) -> Vec3:
    """Return a change of velocity, no longer than `most`."""
    size = norm(change)
    return change if size <= most else scale(change, most / size)
