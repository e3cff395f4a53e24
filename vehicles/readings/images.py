"""Readings of cameras: colour images and depth images."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

Source = Literal["real", "twin", "mixed"]
BgrImage = NDArray[np.uint8]
DepthImage = NDArray[np.float32]
IdImage = NDArray[np.uint8]
Mask = NDArray[np.uint8]
"""(height, width) uint8: 255 is in, 0 is out. One value per pixel, never one per channel."""


@dataclass(frozen=True, slots=True)
class DrawnEffects:
    """What a rendered camera did to a drawn image.

    seed: of the generator of its noise. noise_std_dn, gain, offset_dn: as of CameraQuality.
    streak_px: motion blur, right and down. noise_roll_px: offset in the noise, down and right.
    """

    seed: tuple[int, ...]
    noise_std_dn: float
    gain: float
    offset_dn: float
    streak_px: tuple[float, float]
    noise_roll_px: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Drawing:
    """What an image was drawn of, beside its scene and its lens; drawn again it is the same image.

    camera_pose: FRD axes, NED world. moving: the poses of the scene's moving bodies, in its order.
    effects: of the camera; None for an ideal one.
    """

    camera_pose: Pose
    moving: tuple[Pose, ...] = ()
    effects: DrawnEffects | None = None


@dataclass(frozen=True, slots=True)
class CameraReading:
    """The reading of a camera: an image.

    t_s: middle of the exposure on the run clock. arrived_s: when it was delivered to us.
    seq: counts up by one per exposure of this camera, so that a drop shows.
    image_bgr: (height, width, 3) uint8. depth_m: (height, width) float32, metres along the
    optical axis, inf where nothing is; None when unknown. object_ids: (height, width) uint8,
    0 is background; None when unknown. camera_pose: the pose (FRD axes, NED world) from which
    it was asked to be rendered; None for a live camera. rendered: no live camera took it.
    drawing: what this program drew it of; None for an image from elsewhere, and for an autonomy.
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
    sensor: str = ""
    drawing: Drawing | None = None


@dataclass(frozen=True, slots=True)
class DepthReading:
    """The reading of a stereo or time-of-flight camera: a depth image.

    t_s, arrived_s, seq, intrinsics, camera_pose, rendered: as of a CameraReading.
    depth_m: (height, width) float32, metres along the optical axis; inf where the sensor saw
    nothing. object_ids: (height, width) uint8, 0 is background; None when unknown. mount: the
    camera's pose (FRD axes) in the body's FRD frame.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    depth_m: DepthImage
    intrinsics: Intrinsics
    object_ids: IdImage | None = None
    camera_pose: Pose | None = None
    rendered: bool = True
    sensor: str = ""
    mount: Pose = AT_ORIGIN
