"""Distorts the image of a plain pinhole camera as a lens does."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.cameras.rendered_cameras import (
    ImageSource,
    RenderedImage,
    moving_bodies_in_image,
)
from wil_campaign.vehicles.readings import BgrImage, CameraReading, DepthImage, IdImage
from wil_campaign.vehicles.sensors.images import CAMERA_TRAITS
from wil_campaign.vehicles.sensors.sensor_spec import SensorSpec
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

_MARGIN_PX = 2
_MOST_TIMES_WIDER = 4.0
"""A lens whose pinhole image would be more than so many times wider is not rendered."""
_FOLDED_PX = 0.5
_TERMS = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-10)
_ITERATED = getattr(cv2, "undistortPointsIter", None)
"""Of OpenCV 4, whose `undistortPoints` takes no criteria."""

Map = NDArray[np.float32]
Pixel = TypeVar("Pixel", np.uint8, np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class LensMap:
    """The map by which a lens's distorted image comes from a plain one.

    wide: the pinhole camera whose image holds the lens's whole view. u_px, v_px: (height, width)
    float32 each, where in that image each pixel lies.
    """

    wide: Intrinsics
    u_px: Map
    v_px: Map


@dataclass(frozen=True, slots=True)
class LensImage:
    """An image as the lens gives it. moving: as of the image that it comes from."""

    image_bgr: BgrImage
    depth_m: DepthImage | None
    object_ids: IdImage | None
    moving: tuple[Pose, ...] | None = None


class ThroughLens:
    """An ImageSource through a lens: distorts images where the intrinsics ask for it.

    Colours are interpolated linearly; depth, which a lens does not change along the optical axis,
    and ids take the nearest pixel. Raises ValueError for a lens that `lens_fault` refuses.
    """

    def __init__(self, source: ImageSource) -> None:
        self._source = source

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        """Return the lens's image from a camera's pose (FRD axes, world frame) at a time."""
        if not any(intrinsics.distortion):
            plain = replace(intrinsics, distortion=()) if intrinsics.distortion else intrinsics
            return self._source.picture(
                camera_pose, plain, t_s, want_depth=want_depth, want_ids=want_ids
            )
        lens = lens_map(intrinsics)
        pinhole = self._source.picture(
            camera_pose, lens.wide, t_s, want_depth=want_depth, want_ids=want_ids
        )
        return LensImage(
            cv2.remap(pinhole.image_bgr, lens.u_px, lens.v_px, cv2.INTER_LINEAR),
            _nearest(pinhole.depth_m, lens),
            _nearest(pinhole.object_ids, lens),
            moving_bodies_in_image(pinhole),
        )


def _nearest(plane: NDArray[Pixel] | None, lens: LensMap) -> NDArray[Pixel] | None:
    """Return an image plane through the lens by nearest pixels; None for None."""
    if plane is None:
        return None
    seen: NDArray[Pixel] = cv2.remap(plane, lens.u_px, lens.v_px, cv2.INTER_NEAREST)
    return seen


@lru_cache(maxsize=8)
def lens_map(intrinsics: Intrinsics) -> LensMap:
    """Return the lens map from a pinhole of equal focal length to a distorted camera.

    Each pixel's ray by OpenCV's `undistortPoints` (Brown's model, OpenCV manual, camera
    calibration). Raises ValueError for a lens that `lens_fault` refuses.
    """
    fault = lens_fault(intrinsics)
    if fault:
        raise ValueError(fault)
    rays = pixel_rays(_grid(intrinsics, 1), intrinsics)
    left, top = rays.min(axis=0) * (intrinsics.fx_px, intrinsics.fy_px)
    right, bottom = rays.max(axis=0) * (intrinsics.fx_px, intrinsics.fy_px)
    wide = Intrinsics(
        width_px=int(np.ceil(right - left)) + 1 + 2 * _MARGIN_PX,
        height_px=int(np.ceil(bottom - top)) + 1 + 2 * _MARGIN_PX,
        fx_px=intrinsics.fx_px,
        fy_px=intrinsics.fy_px,
        cx_px=float(_MARGIN_PX - left),
        cy_px=float(_MARGIN_PX - top),
    )
    shape = (intrinsics.height_px, intrinsics.width_px)
    u_px = (rays[:, 0] * wide.fx_px + wide.cx_px).astype(np.float32).reshape(shape)
    v_px = (rays[:, 1] * wide.fy_px + wide.cy_px).astype(np.float32).reshape(shape)
    return LensMap(wide, u_px, v_px)


def lens_fault(intrinsics: Intrinsics) -> str:
    """Return why a distortion is not that of a lens; "" when it is."""
    step = max(1, min(intrinsics.width_px, intrinsics.height_px) // 16)
    pixels = _grid(intrinsics, step)
    with np.errstate(all="ignore"):
        rays = pixel_rays(pixels, intrinsics)
        if not np.isfinite(rays).all():
            return "the lens model has no direction at some pixels"
        again, _ = cv2.projectPoints(
            np.concatenate([rays, np.ones((len(rays), 1))], axis=1),
            np.zeros(3),
            np.zeros(3),
            camera_matrix(intrinsics),
            np.array(intrinsics.distortion),
        )
    folded = np.abs(np.asarray(again).reshape(-1, 2) - pixels).max()
    span = rays.max(axis=0) - rays.min(axis=0)
    wider = max(
        span[0] * intrinsics.fx_px / intrinsics.width_px,
        span[1] * intrinsics.fy_px / intrinsics.height_px,
    )
    if not folded <= _FOLDED_PX or not wider <= _MOST_TIMES_WIDER:
        return "the lens model folds over within the image: some pixels have no direction"
    return ""


def _grid(intrinsics: Intrinsics, step: int) -> NDArray[np.float64]:
    """Return pixels (n, 2) to check a lens: every `step`-th, and the last of rows and columns."""
    across = np.union1d(np.arange(0, intrinsics.width_px, step), intrinsics.width_px - 1)
    down = np.union1d(np.arange(0, intrinsics.height_px, step), intrinsics.height_px - 1)
    u, v = np.meshgrid(across.astype(np.float64), down.astype(np.float64))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def pixel_rays(pixels: NDArray[np.float64], camera: Intrinsics) -> NDArray[np.float64]:
    """Return (x/z, y/z) of the rays of pixels (n, 2) through a camera's lens, (n, 2)."""
    if not any(camera.distortion):
        flat = (pixels - (camera.cx_px, camera.cy_px)) / (camera.fx_px, camera.fy_px)
        return np.asarray(flat, np.float64)
    lens, matrix = np.array(camera.distortion), camera_matrix(camera)
    if _ITERATED is None:
        found = cv2.undistortPoints(pixels[:, None, :], matrix, lens, criteria=_TERMS)
    else:
        found = _ITERATED(pixels[:, None, :], matrix, lens, None, None, _TERMS)
    return np.asarray(found, np.float64).reshape(-1, 2)


def camera_matrix(intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Return the 3x3 camera matrix of intrinsics."""
    i = intrinsics
    return np.array([[i.fx_px, 0, i.cx_px], [0, i.fy_px, i.cy_px], [0, 0, 1.0]])


CAMERA = SensorSpec("camera", CameraReading, traits=CAMERA_TRAITS)
