"""Readings of ranging sensors: lidar scans, lidar points, and a rangefinder's single beam."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings.images import Source
from wil_campaign.worlds.frames import Pose

AT_BODY = Pose((0.0, 0.0, 0.0))
"""A sensor in the body's origin that looks along the body's axes."""

Ranges = NDArray[np.float32]
Points = NDArray[np.float32]
ObjectIds = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class LidarScanReading:
    """A ranging reading: one turn of a 2-D lidar, in the sensor's forward-right plane.

    t_s: middle of the turn on the run clock. ranges_m: (beams,) float32, metres from the
    sensor; inf where nothing came back. Beam i looks at start_angle_rad + i * step_rad,
    measured from forward to the right (clockwise seen from above, the FRD sense).
    object_ids: (beams,) uint8, 0 for no object; None when unknown. mount: the sensor's pose in
    the body's FRD frame.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    ranges_m: Ranges
    start_angle_rad: float
    step_rad: float
    range_min_m: float
    range_max_m: float
    object_ids: ObjectIds | None = None
    mount: Pose = AT_BODY
    sensor: str = ""

    @property
    def angles_rad(self) -> NDArray[np.float64]:
        """Return the direction of each beam of the scan, (beams,)."""
        beams = np.arange(len(self.ranges_m), dtype=np.float64)
        return beams * self.step_rad + self.start_angle_rad


@dataclass(frozen=True, slots=True)
class LidarPointsReading:
    """A ranging reading: the points of one frame of a 3-D lidar, without missing beams.

    t_s: middle of the frame on the run clock. points_frd_m: (points, 3) float32, metres
    forward, right, down in the sensor's frame. object_ids: (points,) uint8, 0 for no object;
    None when unknown. mount: the sensor's pose in the body's FRD frame.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    points_frd_m: Points
    object_ids: ObjectIds | None = None
    mount: Pose = AT_BODY
    sensor: str = ""


@dataclass(frozen=True, slots=True)
class RangefinderReading:
    """A ranging reading: the distance along one beam.

    range_m: metres along the sensor's forward axis; inf when nothing came back. mount: the
    sensor's pose in the body's FRD frame, its forward axis along the beam.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    range_m: float
    range_min_m: float
    range_max_m: float
    mount: Pose = AT_BODY
    sensor: str = ""
