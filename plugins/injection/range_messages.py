"""Encodes readings of lidar and rangefinder as MAVLink messages for an autopilot; pure.

Time stamps are of the run clock, in microseconds or milliseconds: the autopilot maps them by
TIMESYNC (PX4) or by their arrival (ArduPilot), so they need no common epoch.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.readings import LidarScanReading, RangefinderReading
from wil_campaign.worlds.frames import Pose, matrix_from_quat, rotate

SECTORS = 72
SECTOR_DEG = 5.0
UNKNOWN_CM = 65_535
LONGEST_CM = 65_533
"""Largest range: one more means no obstacle, and has to stay below UINT16_MAX, unknown."""
_HALF_SECTOR_RAD = math.radians(22.5)
SENSOR_ID = 1


def obstacle_distance(scan: LidarScanReading) -> Any:
    """Return a scan as OBSTACLE_DISTANCE (330): 72 sectors of 5 degrees around the body.

    Frame BODY_FRD, which ArduPilot assumes for any frame; sector k is centred 5 k degrees to the
    right of forward. Distances are horizontal, from the body's origin, in centimetres: the nearest
    of each sector, max + 1 where beams met nothing, 65535 without a beam or with a NaN range.
    """
    max_cm = _centimetres(scan.range_max_m)
    directions, distances_m = _around_body(scan)
    beams_cm = np.minimum(np.rint(distances_m * 100.0), max_cm + 1).astype(np.int64)
    sectors = np.rint(np.degrees(directions) / SECTOR_DEG).astype(np.int64) % SECTORS
    nearest_cm = np.full(SECTORS, UNKNOWN_CM, np.int64)
    np.minimum.at(nearest_cm, sectors, beams_cm)
    return mavlink.MAVLink_obstacle_distance_message(
        time_usec=message_microseconds(scan.t_s),
        sensor_type=mavlink.MAV_DISTANCE_SENSOR_LASER,
        distances=nearest_cm.tolist(),
        increment=int(SECTOR_DEG),
        min_distance=_centimetres(scan.range_min_m),
        max_distance=max_cm,
        increment_f=SECTOR_DEG,
        angle_offset=0.0,
        frame=mavlink.MAV_FRAME_BODY_FRD,
    )


def nothing_measured(mount: Pose | None, t_s: float) -> Any:
    """Return the message of a sensor that has measured nothing yet.

    mount: of a rangefinder, whose DISTANCE_SENSOR says that nothing came back; None for a lidar,
    whose OBSTACLE_DISTANCE has 72 unknown sectors.
    """
    longest_m = LONGEST_CM / 100.0
    if mount is not None:
        reading = RangefinderReading(
            t_s=t_s,
            arrived_s=t_s,
            seq=0,
            source="mixed",
            range_m=math.inf,
            range_min_m=0.0,
            range_max_m=longest_m,
            mount=mount,
        )
        return distance_sensor_message(reading)
    scan = LidarScanReading(
        t_s=t_s,
        arrived_s=t_s,
        seq=0,
        source="mixed",
        ranges_m=np.empty(0, np.float32),
        start_angle_rad=0.0,
        step_rad=0.0,
        range_min_m=0.0,
        range_max_m=longest_m,
    )
    return obstacle_distance(scan)


def distance_sensor_message(reading: RangefinderReading, *, field_of_view_rad: float = 0.0) -> Any:
    """Return a rangefinder's sample as DISTANCE_SENSOR (132), in centimetres.

    The direction of the mount becomes one of MAVLink's orientations: the nearest of eight to the
    sides, up or down; else CUSTOM with the mount's attitude, which ArduPilot ignores. A beam that
    met nothing is max + 1. Raises ValueError for a NaN range.
    """
    if math.isnan(reading.range_m):
        raise ValueError("the rangefinder's range is NaN")
    max_cm = _centimetres(reading.range_max_m)
    is_free = not reading.range_m <= reading.range_max_m
    orientation = sensor_orientation(reading.mount)
    quaternion = reading.mount.q_wxyz
    is_custom = orientation == mavlink.MAV_SENSOR_ROTATION_CUSTOM
    return mavlink.MAVLink_distance_sensor_message(
        time_boot_ms=message_milliseconds(reading.t_s),
        min_distance=_centimetres(reading.range_min_m),
        max_distance=max_cm,
        current_distance=max_cm + 1 if is_free else _centimetres(reading.range_m),
        type=mavlink.MAV_DISTANCE_SENSOR_LASER,
        id=SENSOR_ID,
        orientation=orientation,
        covariance=255,
        horizontal_fov=field_of_view_rad,
        vertical_fov=field_of_view_rad,
        quaternion=quaternion if is_custom else (0.0, 0.0, 0.0, 0.0),
        signal_quality=0,
    )


def sensor_orientation(mount: Pose) -> int:
    """Return a range sensor's MAV_SENSOR_ORIENTATION: along its mount's x axis."""
    forward, right, down = rotate(mount.q_wxyz, (1.0, 0.0, 0.0))
    elevation_rad = math.asin(max(-1.0, min(1.0, -down)))
    if elevation_rad <= -math.pi / 2 + _HALF_SECTOR_RAD:
        return int(mavlink.MAV_SENSOR_ROTATION_PITCH_270)
    if elevation_rad >= math.pi / 2 - _HALF_SECTOR_RAD:
        return int(mavlink.MAV_SENSOR_ROTATION_PITCH_90)
    if abs(elevation_rad) <= _HALF_SECTOR_RAD:
        # ROTATION_NONE to ROTATION_YAW_315 are 0 to 7, clockwise.
        return round(math.atan2(right, forward) / math.radians(45.0)) % 8
    return int(mavlink.MAV_SENSOR_ROTATION_CUSTOM)


def message_microseconds(t_s: float) -> int:
    """Return a run-clock time as a range message's time_usec."""
    return max(0, round(t_s * 1e6))


def message_milliseconds(t_s: float) -> int:
    """Return a run-clock time as a range message's time_boot_ms."""
    return max(0, round(t_s * 1e3)) & 0xFFFFFFFF


def _centimetres(distance_m: float) -> int:
    return min(LONGEST_CM, max(0, round(distance_m * 100.0)))


def _around_body(
    scan: LidarScanReading,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each beam's direction (radians right of forward) and range from the body."""
    known = ~np.isnan(scan.ranges_m)
    angles, ranges_m = scan.angles_rad[known], scan.ranges_m[known].astype(np.float64)
    beams = np.stack((np.cos(angles), np.sin(angles), np.zeros_like(angles)))
    beams = matrix_from_quat(scan.mount.q_wxyz) @ beams
    met = np.isfinite(ranges_m)
    offset = np.array(scan.mount.position_ned_m[:2])[:, np.newaxis]
    points = beams[:2] * np.where(met, ranges_m, 0.0) + offset
    horizontal_m = np.where(met, np.hypot(points[0], points[1]), np.inf)
    # Where a beam met nothing, its own direction gives the sector.
    x, y = np.where(met & (horizontal_m > 0.0), points, beams[:2])
    return np.arctan2(y, x), horizontal_m
