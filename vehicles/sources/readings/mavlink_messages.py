"""Decodes MAVLink's sensor messages to readings, by MAVLink's own units and axes; pure.

https://mavlink.io/en/messages/common.html: GPS_RAW_INT states its units; SCALED_IMU is in milli-g
and mrad/s, HIGHRES_IMU in m/s2 and rad/s. RAW_IMU has no unit there: ArduPilot fills it as
SCALED_IMU (GCS_Common.cpp, send_raw_imu), and only its is accepted.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.installed_plugins import load
from wil_campaign.vehicles.driver.vehicle_state import VehicleState
from wil_campaign.vehicles.readings import GpsReading, ImuReading, Reading, Source
from wil_campaign.vehicles.readings.kinds import sensor_specs
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

CM, _MM, _MILLI = 0.01, 0.001, 0.001
_STANDARD_G = 9.80665
"""ISO 80000-3; what ArduPilot and PX4 scale by."""
UINT16_MAX = 0xFFFF
_UNKNOWN_COUNT = 0xFF
_UNIX_US = 10**15
"""time_usec above this counts from 1970, below it from boot (31 years)."""
_ACCELERATION, _RATES = 0b000_111, 0b111_000
"""HIGHRES_IMU_UPDATED_FLAGS."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkSensor:
    """A sensor whose readings are in one of the vehicle's MAVLink messages.

    message: its name; None for a pose, which is the vehicle's estimate. rate_hz: at most; None:
    as it arrives. options: the sensor's keys; None for one of images. mount: its pose in the body's
    FRD frame. sensor_id: by the message's id; None: any. undulation_m: of the geoid above the
    ellipsoid, for a GPS receiver that does not report it.
    """

    message: str | None
    rate_hz: float | None = None
    options: Any = None
    mount: Pose = AT_ORIGIN
    sensor_id: int | None = None
    undulation_m: float | None = None


class HasState(Protocol):
    """The vehicle of whose messages readings are made (protocol)."""

    @property
    def state(self) -> VehicleState:
        """Return the vehicle's last reported state."""


Reader = Callable[[Any, Times], Reading | None]
"""Returns the reading in a message; None for none. Raises UnusableReadingError."""


@dataclass(frozen=True, slots=True)
class MavlinkReading:
    """How the readings of a type of sensors are read of a vehicle's MAVLink messages.

    messages: those that hold such readings, the usual one first. reader: makes what reads them for
    a sensor of a vehicle. remedies: by message, what to do where none comes. level: why the sensor
    cannot be turned on the body; "" where it can.
    """

    messages: tuple[str, ...]
    reader: Callable[[MavlinkSensor, HasState], Reader]
    remedies: Mapping[str, str] = field(default_factory=dict)
    level: str = ""


@cache
def mavlink_reading(sensor_type: str) -> MavlinkReading | None:
    """Return how a type of sensors is read of MAVLink messages; None where it is in none."""
    place = sensor_specs()[sensor_type].mavlink
    return load(place) if place else None


def messages_of(sensor_type: str) -> tuple[str, ...]:
    """Return the messages that hold a type of sensor's readings."""
    read = mavlink_reading(sensor_type)
    return () if read is None else read.messages


def stamp_s(message: Any) -> tuple[float, bool]:
    """Return a message's time stamp in seconds, and whether it counts from 1970, not from boot."""
    if hasattr(message, "time_boot_ms"):
        return message.time_boot_ms * 1e-3, False
    return message.time_usec * 1e-6, message.time_usec >= _UNIX_US


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


def _imu_reader(sensor: MavlinkSensor, vehicle: HasState) -> Reader:
    del sensor, vehicle
    return imu_reading


def _gps_reader(sensor: MavlinkSensor, vehicle: HasState) -> Reader:
    """Return what reads fixes: the first one has no vertical speed, and is none."""
    del vehicle
    previous: GpsReading | None = None

    def read(message: Any, times: Times) -> Reading | None:
        nonlocal previous
        before = previous
        previous = gps_reading(message, times, before=before, undulation_m=sensor.undulation_m)
        return previous if before is not None else None

    return read


GPS = MavlinkReading(
    ("GPS_RAW_INT", "GPS2_RAW"),
    _gps_reader,
    {
        "GPS_RAW_INT": "connect a receiver, and wait for its 3-D fix",
        "GPS2_RAW": "connect a second receiver, and wait for its 3-D fix",
    },
)
IMU = MavlinkReading(
    ("HIGHRES_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "RAW_IMU"), _imu_reader
)
