"""Telemetry messages that are specific to ArduCopter 4.7, and REQUEST_DATA_STREAM's groups."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.copter import copter_boot as boot
from wil_campaign.plugins.ardupilot.simulated_truth import ArduPilotProjection
from wil_campaign.vehicles.embedded.autopilot.flight import telemetry
from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import (
    AutopilotState,
    EmulatedIdentity,
)
from wil_campaign.worlds.frames import quat_from_euler

_CAPABILITIES = 64495
_FLIGHT_VERSION = 0x04070000
_COMMIT = b"90700977"
_SITL_UID2 = b"3d1219c7c4c5404aa"


def autopilot_version(identity: EmulatedIdentity) -> Any:
    """Return ArduCopter's AUTOPILOT_VERSION; SITL has no uid, uid2 is the machine's."""
    uid2 = _SITL_UID2 if identity.uid2 is None else identity.uid2
    return mavlink.MAVLink_autopilot_version_message(
        _CAPABILITIES,
        _FLIGHT_VERSION,
        0,
        0,
        0,
        tuple(_COMMIT),
        (0,) * 8,
        (0,) * 8,
        0,
        0,
        identity.uid or 0,
        tuple(uid2.ljust(18, b"\0")[:18]),
    )


def sys_status(s: AutopilotState, *, prearm: bool) -> Any:
    """Return ArduCopter's SYS_STATUS telemetry."""
    report = telemetry.LoadReport(0, round(s.charge.current_a * 100.0), 0)
    return telemetry.sys_status(s, boot.boot_sensor_masks(s.clock_s), report, prearm=prearm)


def ekf_status_report(s: AutopilotState) -> Any:
    """Return ArduCopter's EKF_STATUS_REPORT telemetry."""
    return mavlink.MAVLink_ekf_status_report_message(
        boot.boot_ekf_flags(s.clock_s), 0.01, 0.003, 0.001, 0.005, 0.0, 0.0
    )


def gps_raw_int(s: AutopilotState) -> Any:
    """Return ArduCopter's GPS_RAW_INT: no fix for 10 s, then an RTK fix as in SITL."""
    fix, satellites = boot.boot_gps_fix(s.clock_s)
    if fix == 0:
        return mavlink.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, 65535, 65535, 0, 0, 0)
    return telemetry.gps_raw_int(s, telemetry.TelemetryFix(fix, satellites, 121, 200, (300, 300)))


def local_position_ned(s: AutopilotState) -> Any | None:
    """Return ArduCopter's LOCAL_POSITION_NED; None before the estimator uses GPS."""
    return telemetry.local_position_ned(s) if s.clock_s >= boot.POSITION_S else None


def global_position_int(s: AutopilotState) -> Any:
    """Return ArduCopter's GLOBAL_POSITION_INT: zeros before home is set."""
    if s.clock_s < boot.HOME_SET_S:
        return mavlink.MAVLink_global_position_int_message(s.boot_ms, 0, 0, 0, 0, 0, 0, 0, 0)
    return telemetry.global_position_int(s)


def sim_state(s: AutopilotState) -> Any:
    """Return ArduCopter's SIM_STATE, as SIM::sim_state_send fills it.

    Its Location holds whole 1e-7 degrees and centimetres.
    """
    truth = s.truth
    north_m, east_m, down_m = truth.position_ned_m
    projection = ArduPilotProjection(s.frame.latitude_deg, s.frame.longitude_deg)
    latitude_deg, longitude_deg = projection.to_degrees(north_m, east_m)
    altitude_m = int((s.frame.altitude_m - down_m) * 100.0) / 100.0
    return mavlink.MAVLink_sim_state_message(
        *quat_from_euler(*truth.euler_rad),
        *truth.euler_rad,
        *truth.specific_force_m_s2,
        *truth.rates_rad_s,
        latitude_deg,
        longitude_deg,
        altitude_m,
        0.0,
        0.0,
        *truth.velocity_ned_m_s,
        int(latitude_deg * 1e7),
        int(longitude_deg * 1e7),
    )


def timesync(s: AutopilotState) -> Any:
    """Return ArduCopter's TIMESYNC request; it sends one each 10 s."""
    return mavlink.MAVLink_timesync_message(0, s.boot_us * 1000 + 1)


BUILDERS: dict[int, telemetry.Builder] = {
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ekf_status_report,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw_int,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position_ned,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: telemetry.raw_imu,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: timesync,
    mavlink.MAVLINK_MSG_ID_SIM_STATE: sim_state,
}

RATES_HZ: dict[int, float] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: 0.1,
}
"""Without requests, ArduPilot in SITL sends nothing else."""

STREAMS: dict[int, tuple[int, ...]] = {
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (
        mavlink.MAVLINK_MSG_ID_RAW_IMU,
        mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE,
    ),
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_MISSION_CURRENT,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    ),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,
        mavlink.MAVLINK_MSG_ID_BATTERY_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_VIBRATION,
    ),
}
"""The emulated messages of MAV_DATA_STREAM groups (ArduCopter/GCS_MAVLink_Copter.cpp)."""
