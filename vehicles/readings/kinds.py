"""All kinds of readings, and the sensor types by which recipes and campaigns name them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

from wil_campaign.vehicles.readings.images import CameraReading, DepthReading
from wil_campaign.vehicles.readings.navigation import GpsReading, ImuReading, PoseReading
from wil_campaign.vehicles.readings.ranging import (
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
)
from wil_campaign.vehicles.readings.sound import MicrophoneReading

Reading = (
    CameraReading
    | DepthReading
    | LidarScanReading
    | LidarPointsReading
    | RangefinderReading
    | GpsReading
    | PoseReading
    | ImuReading
    | MicrophoneReading
)

SensorType = Literal[
    "camera",
    "depth",
    "lidar",
    "lidar_points",
    "rangefinder",
    "gps",
    "pose",
    "imu",
    "microphone",
]
"""Sensor type as files name it."""

SENSOR_TYPES: Mapping[str, type[Reading]] = MappingProxyType(
    {
        "camera": CameraReading,
        "depth": DepthReading,
        "lidar": LidarScanReading,
        "lidar_points": LidarPointsReading,
        "rangefinder": RangefinderReading,
        "gps": GpsReading,
        "pose": PoseReading,
        "imu": ImuReading,
        "microphone": MicrophoneReading,
    }
)
"""Sensor type as files name it, to the class of its readings."""

_NAMES: Mapping[type[Reading], str] = MappingProxyType(
    {kind: name for name, kind in SENSOR_TYPES.items()}
)


def sensor_type_of(reading: Reading) -> str:
    """Return the sensor type that gives this kind of reading."""
    return _NAMES[type(reading)]


def end_s(reading: Reading) -> float:
    """Return when a reading ends: a block of sound after its last sample, any other at its time."""
    length_s = reading.duration_s if isinstance(reading, MicrophoneReading) else 0.0
    return reading.t_s + length_s
