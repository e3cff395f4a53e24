"""Readings of rangefinders in MAVLink's DISTANCE_SENSOR; pure.

https://mavlink.io/en/messages/common.html states its units, centimetres.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.lidar.ranging import require_reach
from wil_campaign.vehicles.mavlink.names import enum_name
from wil_campaign.vehicles.readings import RangefinderReading, Reading
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    CM,
    HasState,
    MavlinkReading,
    MavlinkSensor,
    MessageTimes,
    Reader,
)
from wil_campaign.worlds.frames import Vec3, rotate

_NO_SIGNAL = 1
"""signal_quality: 0 is unknown, 1 is invalid."""
_ASIDE_COS = math.cos(math.radians(20.0))
"""A mount within this of the orientation that the message states looks the same way."""
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


def rangefinder_reading(
    message: Any, times: MessageTimes, sensor: MavlinkSensor
) -> RangefinderReading | None:
    """Return the reading in a DISTANCE_SENSOR; None for one of another sensor.

    Raises UnusableReadingError for one that looks elsewhere, or has other limits.
    """
    if sensor.sensor_id is not None and message.id != sensor.sensor_id:
        return None
    mount = sensor.mount
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
    low_m, high_m = message.min_distance * CM, message.max_distance * CM
    require_reach(sensor.options, low_m, high_m)
    range_m = message.current_distance * CM
    if range_m > high_m or message.signal_quality == _NO_SIGNAL:
        range_m = math.inf
    return RangefinderReading(
        *times.stamps,
        range_m=range_m,
        range_min_m=low_m,
        range_max_m=high_m,
        mount=mount,
    )


def _reader(sensor: MavlinkSensor, vehicle: HasState) -> Reader:
    """Return what reads distances: of one `id`, the first that looks where the mount does."""
    del vehicle
    taken: int | None = None

    def read(message: Any, times: MessageTimes) -> Reading | None:
        nonlocal taken
        reading = rangefinder_reading(message, times, sensor)
        if reading is not None and taken is None:
            taken = message.id
        if reading is not None and message.id != taken:
            raise UnusableReadingError(
                f"sensors {taken} and {message.id} look in one direction, and sensor {taken} is "
                "taken: choose one by `source: {address: mavlink, id: ...}`"
            )
        return reading

    return read


BEAMS = MavlinkReading(
    ("DISTANCE_SENSOR",),
    _reader,
    {
        "DISTANCE_SENSOR": "connect a rangefinder and enable it on the autopilot (ArduPilot: "
        "RNGFND1_TYPE; PX4: the SENS_EN_ parameter of its driver)"
    },
)
