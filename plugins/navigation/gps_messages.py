"""Fixes of GPS receivers in MAVLink's GPS_RAW_INT and GPS2_RAW; pure.

https://mavlink.io/en/messages/common.html states their units.
"""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.readings import GpsReading, Reading
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    CM,
    UINT16_MAX,
    HasState,
    MavlinkReading,
    MavlinkSensor,
    MessageTimes,
    Reader,
)

_MM = 0.001
_UNKNOWN_COUNT = 0xFF


def gps_reading(
    message: Any, times: MessageTimes, *, before: GpsReading | None, undulation_m: float | None
) -> GpsReading:
    """Return the reading in GPS_RAW_INT or GPS2_RAW.

    The messages have no vertical speed: it is the change of height since the reading `before`.
    undulation_m: of the geoid above the ellipsoid, where the receiver does not report it. Raises
    UnusableReadingError for a fix without position, height, speed or accuracy.
    """
    if message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
        raise UnusableReadingError(f"its fix_type is {message.fix_type}: no 3-D fix")
    if message.vel == UINT16_MAX or (message.cog == UINT16_MAX and message.vel > 0):
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
    speed_m_s, cog_rad = message.vel * CM, math.radians(message.cog * 0.01)
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


def _reader(sensor: MavlinkSensor, vehicle: HasState) -> Reader:
    """Return what reads fixes: the first one has no vertical speed, and is none."""
    del vehicle
    previous: GpsReading | None = None

    def read(message: Any, times: MessageTimes) -> Reading | None:
        nonlocal previous
        before = previous
        previous = gps_reading(message, times, before=before, undulation_m=sensor.undulation_m)
        return previous if before is not None else None

    return read


MESSAGES = MavlinkReading(
    ("GPS_RAW_INT", "GPS2_RAW"),
    _reader,
    {
        "GPS_RAW_INT": "connect a receiver, and wait for its 3-D fix",
        "GPS2_RAW": "connect a second receiver, and wait for its 3-D fix",
    },
)
