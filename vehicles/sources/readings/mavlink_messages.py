"""Decodes MAVLink's sensor messages to readings, by MAVLink's own units and axes; pure.

https://mavlink.io/en/messages/common.html: DISTANCE_SENSOR, OBSTACLE_DISTANCE and GPS_RAW_INT state
their units; SCALED_IMU is in milli-g and mrad/s, HIGHRES_IMU in m/s2 and rad/s. RAW_IMU has no unit
there: ArduPilot fills it as SCALED_IMU (GCS_Common.cpp, send_raw_imu), and only its is accepted.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.mavlink.names import enum_name
from wil_campaign.vehicles.readings import (
    GpsReading,
    ImuReading,
    LidarScanReading,
    RangefinderReading,
    Ranges,
    Source,
)
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.worlds.frames import Pose, Vec3, rotate

MESSAGES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "rangefinder": ("DISTANCE_SENSOR",),
        "lidar": ("OBSTACLE_DISTANCE",),
        "gps": ("GPS_RAW_INT", "GPS2_RAW"),
        "imu": ("HIGHRES_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "RAW_IMU"),
    }
)
"""The messages that hold a type of sensor's readings."""

_CM, _MM, _MILLI = 0.01, 0.001, 0.001
_STANDARD_G = 9.80665
"""ISO 80000-3; what ArduPilot and PX4 scale by."""
_UINT16_MAX = 0xFFFF
_UNKNOWN_COUNT = 0xFF
_NO_SIGNAL = 1
"""signal_quality: 0 is unknown, 1 is invalid."""
_UNIX_US = 10**15
"""time_usec above this counts from 1970, below it from boot (31 years)."""
_ACCELERATION, _RATES = 0b000_111, 0b111_000
"""HIGHRES_IMU_UPDATED_FLAGS."""
_ASIDE_COS = math.cos(math.radians(20.0))
"""A mount within this of the orientation that the message states looks the same way."""
_SAME_REACH = 0.02
_DIAGONAL = math.sqrt(0.5)
_LOOKS: Mapping[int, Vec3] = MappingProxyType(
    {
        mavlink.MAV_SENSOR_ROTATION_NONE: (1.0, 0.0, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_45: (_DIAGONAL, _DIAGONAL, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_90: (0.0, 1.0, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_135: (-_DIAGONAL, _DIAGONAL, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_180: (-1.0, 0.0, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_225: (-_DIAGONAL, -_DIAGONAL, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_270: (0.0, -1.0, 0.0),
        mavlink.MAV_SENSOR_ROTATION_YAW_315: (_DIAGONAL, -_DIAGONAL, 0.0),
        mavlink.MAV_SENSOR_ROTATION_PITCH_90: (0.0, 0.0, -1.0),
        mavlink.MAV_SENSOR_ROTATION_PITCH_270: (0.0, 0.0, 1.0),
    }
)
"""Where a sensor looks, body FRD, by MAV_SENSOR_ORIENTATION."""


@dataclass(frozen=True, slots=True)
class Times:
    """When a message was sampled and when it arrived, on the run clock; side: whose it is."""

    t_s: float
    arrived_s: float
    side: Source

    @property
    def stamps(self) -> tuple[float, float, int, Source]:
        """Return the first fields of its reading: times, number 0, vehicle."""
        return self.t_s, self.arrived_s, 0, self.side


@dataclass(frozen=True, slots=True)
class Beams:
    """The beams that a lidar's readings have: i looks at start_angle_rad + i * step_rad."""

    count: int
    start_angle_rad: float
    step_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedReach:
    """The range limits that the campaign gives for a sensor, metres; None: not given."""

    min_m: float | None = None
    max_m: float | None = None

    def require(self, min_m: float, max_m: float) -> None:
        """Raise UnusableReadingError unless a message states the same limits."""
        pairs = (("range_min_m", self.min_m, min_m), ("range_max_m", self.max_m, max_m))
        for key, wanted, stated in pairs:
            if wanted is not None and abs(wanted - stated) > _SAME_REACH * max(wanted, stated):
                raise UnusableReadingError(
                    f"the message states {stated:g} m and the campaign {key}: {wanted:g}; one of "
                    f"the two has another unit: correct it, or leave out {key}"
                )


UNSTATED = StatedReach()


def stamp_s(message: Any) -> tuple[float, bool]:
    """Return a message's time stamp in seconds, and whether it counts from 1970, not from boot."""
    if hasattr(message, "time_boot_ms"):
        return message.time_boot_ms * 1e-3, False
    return message.time_usec * 1e-6, message.time_usec >= _UNIX_US


def rangefinder_reading(
    message: Any, times: Times, *, mount: Pose, reach: StatedReach, sensor_id: int | None
) -> RangefinderReading | None:
    """Return the reading in a DISTANCE_SENSOR; None for one of another sensor.

    sensor_id: None for any. Raises UnusableReadingError for one that looks elsewhere.
    """
    if sensor_id is not None and message.id != sensor_id:
        return None
    looks = _LOOKS.get(message.orientation)
    axis = rotate(mount.q_wxyz, (1.0, 0.0, 0.0))
    if message.orientation != mavlink.MAV_SENSOR_ROTATION_CUSTOM and (
        looks is None or sum(a * b for a, b in zip(looks, axis, strict=True)) < _ASIDE_COS
    ):
        orientation = enum_name("MAV_SENSOR_ORIENTATION", message.orientation)
        raise UnusableReadingError(
            f"sensor {message.id} looks in another direction than its `mount`: its orientation is "
            f"{orientation}; correct `mount`, or choose another sensor by `source: {{address: "
            "mavlink, id: ...}`"
        )
    low_m, high_m = message.min_distance * _CM, message.max_distance * _CM
    reach.require(low_m, high_m)
    range_m = message.current_distance * _CM
    if range_m > high_m or message.signal_quality == _NO_SIGNAL:
        range_m = math.inf
    return RangefinderReading(
        *times.stamps,
        range_m=range_m,
        range_min_m=low_m,
        range_max_m=high_m,
        mount=mount,
    )


def lidar_reading(
    message: Any,
    times: Times,
    *,
    pattern: Beams,
    mount: Pose,
    reach: StatedReach,
    heading_rad: float | None,
) -> LidarScanReading:
    """Return the reading in an OBSTACLE_DISTANCE: each beam has the distance of its sector.

    heading_rad: of the vehicle from north, for sectors that count from there; None: unknown.
    Raises UnusableReadingError when a beam is in no sector.
    """
    width_rad = math.radians(message.increment_f or message.increment)
    first_rad = math.radians(message.angle_offset)
    if message.frame != mavlink.MAV_FRAME_BODY_FRD:
        if heading_rad is None:
            raise UnusableReadingError(
                "its sectors count from north, and the vehicle's heading is not known"
            )
        first_rad -= heading_rad
    low_m, high_m = message.min_distance * _CM, message.max_distance * _CM
    reach.require(low_m, high_m)
    return LidarScanReading(
        *times.stamps,
        ranges_m=_beam_ranges(message.distances, first_rad, width_rad, pattern, high_m),
        start_angle_rad=pattern.start_angle_rad,
        step_rad=pattern.step_rad,
        range_min_m=low_m,
        range_max_m=high_m,
        mount=mount,
    )


def _beam_ranges(
    distances_cm: Any, first_rad: float, width_rad: float, pattern: Beams, high_m: float
) -> Ranges:
    """Return the distances of a pattern's beams; inf where a sector is empty or unknown."""
    if not width_rad > 0.0:
        raise UnusableReadingError("its sectors have no width: increment and increment_f are 0")
    count = min(len(distances_cm), round(2.0 * math.pi / width_rad))
    beams_rad = pattern.start_angle_rad + pattern.step_rad * np.arange(pattern.count)
    # 1e-9 more: a beam on the edge between two sectors belongs to the same one on every machine.
    sectors = np.rint(((beams_rad - first_rad) % (2.0 * math.pi)) / width_rad + 1e-9).astype(int)
    if count * width_rad >= 2.0 * math.pi - width_rad / 2.0:
        sectors %= count
    if (sectors >= count).any():
        raise UnusableReadingError(
            f"{int((sectors >= count).sum())} of {pattern.count} beams are outside of its {count} "
            f"sectors of {math.degrees(width_rad):g} degrees from "
            f"{math.degrees(first_rad):g}: set fov_deg to the width of the sectors"
        )
    distances = np.asarray(distances_cm[:count])
    empty = (distances == _UINT16_MAX) | (distances * _CM > high_m)
    ranges = np.where(empty, np.inf, distances * _CM).astype(np.float32)
    found: Ranges = ranges[sectors]
    return found


def imu_reading(message: Any, times: Times) -> ImuReading:
    """Return the reading in HIGHRES_IMU, SCALED_IMU or ArduPilot's RAW_IMU, body FRD."""
    acceleration = (message.xacc, message.yacc, message.zacc)
    rates = (message.xgyro, message.ygyro, message.zgyro)
    if message.get_type() == "HIGHRES_IMU":
        both = _ACCELERATION | _RATES
        if message.fields_updated & both != both:
            raise UnusableReadingError("its fields_updated lacks accelerations or rates")
    else:
        acceleration = tuple(a * _MILLI * _STANDARD_G for a in acceleration)
        rates = tuple(r * _MILLI for r in rates)
    return ImuReading(
        *times.stamps,
        specific_force_frd_m_s2=(acceleration[0], acceleration[1], acceleration[2]),
        rates_frd_rad_s=(rates[0], rates[1], rates[2]),
    )


def gps_reading(
    message: Any, times: Times, *, before: GpsReading | None, undulation_m: float | None
) -> GpsReading:
    """Return the reading in GPS_RAW_INT or GPS2_RAW.

    The messages have no vertical speed: it is the change of height since the reading `before`.
    undulation_m: of the geoid above the ellipsoid, where the receiver does not report it. Raises
    UnusableReadingError for a fix without position, height, speed or accuracy.
    """
    if message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
        raise UnusableReadingError(f"its fix_type is {message.fix_type}: no 3-D fix")
    if message.vel == _UINT16_MAX or (message.cog == _UINT16_MAX and message.vel > 0):
        raise UnusableReadingError("it has no speed or no course over ground (vel, cog)")
    if not (message.h_acc and message.v_acc):
        raise UnusableReadingError(
            "it has no accuracy (h_acc, v_acc are 0): the link needs MAVLink 2, and the receiver "
            "has to report it"
        )
    altitude_m = message.alt_ellipsoid * _MM
    if message.alt_ellipsoid == 0:
        if undulation_m is None:
            raise UnusableReadingError(
                "it has no height above the ellipsoid (alt_ellipsoid is 0); give the geoid's "
                "height at this place as `source: {address: mavlink, undulation_m: ...}`"
            )
        altitude_m = message.alt * _MM + undulation_m
    speed_m_s, cog_rad = message.vel * _CM, math.radians(message.cog * 0.01)
    down_m_s = 0.0
    if before is not None and times.t_s > before.t_s:
        down_m_s = (before.altitude_m - altitude_m) / (times.t_s - before.t_s)
    north_m_s, east_m_s = speed_m_s * math.cos(cog_rad), speed_m_s * math.sin(cog_rad)
    seen = message.satellites_visible
    return GpsReading(
        *times.stamps,
        latitude_deg=message.lat * 1e-7,
        longitude_deg=message.lon * 1e-7,
        altitude_m=altitude_m,
        velocity_ned_m_s=(north_m_s, east_m_s, down_m_s),
        horizontal_accuracy_m=message.h_acc * _MM,
        vertical_accuracy_m=message.v_acc * _MM,
        fix_type=message.fix_type,
        satellites=0 if seen == _UNKNOWN_COUNT else seen,
    )
