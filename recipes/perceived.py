"""What an autonomy gets of a mixture: the reading, and nothing that only a simulator knows."""

from dataclasses import replace

from vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    Reading,
)


def perceived(reading: Reading, real: Reading, now_s: float) -> Reading:
    """Return the reading as the autonomy gets it: the real's time, and nothing but the values.

    Depth beside a picture, ids and the pose that was rendered from are the simulator's knowledge
    of the scene.
    """
    made = replace(reading, t_s=real.t_s, arrived_s=now_s, seq=real.seq, source="mixed")
    if isinstance(made, CameraReading):
        rendered = isinstance(real, CameraReading) and real.rendered
        return replace(made, depth_m=None, object_ids=None, camera_pose=None, rendered=rendered)
    if isinstance(made, DepthReading):
        rendered = isinstance(real, DepthReading) and real.rendered
        return replace(made, object_ids=None, camera_pose=None, rendered=rendered)
    if isinstance(made, LidarScanReading | LidarPointsReading):
        return replace(made, object_ids=None)
    return made
