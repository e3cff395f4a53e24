"""Readings: one sensor sample each, frozen, with its time, frame and source.

Arrays in a reading are shared, never written to after construction.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3

Source = Literal["real", "twin", "mixed"]
BgrImage = NDArray[np.uint8]
DepthImage = NDArray[np.float32]
IdImage = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class CameraReading:
    """A picture.

    t_s: middle of the exposure on the run clock. arrived_s: when it was delivered to us.
    seq: counts up by one per exposure of this camera, so that a drop shows.
    image_bgr: (height, width, 3) uint8. depth_m: (height, width) float32, metres along the
    optical axis, inf where nothing is; None when unknown. object_ids: (height, width) uint8,
    0 is background; None when unknown. camera_pose: the pose (FRD axes, NED world) from which
    it was asked to be rendered; None for a live camera. rendered: no live camera took it.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    image_bgr: BgrImage
    intrinsics: Intrinsics
    depth_m: DepthImage | None = None
    object_ids: IdImage | None = None
    camera_pose: Pose | None = None
    rendered: bool = True


@dataclass(frozen=True, slots=True)
class PoseReading:
    """A vehicle's pose in the world's local frame (NED metres), from motion capture or MAVLink."""

    t_s: float
    arrived_s: float
    source: Source
    pose: Pose
    velocity_ned_m_s: Vec3 | None = None


Reading = CameraReading | PoseReading
