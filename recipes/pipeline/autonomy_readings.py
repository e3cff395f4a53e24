"""Readings as an autonomy receives them, without the simulator's ground truth."""

from dataclasses import replace
from typing import Any

from wil_campaign.vehicles.readings import CameraReading, DepthReading, Reading
from wil_campaign.vehicles.readings.kinds import traits_of


def autonomy_reading(reading: Reading, real: Reading, now_s: float, sensor: str) -> Reading:
    """Return a mixture as the autonomy receives it: the real's time, and sensor values only.

    A mixture that lasts, as sound, keeps the time of its first sample.
    """
    t_s = real.t_s if traits_of(type(reading)).line is None else reading.t_s
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
    unknown: Any = dict.fromkeys(traits_of(type(reading)).ground_truth)
    return replace(reading, **unknown) if unknown else reading
