"""Values of a pose or state that oracles judge: pure functions, each named with its unit."""

import math
import re

from wil_campaign.safety.model.samples import PoseSample, StateSample
from wil_campaign.worlds.frames import Vec3, add, euler_from_quat, scale


def north_m(sample: PoseSample) -> float:
    """Return the signal "north" of a pose: metres from the world's origin."""
    return sample.pose.position_ned_m[0]


def east_m(sample: PoseSample) -> float:
    """Return the signal "east" of a pose: metres from the world's origin."""
    return sample.pose.position_ned_m[1]


def up_m(sample: PoseSample) -> float:
    """Return the signal "height" of a pose over the world's origin, metres."""
    return -sample.pose.position_ned_m[2]


def speed_m_s(sample: PoseSample) -> float:
    """Return the signal "speed" of a pose along all axes."""
    return math.hypot(*sample.velocity_ned_m_s)


def ground_speed_m_s(sample: PoseSample) -> float:
    """Return the signal "horizontal speed" of a pose."""
    return math.hypot(sample.velocity_ned_m_s[0], sample.velocity_ned_m_s[1])


def climb_m_s(sample: PoseSample) -> float:
    """Return the signal "climb rate" of a pose; negative while it sinks."""
    return -sample.velocity_ned_m_s[2]


def vertical_speed_m_s(sample: PoseSample) -> float:
    """Return the signal "vertical speed" of a pose, never negative."""
    return abs(sample.velocity_ned_m_s[2])


def roll_deg(sample: PoseSample) -> float:
    """Return the signal "roll" of a pose, positive to the right."""
    return math.degrees(euler_from_quat(sample.pose.q_wxyz)[0])


def pitch_deg(sample: PoseSample) -> float:
    """Return the signal "pitch" of a pose, positive nose up."""
    return math.degrees(euler_from_quat(sample.pose.q_wxyz)[1])


def yaw_deg(sample: PoseSample) -> float:
    """Return the signal "heading" of a pose, clockwise from north, within [-180, 180]."""
    return math.degrees(euler_from_quat(sample.pose.q_wxyz)[2])


def tilt_deg(sample: PoseSample) -> float:
    """Return the signal "tilt" of a pose: angle from the vertical, 0 to 180."""
    _, x, y, _ = sample.pose.q_wxyz
    return math.degrees(math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y)))))


def battery_percent(sample: StateSample) -> float | None:
    """Return the remaining charge of a state; None while unknown.

    Rounded, as vehicles report whole percents: 0.29 times 100 is less than 29.
    """
    fraction = sample.battery_fraction
    return None if fraction is None else round(fraction * 100.0, 6)


def distance_name(thing: str) -> str:
    """Return the name of the signal of the distance to one object of the world."""
    return f"distance_{re.sub('[^A-Za-z0-9_]', '_', thing)}_m"


def extrapolated_ned_m(sample: PoseSample, t_s: float) -> Vec3:
    """Return a vehicle's position extrapolated to a time, to compare the pair."""
    ahead_m = scale(sample.velocity_ned_m_s, t_s - sample.t_s)
    return add(sample.pose.position_ned_m, ahead_m)
