"""The boot of ArduCopter 4.7 in SITL: its texts, sensor masks and flags by seconds since boot.

All times and texts are from the reference trace.
"""

from wil_campaign.vehicles.embedded.autopilot.flight.telemetry import SensorMasks

INITIALISED_S = 2.42
GPS_S = 9.9
HOME_SET_S = 20.02
PREARM_BIT_S = 23.5
POSITION_S = 41.42

TEXTS: tuple[tuple[float, str], ...] = (
    (1.87, "Barometer 1 calibration complete"),
    (1.87, "Barometer 2 calibration complete"),
    (2.42, "ArduPilot Ready"),
    (2.42, "AHRS: DCM active"),
    (2.72, "RC7: SaveWaypoint LOW"),
    (4.42, "EKF3 IMU0 initialised"),
    (4.42, "EKF3 IMU1 initialised"),
    (4.42, "AHRS: EKF3 active"),
    (5.77, "EKF3 IMU0 tilt alignment complete"),
    (5.77, "EKF3 IMU1 tilt alignment complete"),
    (5.87, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    (5.87, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
    (9.77, "GPS 1: probing for u-blox at 230400 baud"),
    (9.82, "GPS 1: detected u-blox"),
    (20.02, "EKF3 IMU0 origin set"),
    (20.02, "Field Elevation Set: {field_m:.0f}m"),
    (20.17, "EKF3 IMU1 origin set"),
    (41.42, "EKF3 IMU0 is using GPS"),
    (41.57, "EKF3 IMU1 is using GPS"),
)


_SENSORS: tuple[tuple[float, SensorMasks], ...] = (
    (41.45, SensorMasks(1399979055, 1398930479, 1198652463)),
    (22.5, SensorMasks(1399979055, 1382128687, 1198627887)),
    (10.0, SensorMasks(1399979055, 1380031535, 1196530735)),
    (0.0, SensorMasks(1399979023, 1380031503, 1196530703)),
)

_EKF_FLAGS: tuple[tuple[float, int], ...] = (
    (POSITION_S + 0.06, 831),
    (5.87, 167),
    (5.42, 0),
    (0.0, 1024),
)

_GPS: tuple[tuple[float, tuple[int, int]], ...] = (
    (10.1, (6, 10)),
    (GPS_S, (1, 3)),
    (0.0, (0, 0)),
)


def boot_sensor_masks(t_s: float) -> SensorMasks:
    """Return ArduCopter's SYS_STATUS sensor masks at a time since boot."""
    return next(masks for since_s, masks in _SENSORS if t_s >= since_s)


def boot_ekf_flags(t_s: float) -> int:
    """Return ArduCopter's EKF_STATUS_REPORT flags at a time since boot."""
    return next(flags for since_s, flags in _EKF_FLAGS if t_s >= since_s)


def boot_gps_fix(t_s: float) -> tuple[int, int]:
    """Return ArduCopter's (GPS fix type, satellites) at a time since boot."""
    return next(fix for since_s, fix in _GPS if t_s >= since_s)
