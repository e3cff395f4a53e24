"""Interpolation between two readings of the same sensor. Pure."""

from dataclasses import replace

import numpy as np

from wil_campaign.vehicles.readings import (
    GpsReading,
    ImuReading,
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.worlds.frames import lerp

INTERPOLATED = ("pose", "gps", "imu", "rangefinder", "lidar")
"""Sensor types with interpolation; images, clouds and blocks of sound have none."""


def interpolated_reading(a: Reading, b: Reading, t_s: float) -> Reading | None:
    """Return the reading interpolated between two at a time; None when they do not fit.

    Positions, velocities, rates, forces and ranges change linearly, attitudes along the shortest
    arc. A range that is infinite on one side is taken from the nearer reading.
    """
    fraction = (t_s - a.t_s) / (b.t_s - a.t_s)
    nearer = a if fraction < 0.5 else b
    match a, b:
        case PoseReading(), PoseReading():
            moving = a.velocity_ned_m_s is not None and b.velocity_ned_m_s is not None
            velocity = (
                lerp(a.velocity_ned_m_s or _STILL, b.velocity_ned_m_s or _STILL, fraction)
                if moving
                else None
            )
            pose = a.pose.interpolate(b.pose, fraction)
            return replace(a, t_s=t_s, pose=pose, velocity_ned_m_s=velocity)
        case ImuReading(), ImuReading():
            force = lerp(a.specific_force_frd_m_s2, b.specific_force_frd_m_s2, fraction)
            rates = lerp(a.rates_frd_rad_s, b.rates_frd_rad_s, fraction)
            return replace(a, t_s=t_s, specific_force_frd_m_s2=force, rates_frd_rad_s=rates)
        case GpsReading(), GpsReading():
            return _fix(a, b, fraction, t_s)
        case RangefinderReading(), RangefinderReading():
            value = a.range_m + (b.range_m - a.range_m) * fraction
            known = np.isfinite(a.range_m) and np.isfinite(b.range_m)
            held = nearer if isinstance(nearer, RangefinderReading) else a
            return replace(a, t_s=t_s, range_m=value if known else held.range_m)
        case LidarScanReading(), LidarScanReading() if not traits_of(type(a)).mismatch(a, b):
            return _scan(a, b, fraction, t_s)
        case _:
            return None


_STILL = (0.0, 0.0, 0.0)


def _fix(a: GpsReading, b: GpsReading, fraction: float, t_s: float) -> GpsReading:
    """Return the GPS fix interpolated between two, the shorter way across the date line."""
    east = (b.longitude_deg - a.longitude_deg + 180.0) % 360.0 - 180.0
    longitude = (a.longitude_deg + east * fraction + 180.0) % 360.0 - 180.0
    return replace(
        a,
        t_s=t_s,
        latitude_deg=a.latitude_deg + (b.latitude_deg - a.latitude_deg) * fraction,
        longitude_deg=longitude,
        altitude_m=a.altitude_m + (b.altitude_m - a.altitude_m) * fraction,
        velocity_ned_m_s=lerp(a.velocity_ned_m_s, b.velocity_ned_m_s, fraction),
        horizontal_accuracy_m=max(a.horizontal_accuracy_m, b.horizontal_accuracy_m),
        vertical_accuracy_m=max(a.vertical_accuracy_m, b.vertical_accuracy_m),
        fix_type=min(a.fix_type, b.fix_type),
        satellites=min(a.satellites, b.satellites),
    )


def _scan(
    a: LidarScanReading, b: LidarScanReading, fraction: float, t_s: float
) -> LidarScanReading:
    """Return the lidar scan interpolated between two; unknown ranges are the nearer scan's."""
    nearer = a if fraction < 0.5 else b
    known = np.isfinite(a.ranges_m) & np.isfinite(b.ranges_m)
    with np.errstate(invalid="ignore"):
        mixed = a.ranges_m + (b.ranges_m - a.ranges_m) * np.float32(fraction)
    ranges_m = np.where(known, mixed, nearer.ranges_m)
    return replace(a, t_s=t_s, ranges_m=ranges_m, object_ids=nearer.object_ids)
