"""Readings as an autonomy receives them, without the simulator's ground truth."""

from dataclasses import replace

from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    Reading,
)


def autonomy_reading(reading: Reading, real: Reading, now_s: float, sensor: str) -> Reading:
    """Return a mixture as the autonomy receives it: the real's time, and sensor values only.

    Mixed sound keeps the time of its first sample.
    """
    t_s = reading.t_s if isinstance(reading, MicrophoneReading) else real.t_s
    mixed = replace(reading, t_s=t_s, arrived_s=now_s, seq=real.seq, source="mixed", sensor=sensor)
    if isinstance(mixed, CameraReading | DepthReading):
        rendered = isinstance(real, CameraReading | DepthReading) and real.rendered
        mixed = replace(mixed, rendered=rendered)
    return without_ground_truth(mixed)


def without_ground_truth(reading: Reading) -> Reading:
    """Return an autonomy's reading without the simulator's ground truth of the scene.

    That is the depth of a camera image, object ids, the pose of the rendering camera, and what
    it drew.
    """
    if isinstance(reading, CameraReading):
        return replace(reading, depth_m=None, object_ids=None, camera_pose=None, drawing=None)
    if isinstance(reading, DepthReading):
        return replace(reading, object_ids=None, camera_pose=None)
    if isinstance(reading, LidarScanReading | LidarPointsReading):
        return replace(reading, object_ids=None)
    return reading
