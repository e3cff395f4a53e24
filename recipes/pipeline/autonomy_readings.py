"""What an autonomy gets: readings, and nothing that only a simulator knows."""

from dataclasses import replace

from vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    Reading,
)


def autonomy_reading(reading: Reading, real: Reading, now_s: float, sensor: str) -> Reading:
    """Return a mixture as the autonomy receives it: the real's time, and sensor values only."""
    made = replace(
        reading, t_s=real.t_s, arrived_s=now_s, seq=real.seq, source="mixed", sensor=sensor
    )
    if isinstance(made, CameraReading | DepthReading):
        rendered = isinstance(real, CameraReading | DepthReading) and real.rendered
        made = replace(made, rendered=rendered)
    return without_knowledge(made)


def without_knowledge(reading: Reading) -> Reading:
    """Return an autonomy's reading without the simulator's knowledge: ids, poses, depth.

    Depth beside a picture, ids and the pose that was rendered from are the simulator's knowledge
    of the scene.
    """
    if isinstance(reading, CameraReading):
        return replace(reading, depth_m=None, object_ids=None, camera_pose=None)
    if isinstance(reading, DepthReading):
        return replace(reading, object_ids=None, camera_pose=None)
    if isinstance(reading, LidarScanReading | LidarPointsReading):
        return replace(reading, object_ids=None)
    return reading
