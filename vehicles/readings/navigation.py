"""Readings of navigation sensors: pose (motion capture), GPS and IMU."""

from dataclasses import dataclass

from wil_campaign.vehicles.readings.images import Source
from wil_campaign.worlds.frames import Pose, Vec3


@dataclass(frozen=True, slots=True)
class PoseReading:
    """A navigation reading: a vehicle's pose in the world's local frame (NED metres)."""

    t_s: float
    arrived_s: float
    source: Source
    pose: Pose
    velocity_ned_m_s: Vec3 | None = None
    seq: int = 0
    sensor: str = ""


@dataclass(frozen=True, slots=True)
class GpsReading:
    """A navigation reading: the fix of a GPS receiver, on WGS-84.

    latitude_deg, longitude_deg: degrees. altitude_m: above the ellipsoid (not above mean sea
    level). velocity_ned_m_s: over ground. horizontal_accuracy_m, vertical_accuracy_m: the
    receiver's own estimate, one standard deviation. fix_type: GPS_FIX_TYPE of MAVLink, 3 is a
    3-D fix. satellites: in use.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    velocity_ned_m_s: Vec3
    horizontal_accuracy_m: float
    vertical_accuracy_m: float
    fix_type: int = 3
    satellites: int = 12
    sensor: str = ""


@dataclass(frozen=True, slots=True)
class ImuReading:
    """A navigation reading: accelerometer and gyroscope, in the body's FRD axes.

    specific_force_frd_m_s2: what an accelerometer feels: (0, 0, -9.81) at rest and level.
    rates_frd_rad_s: angular velocity of the body.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    specific_force_frd_m_s2: Vec3
    rates_frd_rad_s: Vec3
    sensor: str = ""
