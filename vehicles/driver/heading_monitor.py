"""Receives what a vehicle's heading is compared with, and passes the comparisons on."""

import math
from collections.abc import Callable
from struct import Struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.poses.headings import HeadingComparison, HeadingDifference

_POSITION: Struct = mavlink.MAVLink_local_position_ned_message.unpacker
_QUATERNION: Struct = mavlink.MAVLink_attitude_quaternion_message.unpacker
_MAGNETOMETER = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
_FIELD_UPDATED = 0b111 << 6
"""HIGHRES_IMU_UPDATED_FLAGS of the magnetometer's three axes."""
_UNKNOWN_COURSE = 0xFFFF
_YAW_UNKNOWN = frozenset({0, 0xFFFF})
"""GPS_RAW_INT.yaw: not available, and none now; north is 36000."""

HeadingListener = Callable[[HeadingDifference], None]


class HeadingMonitor:
    """Compares a vehicle's estimated heading with what else it sends of it.

    That is, where it arrives: the body rates with its attitude, HIGHRES_IMU or RAW_IMU of a
    magnetometer that its autopilot uses (SYS_STATUS), and GPS_RAW_INT.
    """

    def __init__(self, *, session: MavlinkSession, clock: VehicleClock) -> None:
        self._session = session
        self._clock = clock
        self._listeners: list[HeadingListener] = []
        self._comparison = HeadingComparison()
        self._uses_magnetometer = False

    def listen(self, listener: HeadingListener) -> None:
        """Call a listener with each comparison of the heading."""
        if not self._listeners:
            self._begin()
        self._listeners.append(listener)

    def anchor(self) -> None:
        """Compare with the present heading from now on: it anchors the vehicle's frame."""
        self._comparison.anchor()

    def restart(self) -> None:
        """Forget what was compared: the vehicle rebooted."""
        self._comparison = HeadingComparison()

    def _begin(self) -> None:
        session = self._session
        session.on_payload(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, self._position)
        session.on_payload(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, self._quaternion)
        session.on(mavlink.MAVLINK_MSG_ID_SYS_STATUS, self._sys_status)
        session.on(mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, self._highres_imu)
        session.on(mavlink.MAVLINK_MSG_ID_RAW_IMU, self._raw_imu)
        session.on(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, self._gps)

    def _pass_on(self, difference: HeadingDifference | None) -> None:
        if difference is not None:
            for listener in self._listeners:
                listener(difference)

    def _position(self, payload: bytes, t_s: float) -> None:
        _, _, _, _, *velocity = _unpack(_POSITION, payload)
        north, east, down = velocity
        if math.isfinite(north + east + down):
            self._comparison.velocity((north, east, down), t_s)

    def _quaternion(self, payload: bytes, t_s: float) -> None:
        boot_ms, w, x, y, z, roll, pitch, yaw = _unpack(_QUATERNION, payload)[:8]
        length = math.sqrt(w * w + x * x + y * y + z * z)
        if 0.9 < length < 1.1 and math.isfinite(roll + pitch + yaw):
            unit = (w / length, x / length, y / length, z / length)
            boot_s = self._clock.since_boot(boot_ms * 1e-3)
            self._pass_on(self._comparison.attitude(boot_s, unit, (roll, pitch, yaw), t_s))

    def _sys_status(self, message: Any, _t_s: float) -> None:
        enabled = message.onboard_control_sensors_enabled
        health = message.onboard_control_sensors_health
        self._uses_magnetometer = bool(enabled & health & _MAGNETOMETER)

    def _highres_imu(self, message: Any, t_s: float) -> None:
        if message.fields_updated & _FIELD_UPDATED == _FIELD_UPDATED:
            self._magnetic_field(message, t_s)

    def _raw_imu(self, message: Any, t_s: float) -> None:
        self._magnetic_field(message, t_s)

    def _magnetic_field(self, message: Any, t_s: float) -> None:
        field = (float(message.xmag), float(message.ymag), float(message.zmag))
        if self._uses_magnetometer and math.isfinite(sum(field)):
            self._pass_on(self._comparison.magnetic_field(field, t_s))

    def _gps(self, message: Any, t_s: float) -> None:
        if message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
            return
        if message.yaw not in _YAW_UNKNOWN:
            accuracy_rad = math.radians(message.hdg_acc * 1e-5) or None
            heading_rad = math.radians(message.yaw * 0.01)
            self._pass_on(self._comparison.gps_yaw(heading_rad, accuracy_rad, t_s))
        if _UNKNOWN_COURSE not in (message.cog, message.vel):
            course_rad, accuracy_m_s = math.radians(message.cog * 0.01), message.vel_acc * 1e-3
            self._pass_on(
                self._comparison.course(course_rad, message.vel * 0.01, accuracy_m_s or None, t_s)
            )


def _unpack(layout: Struct, payload: bytes) -> tuple[float, ...]:
    """Return a payload's fields, trailing zeros restored."""
    return layout.unpack(payload[: layout.size].ljust(layout.size, b"\0"))
