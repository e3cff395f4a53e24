"""Telemetry messages that both autopilots send alike: one function builds each from the state."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.places import (
    FARTHEST_M,
    HIGHEST_M,
    bounded_value,
)
from wil_campaign.worlds.frames import Vec3, quat_conjugate, quat_from_euler, rotate

Builder = Callable[[AutopilotState], Any]
NO_QUATERNION = (math.nan, math.nan, math.nan, math.nan)
_UNKNOWN_VOLTAGE = 65535


def attitude(s: AutopilotState) -> Any:
    """Return the telemetry message ATTITUDE."""
    return mavlink.MAVLink_attitude_message(s.boot_ms, *s.now.euler_rad, *s.now.rates_rad_s)


def attitude_quaternion(s: AutopilotState) -> Any:
    """Return the telemetry message ATTITUDE_QUATERNION."""
    q = quat_from_euler(*s.now.euler_rad)
    return mavlink.MAVLink_attitude_quaternion_message(s.boot_ms, *q, *s.now.rates_rad_s)


def local_position_ned(s: AutopilotState) -> Any:
    """Return the telemetry message LOCAL_POSITION_NED, from the estimator's origin."""
    return mavlink.MAVLink_local_position_ned_message(
        s.boot_ms, *s.now.position_ned_m, *s.now.velocity_ned_m_s
    )


def global_position_int(s: AutopilotState) -> Any:
    """Return the telemetry message GLOBAL_POSITION_INT."""
    here = s.frame.to_geodetic(s.now.position_ned_m)
    north, east, down = s.now.velocity_ned_m_s
    return mavlink.MAVLink_global_position_int_message(
        s.boot_ms,
        round(here.latitude_deg * 1e7),
        round(here.longitude_deg * 1e7),
        round(here.altitude_m * 1e3),
        _int32((s.home_down_m - s.now.position_ned_m[2]) * 1e3),
        _centi(north),
        _centi(east),
        _centi(down),
        _centidegrees(s.now.euler_rad[2]),
    )


def home_position(s: AutopilotState) -> Any | None:
    """Return the telemetry message HOME_POSITION; None before home is known."""
    if s.home_ned_m is None:
        return None
    here = s.frame.to_geodetic(s.home_ned_m)
    return mavlink.MAVLink_home_position_message(
        round(here.latitude_deg * 1e7),
        round(here.longitude_deg * 1e7),
        round(here.altitude_m * 1e3),
        *s.home_ned_m,
        NO_QUATERNION,
        0.0,
        0.0,
        0.0,
        s.boot_us,
    )


def gps_global_origin(s: AutopilotState) -> Any:
    """Return the telemetry message GPS_GLOBAL_ORIGIN."""
    origin = s.frame
    return mavlink.MAVLink_gps_global_origin_message(
        round(origin.latitude_deg * 1e7),
        round(origin.longitude_deg * 1e7),
        round(origin.altitude_m * 1e3),
        s.boot_us,
    )


def system_time(s: AutopilotState) -> Any:
    """Return the telemetry message SYSTEM_TIME; time of day 0 until received."""
    offset_us = s.unix_offset_us
    return mavlink.MAVLink_system_time_message(
        0 if offset_us is None else s.boot_us + offset_us, s.boot_ms
    )


def battery_status(s: AutopilotState) -> Any:
    """Return the telemetry message BATTERY_STATUS, with the pack as one cell, as in SITL."""
    charge = s.charge
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        (round(charge.voltage_v * 1e3), *(_UNKNOWN_VOLTAGE,) * 9),
        round(charge.current_a * 100.0),
        round(charge.consumed_mah),
        -1,
        round(charge.remaining * 100.0),
        0,
        mavlink.MAV_BATTERY_CHARGE_STATE_OK,
    )


def highres_imu(s: AutopilotState) -> Any:
    """Return the telemetry message HIGHRES_IMU: accelerations, rates, pressure."""
    altitude_m = s.frame.altitude_m - s.now.position_ned_m[2]
    return mavlink.MAVLink_highres_imu_message(
        s.boot_us,
        *s.now.specific_force_m_s2,
        *s.now.rates_rad_s,
        *_magnetic_field_gauss(s),
        pressure_hpa(altitude_m),
        0.0,
        altitude_m,
        15.0,
        0b1_1111_1111_1111,
    )


def raw_imu(s: AutopilotState) -> Any:
    """Return the telemetry message RAW_IMU with ArduPilot's scaling: mg, mrad/s, mgauss."""
    force, rates, field = s.now.specific_force_m_s2, s.now.rates_rad_s, _magnetic_field_gauss(s)
    return mavlink.MAVLink_raw_imu_message(
        s.boot_us,
        *(_int16(f / 9.80665 * 1e3) for f in force),
        *(_int16(r * 1e3) for r in rates),
        *(_int16(b * 1e3) for b in field),
        0,
        4500,
    )


def scaled_pressure(s: AutopilotState) -> Any:
    """Return the telemetry message SCALED_PRESSURE."""
    altitude_m = s.frame.altitude_m - s.now.position_ned_m[2]
    return mavlink.MAVLink_scaled_pressure_message(s.boot_ms, pressure_hpa(altitude_m), 0.0, 1500)


def position_target_local_ned(s: AutopilotState) -> Any | None:
    """Return the telemetry message POSITION_TARGET_LOCAL_NED; None if idle."""
    target = s.target
    if target is None:
        return None
    mask, position = 0b111 << 6, []
    for axis, value in enumerate(target.position_ned_m):
        if value is None:
            mask |= 1 << axis
        position.append(value if value is not None else 0.0)
    mask |= 1 << 10 if target.yaw_rad is None else 1 << 11
    return mavlink.MAVLink_position_target_local_ned_message(
        s.boot_ms,
        mavlink.MAV_FRAME_LOCAL_NED,
        mask,
        *(bounded_value(each, FARTHEST_M) for each in position),
        *target.velocity_ned_m_s,
        0.0,
        0.0,
        0.0,
        target.yaw_rad if target.yaw_rad is not None else 0.0,
        target.yaw_rate_rad_s,
    )


def position_target_global_int(s: AutopilotState) -> Any | None:
    """Return the telemetry message POSITION_TARGET_GLOBAL_INT; None without a target position.

    A landing has no altitude to reach: 0, as PX4 sends it.
    """
    target = s.target
    if target is None:
        return None
    north, east, down = target.position_ned_m
    if north is None or east is None:
        return None
    place = s.frame.to_geodetic((north, east, bounded_value(down or 0.0, HIGHEST_M)))
    return mavlink.MAVLink_position_target_global_int_message(
        s.boot_ms,
        mavlink.MAV_FRAME_GLOBAL_INT,
        0,
        round(place.latitude_deg * 1e7),
        round(place.longitude_deg * 1e7),
        place.altitude_m if down is not None else 0.0,
        *target.velocity_ned_m_s,
        0.0,
        0.0,
        0.0,
        target.yaw_rad if target.yaw_rad is not None else math.nan,
        target.yaw_rate_rad_s,
    )


def altitude(s: AutopilotState) -> Any:
    """Return the telemetry message ALTITUDE."""
    up = -s.now.position_ned_m[2]
    amsl = s.frame.altitude_m + up
    return mavlink.MAVLink_altitude_message(
        s.boot_us, amsl, amsl, up, s.home_down_m + up, math.nan, math.nan
    )


def vibration(s: AutopilotState) -> Any:
    """Return the telemetry message VIBRATION: none."""
    return mavlink.MAVLink_vibration_message(s.boot_us, 0.0, 0.0, 0.0, 0, 0, 0)


class SensorMasks(NamedTuple):
    """The sensor masks of telemetry's SYS_STATUS; health without the pre-arm bit."""

    present: int
    enabled: int
    health: int


class LoadReport(NamedTuple):
    """The other telemetry in SYS_STATUS: load in 0.1 %, current in cA, extensions."""

    load: int
    current_ca: int
    health_extended: int


def sys_status(s: AutopilotState, masks: SensorMasks, report: LoadReport, *, prearm: bool) -> Any:
    """Return the telemetry message SYS_STATUS."""
    charge = s.charge
    return mavlink.MAVLink_sys_status_message(
        masks.present,
        masks.enabled,
        masks.health | (mavlink.MAV_SYS_STATUS_PREARM_CHECK if prearm else 0),
        report.load,
        round(charge.voltage_v * 1e3),
        report.current_ca,
        round(charge.remaining * 100.0),
        0, 0, 0, 0, 0, 0, 0, 0, report.health_extended,
    )  # fmt: skip


class TelemetryFix(NamedTuple):
    """The GPS fix in telemetry's GPS_RAW_INT, scaled as in MAVLink."""

    kind: int
    satellites: int
    eph: int
    epv: int
    accuracies: tuple[int, ...]
    """Horizontal and vertical in mm, and of velocity in mm/s where it is given."""


def gps_raw_int(s: AutopilotState, fix: TelemetryFix) -> Any:
    """Return the telemetry message GPS_RAW_INT at the estimate."""
    here = s.frame.to_geodetic(s.now.position_ned_m)
    altitude_mm = round(here.altitude_m * 1e3)
    north_m_s, east_m_s, _ = s.now.velocity_ned_m_s
    course_deg = math.degrees(math.atan2(east_m_s, north_m_s))
    return mavlink.MAVLink_gps_raw_int_message(
        s.boot_us,
        fix.kind,
        round(here.latitude_deg * 1e7),
        round(here.longitude_deg * 1e7),
        altitude_mm,
        fix.eph,
        fix.epv,
        round(ground_speed_m_s(s) * 100.0),
        round(course_deg * 100.0) % 36000,
        fix.satellites,
        altitude_mm,
        *fix.accuracies,
    )


def vfr_hud(s: AutopilotState, throttle: float, *, airspeed_m_s: float) -> Any:
    """Return the telemetry message VFR_HUD; altitude above mean sea level."""
    return mavlink.MAVLink_vfr_hud_message(
        airspeed_m_s,
        ground_speed_m_s(s),
        heading_deg(s),
        round(throttle * 100.0),
        s.frame.altitude_m - s.now.position_ned_m[2],
        -s.now.velocity_ned_m_s[2],
    )


def pressure_hpa(altitude_m: float) -> float:
    """Return the pressure of the standard atmosphere below 11 km (ISO 2533), for telemetry."""
    return float(1013.25 * (1.0 - 2.25577e-5 * altitude_m) ** 5.25588)


def ground_speed_m_s(s: AutopilotState) -> float:
    """Return the horizontal speed for telemetry."""
    return math.hypot(s.now.velocity_ned_m_s[0], s.now.velocity_ned_m_s[1])


def heading_deg(s: AutopilotState) -> int:
    """Return the heading for telemetry in whole degrees, 0 to 359."""
    return round(math.degrees(s.now.euler_rad[2])) % 360


COMMON: dict[int, Builder] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude_quaternion,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: home_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: gps_global_origin,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: battery_status,
    mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE: scaled_pressure,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: position_target_local_ned,
    mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: position_target_global_int,
    mavlink.MAVLINK_MSG_ID_VIBRATION: vibration,
}


def _magnetic_field_gauss(s: AutopilotState) -> Vec3:
    """Return telemetry's magnetic field, body axes: central Europe, 0.21 G north, 0.43 G down."""
    return rotate(quat_conjugate(quat_from_euler(*s.now.euler_rad)), (0.21, 0.0, 0.43))


def _centi(value: float) -> int:
    return _int16(value * 100.0)


def _int32(value: float) -> int:
    return max(-(2**31), min(2**31 - 1, round(value)))


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))


def _centidegrees(angle_rad: float) -> int:
    """Return an angle in hundredths of degrees for telemetry, 0 to 35999."""
    return round(math.degrees(angle_rad) * 100.0) % 36000
