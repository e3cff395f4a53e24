"""Readings of 2-D lidars in MAVLink's OBSTACLE_DISTANCE; pure.

https://mavlink.io/en/messages/common.html states its units: centimetres, and degrees.
"""

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.lidar.lidar import ScanPattern
from wil_campaign.plugins.lidar.ranging import require_reach
from wil_campaign.vehicles.readings import LidarScanReading, Ranges, Reading
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


def lidar_reading(
    message: Any,
    times: MessageTimes,
    sensor: MavlinkSensor,
    *,
    heading_rad: float | None,
) -> LidarScanReading:
    """Return the reading in an OBSTACLE_DISTANCE: each beam has the distance of its sector.

    heading_rad: of the vehicle from north, for sectors that count from there; None: unknown.
    Raises UnusableReadingError when a beam is in no sector.
    """
    pattern: ScanPattern = sensor.options.pattern
    width_rad = math.radians(message.increment_f or message.increment)
    first_rad = math.radians(message.angle_offset)
    if message.frame != mavlink.MAV_FRAME_BODY_FRD:
        if heading_rad is None:
            raise UnusableReadingError(
                "its sectors count from north, and the vehicle's heading is not known"
            )
        first_rad -= heading_rad
    low_m, high_m = message.min_distance * CM, message.max_distance * CM
    require_reach(sensor.options, low_m, high_m)
    return LidarScanReading(
        *times.stamps,
        ranges_m=_beam_ranges(message.distances, first_rad, width_rad, pattern, high_m),
        start_angle_rad=pattern.start_angle_rad,
        step_rad=pattern.step_rad,
        range_min_m=low_m,
        range_max_m=high_m,
        mount=sensor.mount,
    )


def _beam_ranges(
    distances_cm: Any, first_rad: float, width_rad: float, pattern: ScanPattern, high_m: float
) -> Ranges:
    """Return the distances of a pattern's beams; inf where a sector is empty or unknown."""
    if not width_rad > 0.0:
        raise UnusableReadingError("its sectors have no width: increment and increment_f are 0")
    count = min(len(distances_cm), round(2.0 * math.pi / width_rad))
    beams_rad = pattern.start_angle_rad + pattern.step_rad * np.arange(pattern.beams)
    # 1e-9 more: a beam on the edge between two sectors belongs to the same one on every machine.
    sectors = np.rint(((beams_rad - first_rad) % (2.0 * math.pi)) / width_rad + 1e-9).astype(int)
    if count * width_rad >= 2.0 * math.pi - width_rad / 2.0:
        sectors %= count
    if (sectors >= count).any():
        raise UnusableReadingError(
            f"{int((sectors >= count).sum())} of {pattern.beams} beams are outside of its {count} "
            f"sectors of {math.degrees(width_rad):g} degrees from "
            f"{math.degrees(first_rad):g}: set fov_deg to the width of the sectors"
        )
    distances = np.asarray(distances_cm[:count])
    if (distances[sectors] == UINT16_MAX).all():
        raise UnusableReadingError("each of its sectors is unknown: its lidar sends nothing")
    empty = (distances == UINT16_MAX) | (distances * CM > high_m)
    ranges = np.where(empty, np.inf, distances * CM).astype(np.float32)
    found: Ranges = ranges[sectors]
    return found


def _reader(sensor: MavlinkSensor, vehicle: HasState) -> Reader:
    def read(message: Any, times: MessageTimes) -> Reading | None:
        local = vehicle.state.local
        heading_rad = None if local is None else local.pose.yaw_rad
        return lidar_reading(message, times, sensor, heading_rad=heading_rad)

    return read


SCANS = MavlinkReading(
    ("OBSTACLE_DISTANCE",),
    _reader,
    {
        "OBSTACLE_DISTANCE": "PX4 sends it when it has range sensors for its collision prevention "
        "(CP_DIST)"
    },
    level="OBSTACLE_DISTANCE has angles from the vehicle's own heading",
)
