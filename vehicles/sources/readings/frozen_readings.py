"""Detects a frozen sensor: its readings stay the same while the vehicle moves; pure."""

import math
from typing import NamedTuple

from wil_campaign.vehicles.readings import CameraReading, DepthReading, Reading
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.worlds.frames import Pose, angle_between, norm, subtract

_SAME = 10
"""Up to so many equal readings in succession may be chance, with a sensor of coarse steps."""


class _EqualReadings(NamedTuple):
    """The first of a series of equal readings: numbers, pose, time; times: their count."""

    numbers: tuple[object, ...]
    pose: Pose
    t_s: float
    times: int


class FrozenReadings:
    """Detects that a sensor repeats the same reading while its vehicle moves."""

    def __init__(self) -> None:
        self._since: _EqualReadings | None = None

    def receive(self, reading: Reading, pose: Pose | None) -> str | None:
        """Return a message that the sensor is frozen; None when not. pose: of the vehicle."""
        traits = traits_of(type(reading))
        numbers = traits.compared(reading)
        if not numbers:
            self._since = None
        if not numbers or pose is None:
            return None
        since = self._since
        if since is None or since.numbers != numbers:
            self._since = _EqualReadings(numbers, pose, reading.t_s, 1)
            return None
        self._since = since = since._replace(times=since.times + 1)
        if since.times < _SAME or not traits.has_moved(reading, since.pose, pose):
            return None
        moved = f"moved {norm(subtract(pose.position_ned_m, since.pose.position_ned_m)):.2f} m"
        if isinstance(reading, CameraReading | DepthReading):
            turned_rad = angle_between(since.pose.q_wxyz, pose.q_wxyz)
            moved += f" and turned {math.degrees(turned_rad):.0f} deg"
        return (
            f"its last {since.times} readings, since {since.t_s:.2f} s, are the same, and the "
            f"vehicle {moved} meanwhile: the sensor is frozen"
        )
