"""Readings: one sensor sample each, frozen, with its time, frame and source.

Every reading has t_s (when it was sampled, run clock), arrived_s (when it was delivered to us),
seq (counts up by one per sample of this sensor, so that a drop shows), source, and sensor: the
name under which its vehicle carries it ("" where nobody said). Arrays in a reading are shared,
never written to after construction.
"""

from wil_campaign.vehicles.readings.images import (
    BgrImage,
    CameraReading,
    DepthImage,
    DepthReading,
    Drawing,
    DrawnEffects,
    IdImage,
    Mask,
    Source,
)
from wil_campaign.vehicles.readings.kinds import (
    Reading,
    reading_end_s,
    reading_types,
    sensor_names,
    sensor_type_of,
)
from wil_campaign.vehicles.readings.navigation import GpsReading, ImuReading, PoseReading
from wil_campaign.vehicles.readings.numbers import NumbersReading
from wil_campaign.vehicles.readings.ranging import (
    LidarPointsReading,
    LidarScanReading,
    ObjectIds,
    Points,
    RangefinderReading,
    Ranges,
)
from wil_campaign.vehicles.readings.sound import MicrophoneReading, samples_from_pressure

__all__ = [
    "BgrImage",
    "CameraReading",
    "DepthImage",
    "DepthReading",
    "Drawing",
    "DrawnEffects",
    "GpsReading",
    "IdImage",
    "ImuReading",
    "LidarPointsReading",
    "LidarScanReading",
    "Mask",
    "MicrophoneReading",
    "NumbersReading",
    "ObjectIds",
    "Points",
    "PoseReading",
    "RangefinderReading",
    "Ranges",
    "Reading",
    "Source",
    "reading_end_s",
    "reading_types",
    "samples_from_pressure",
    "sensor_names",
    "sensor_type_of",
]
