"""Telemetry messages that are specific to PX4 1.18, and its rates, from the reference trace."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.map_projections import Px4Projection
from wil_campaign.vehicles.embedded.autopilot.flight import telemetry
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import (
    AutopilotState,
    EmulatedIdentity,
)
from wil_campaign.vehicles.embedded.autopilot.services import discovery
from wil_campaign.worlds.frames import quat_conjugate, quat_from_euler, rotate

_CAPABILITIES = 59647
_FLIGHT_VERSION = 0x01120080
_OS_VERSION = 0x06122CFF
_COMMIT = (0, 0, 0, 128, 229, 244, 196, 131)
_SITL_UID = 0x4954414C44494E4F
_PREARM: int = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_SENSORS = 50380847
_ENABLED = 50446383
_HEALTHY = 320915519 & ~_PREARM
_BEFORE_HEADING = 50364479
_HEADING_S = 3.2


def autopilot_version(identity: EmulatedIdentity) -> Any:
    """Return AUTOPILOT_VERSION of PX4 SITL: its uid is a constant plus the system id minus one."""
    others = identity.system_id - 1
    uid2 = tuple(
        (bytes([others]) if identity.uid2 is None else identity.uid2).ljust(18, b"\0")[:18]
    )
    return mavlink.MAVLink_autopilot_version_message(
        _CAPABILITIES,
        _FLIGHT_VERSION,
        _FLIGHT_VERSION,
        _OS_VERSION,
        1,
        _COMMIT,
        _COMMIT,
        (0,) * 8,
        0,
        0,
        _SITL_UID + others if identity.uid is None else identity.uid,
        uid2,
    )


def sys_status(s: AutopilotState, *, prearm: bool) -> Any:
    """Return PX4's SYS_STATUS telemetry."""
    health = _HEALTHY if s.clock_s >= _HEADING_S else _BEFORE_HEADING
    masks = telemetry.SensorMasks(_SENSORS, _ENABLED, health)
    return telemetry.sys_status(s, masks, telemetry.LoadReport(100, -1, 1), prearm=prearm)


def estimator_status(s: AutopilotState, *, armed: bool, landed_after_flight: bool) -> Any:
    """Return PX4's ESTIMATOR_STATUS: flags by the time since boot and the phase of flight."""
    if s.clock_s < 2.0:
        flags = 164
    elif s.clock_s < _HEADING_S:
        flags = 229
    elif landed_after_flight:
        flags = 831
    else:
        flags = 895 if armed else 1023
    return mavlink.MAVLink_estimator_status_message(
        s.boot_us, flags, 0.04, 0.014, 0.012, 0.1, 0.01, math.nan, 0.3, 0.13
    )


def gps_raw_int(s: AutopilotState) -> Any:
    """Return PX4's GPS_RAW_INT: a 3D fix of 10 satellites from the start."""
    return telemetry.gps_raw_int(s, telemetry.TelemetryFix(3, 10, 70, 110, (900, 1780, 400)))


def global_position_int(s: AutopilotState) -> Any | None:
    """Return PX4's GLOBAL_POSITION_INT, once the estimator has a position."""
    return telemetry.global_position_int(s) if s.clock_s >= _HEADING_S else None


def odometry(s: AutopilotState) -> Any:
    """Return PX4's ODOMETRY: local position, velocity in body axes (frame 1, 1)."""
    q = quat_from_euler(*s.now.euler_rad)
    velocity = rotate(quat_conjugate(q), s.now.velocity_ned_m_s)
    return mavlink.MAVLink_odometry_message(
        s.boot_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,
        *s.now.position_ned_m,
        q,
        *velocity,
        *s.now.rates_rad_s,
        _COVARIANCE,
        _VELOCITY_COVARIANCE,
        4,
        8,
        0,
    )


def hil_state_quaternion(s: AutopilotState) -> Any:
    """Return PX4's HIL_STATE_QUATERNION of its ground truth topics.

    The C++ truncates to integers, and sets neither time nor airspeeds.
    """
    truth = s.truth
    north_m, east_m, down_m = truth.position_ned_m
    projection = Px4Projection(s.frame.latitude_deg, s.frame.longitude_deg)
    latitude_deg, longitude_deg = projection.to_degrees(north_m, east_m)
    return mavlink.MAVLink_hil_state_quaternion_message(
        0,
        quat_from_euler(*truth.euler_rad),
        *truth.rates_rad_s,
        int(latitude_deg * 1e7),
        int(longitude_deg * 1e7),
        int((s.frame.altitude_m - down_m) * 1e3),
        *(max(-32768, min(32767, int(value * 100.0))) for value in truth.velocity_ned_m_s),
        0,
        0,
        0,
        0,
        0,
    )


def timesync(s: AutopilotState) -> Any:
    """Return PX4's TIMESYNC request, which it sends ten times a second."""
    return mavlink.MAVLink_timesync_message(0, s.boot_us * 1000)


def ping(s: AutopilotState) -> Any:
    """Return PX4's broadcast PING, which it sends each second."""
    return mavlink.MAVLink_ping_message(s.boot_us, 0, 0, 0)


def distance_sensor(s: AutopilotState) -> Any:
    """Return PX4's DISTANCE_SENSOR: the height above the start in cm, looking down."""
    height_cm = round(max(0.0, -s.now.position_ned_m[2]) * 100.0)
    return mavlink.MAVLink_distance_sensor_message(
        s.boot_ms,
        0,
        10000,
        min(height_cm, 10000),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        0,
    )


def servo_output_raw(s: AutopilotState) -> Any:
    """Return PX4's SERVO_OUTPUT_RAW: 900 us stopped, 1000 to 2000 us with the thrust."""
    pulses = [
        round(1000.0 + 1000.0 * thrust_n / s.max_thrust_n) if thrust_n > 0.0 else 900
        for thrust_n in s.thrusts
    ]
    return mavlink.MAVLink_servo_output_raw_message(
        s.boot_us & 0xFFFFFFFF, 0, *pulses, 900, 900, 900, 900
    )


_VARIANCES = {0: 0.041, 6: 0.041, 11: 0.083, 15: 3.2e-4, 18: 1.9e-4, 20: 6.0e-3}
"""By index of the diagonal in the upper triangle (x, y, z, roll, pitch, yaw), from the trace in
flight: 0.2 m and 0.08 rad."""
_COVARIANCE = tuple(_VARIANCES.get(index, 0.0) for index in range(21))
_VELOCITY_COVARIANCE = (0.04,) + (0.0,) * 20

BUILDERS: dict[int, telemetry.Builder] = {
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: odometry,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: telemetry.highres_imu,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: telemetry.altitude,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: timesync,
    mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION: hil_state_quaternion,
    mavlink.MAVLINK_MSG_ID_PING: ping,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: distance_sensor,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_output_raw,
}

LEAN_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 20.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 20.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 0.5,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 1.0,
}
"""The streams that a run needs, and little more: each message costs time in virtual time."""

FULL_HZ: dict[int, float] = LEAN_HZ | {
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: 50.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: 50.0,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: 30.0,
    mavlink.MAVLINK_MSG_ID_ALTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 10.0,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: 1.0,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 0.5,
    mavlink.MAVLINK_MSG_ID_PING: 1.0,
    mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: 10.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: 10.0,
    discovery.CURRENT_MODE: 0.5,
}
"""PX4's rates to an onboard computer (mavlink mode onboard), as counted in the trace."""
