"""Convert images from one camera model to another: size, crop, intrinsics, distortion. Pure."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.recipes.working import Masked
from wil_campaign.vehicles.readings import CameraReading, DepthReading
from wil_campaign.vehicles.sensors.lens import camera_matrix, pixel_rays
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import IDENTITY, Quat, matrix_from_quat

ImageReading = CameraReading | DepthReading
Aspect = Literal["fit", "crop", "pad"]
"""How an image comes to a size of another aspect ratio."""
P = TypeVar("P", CameraReading, DepthReading, CameraReading | DepthReading)
Pixel = TypeVar("Pixel", np.uint8, np.float32)
Plane = NDArray[np.float32]

_OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""x right, y down, z forward, of forward, right, down."""


def image_size_px(image: ImageReading) -> tuple[int, int]:
    """Return an image's (width, height) in pixels."""
    return image.intrinsics.width_px, image.intrinsics.height_px


def resized_image(work: Masked[P], width_px: int, height_px: int) -> Masked[P]:
    """Return an image reading scaled to a size in pixels, with its camera intrinsics.

    Colours are averaged over areas when both sides shrink, else interpolated linearly. Depth, ids
    and mask take the nearest pixel, as these have no meaningful mean.
    """
    reading = work.reading
    across, down = image_size_px(reading)
    if (across, down) == (width_px, height_px):
        return work
    size = (width_px, height_px)
    intrinsics = scaled_intrinsics(reading.intrinsics, width_px, height_px)
    ids, mask = scaled_to_nearest(reading.object_ids, size), scaled_to_nearest(work.mask, size)
    if isinstance(reading, DepthReading):
        depth_m = cv2.resize(reading.depth_m, size, interpolation=cv2.INTER_NEAREST_EXACT)
        made = replace(reading, depth_m=depth_m, intrinsics=intrinsics, object_ids=ids)
        return Masked(made, mask)
    kind = cv2.INTER_AREA if width_px <= across and height_px <= down else cv2.INTER_LINEAR
    scaled = replace(
        reading,
        image_bgr=cv2.resize(reading.image_bgr, size, interpolation=kind),
        intrinsics=intrinsics,
        depth_m=scaled_to_nearest(reading.depth_m, size),
        object_ids=ids,
    )
    return Masked(scaled, mask)


def reframed_image(work: Masked[P], width_px: int, height_px: int, aspect: Aspect) -> Masked[P]:
    """Return an image reading at a size of another aspect ratio: scaled, then cut or padded.

    fit: each axis by itself. crop: the size is filled, what is over is cut off at both edges. pad:
    the whole image between black bars, which are infinitely far and not kept.
    """
    across, down = image_size_px(work.reading)
    ratios = width_px / across, height_px / down
    if aspect == "fit" or ratios[0] == ratios[1]:
        return resized_image(work, width_px, height_px)
    scale = max(ratios) if aspect == "crop" else min(ratios)
    scaled = resized_image(work, max(1, round(across * scale)), max(1, round(down * scale)))
    left_px = (image_size_px(scaled.reading)[0] - width_px) // 2
    top_px = (image_size_px(scaled.reading)[1] - height_px) // 2
    if aspect == "crop":
        return cropped_image(scaled, left_px, top_px, width_px, height_px)
    return _padded(scaled, -left_px, -top_px, width_px, height_px)


def _padded(work: Masked[P], left_px: int, top_px: int, width_px: int, height_px: int) -> Masked[P]:
    """Return an image reading with bars around it; left_px, top_px: of its first pixel."""
    reading, old = work.reading, work.reading.intrinsics
    bars = (
        top_px,
        height_px - top_px - old.height_px,
        left_px,
        width_px - left_px - old.width_px,
    )

    def padded(plane: NDArray[Pixel], value: float) -> NDArray[Pixel]:
        made: NDArray[Pixel] = cv2.copyMakeBorder(plane, *bars, cv2.BORDER_CONSTANT, value=value)
        return made

    intrinsics = replace(
        old,
        width_px=width_px,
        height_px=height_px,
        cx_px=old.cx_px + left_px,
        cy_px=old.cy_px + top_px,
    )
    whole = np.full((old.height_px, old.width_px), 255, np.uint8)
    mask = padded(whole if work.mask is None else work.mask, 0)
    ids = None if reading.object_ids is None else padded(reading.object_ids, 0)
    if isinstance(reading, DepthReading):
        depth_m = padded(reading.depth_m, np.inf)
        deep = replace(reading, depth_m=depth_m, intrinsics=intrinsics, object_ids=ids)
        return Masked(deep, mask)
    made = replace(
        reading,
        image_bgr=padded(reading.image_bgr, 0),
        depth_m=None if reading.depth_m is None else padded(reading.depth_m, np.inf),
        object_ids=ids,
        intrinsics=intrinsics,
    )
    return Masked(made, mask)


def scaled_intrinsics(intrinsics: Intrinsics, width_px: int, height_px: int) -> Intrinsics:
    """Return camera intrinsics of the same view at another image size.

    The edges of the image keep their places, at -0.5 and width - 0.5 (pixel (0, 0) is the
    centre of the first pixel): u' = (u + 0.5) width'/width - 0.5. Distortion has no unit.
    """
    across, down = width_px / intrinsics.width_px, height_px / intrinsics.height_px
    return Intrinsics(
        width_px=width_px,
        height_px=height_px,
        fx_px=intrinsics.fx_px * across,
        fy_px=intrinsics.fy_px * down,
        cx_px=(intrinsics.cx_px + 0.5) * across - 0.5,
        cy_px=(intrinsics.cy_px + 0.5) * down - 0.5,
        distortion=intrinsics.distortion,
    )


def scaled_to_nearest(plane: NDArray[Pixel] | None, size: tuple[int, int]) -> NDArray[Pixel] | None:
    """Return an image plane scaled to (width, height) by the nearest pixel; None for None."""
    if plane is None:
        return None
    scaled: NDArray[Pixel] = cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return scaled


def cropped_image(
    work: Masked[P], left_px: int, top_px: int, width_px: int, height_px: int
) -> Masked[P]:
    """Return a crop of an image, sharing its memory; its camera's centre moves with it.

    Raises ValueError when the part does not lie within the image.
    """
    reading, old = work.reading, work.reading.intrinsics
    right_px, bottom_px = left_px + width_px, top_px + height_px
    inside = 0 <= left_px < right_px <= old.width_px and 0 <= top_px < bottom_px <= old.height_px
    if not inside:
        part = f"{width_px} x {height_px} at ({left_px}, {top_px})"
        raise ValueError(f"{part} does not lie within {old.width_px} x {old.height_px}")
    rows, columns = slice(top_px, bottom_px), slice(left_px, right_px)
    intrinsics = replace(
        old,
        width_px=width_px,
        height_px=height_px,
        cx_px=old.cx_px - left_px,
        cy_px=old.cy_px - top_px,
    )

    def part_of(plane: NDArray[Pixel] | None) -> NDArray[Pixel] | None:
        return None if plane is None else plane[rows, columns]

    ids, mask = part_of(reading.object_ids), part_of(work.mask)
    if isinstance(reading, DepthReading):
        depth_m = reading.depth_m[rows, columns]
        return Masked(
            replace(reading, depth_m=depth_m, intrinsics=intrinsics, object_ids=ids), mask
        )
    made = replace(
        reading,
        image_bgr=reading.image_bgr[rows, columns],
        depth_m=part_of(reading.depth_m),
        object_ids=ids,
        intrinsics=intrinsics,
    )
    return Masked(made, mask)


@dataclass(frozen=True, slots=True)
class ImageRemap:
    """An image remapping: the place of each new pixel in the old image, (height, width) float32.

    seen: (height, width) uint8, 255 where the old camera saw it. z_ratio: depth along the new
    optical axis over that along the old one; None without a rotation.
    """

    u_px: Plane
    v_px: Plane
    seen: NDArray[np.uint8]
    z_ratio: Plane | None


@lru_cache(maxsize=8)
def remap_between(old: Intrinsics, new: Intrinsics, turn: Quat = IDENTITY) -> ImageRemap:
    """Return the pixel map from one camera's image to another camera's at the same place.

    turn: attitude of the new camera in the old one's FRD frame. Each pixel of the new image is
    undistorted to a ray with the new model, turned, and projected with the old model; exact up to
    OpenCV's iteration (`undistortPoints`, Brown's model as in the OpenCV manual).
    """
    v, u = np.mgrid[0 : new.height_px, 0 : new.width_px].astype(np.float64)
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    flat = pixel_rays(pixels, new)
    rays = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
    ahead = _is_reached(rays, pixels, new)
    z_ratio: Plane | None = None
    if turn != IDENTITY:
        rotation = _OPTICAL_FROM_FRD @ matrix_from_quat(turn) @ _OPTICAL_FROM_FRD.T
        rays = rays @ rotation.T
        with np.errstate(divide="ignore"):
            ratio = np.where(rays[:, 2] > 1e-6, 1.0 / rays[:, 2], 1.0)
        z_ratio = ratio.reshape(v.shape).astype(np.float32)
    ahead &= rays[:, 2] > 1e-6
    rays[~ahead] = (0.0, 0.0, 1.0)
    old_px = _project(rays, old)
    inside = (
        ahead
        & (old_px[:, 0] >= -0.5)
        & (old_px[:, 0] <= old.width_px - 0.5)
        & (old_px[:, 1] >= -0.5)
        & (old_px[:, 1] <= old.height_px - 0.5)
        & _invertible(rays, old)
    )
    old_px[~inside] = -10.0
    shape = v.shape
    return ImageRemap(
        np.ascontiguousarray(old_px[:, 0].reshape(shape), np.float32),
        np.ascontiguousarray(old_px[:, 1].reshape(shape), np.float32),
        np.where(inside, 255, 0).astype(np.uint8).reshape(shape),
        z_ratio,
    )


def _project(rays: NDArray[np.float64], camera: Intrinsics) -> NDArray[np.float64]:
    """Return the pixels of rays through a camera's lens, (n, 2)."""
    lens = np.array(camera.distortion) if camera.distortion else np.zeros(4)
    pixels, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera_matrix(camera), lens)
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def _invertible(rays: NDArray[np.float64], camera: Intrinsics) -> NDArray[np.bool_]:
    """Return the rays for which a lens's distortion polynomial increases outwards.

    Beyond its turning point the polynomial folds back, and rays from far outside of the view
    would be projected into the image.
    """
    if not any(camera.distortion):
        return np.ones(len(rays), np.bool_)
    k = [*camera.distortion, *([0.0] * 8)]
    r2 = (rays[:, 0] ** 2 + rays[:, 1] ** 2) / rays[:, 2] ** 2
    radial = np.linspace(0.0, float(np.sqrt(r2.max())) + 1e-9, 2000)
    q = radial**2
    upper = 1 + k[0] * q + k[1] * q**2 + k[4] * q**3
    lower = 1 + k[5] * q + k[6] * q**2 + k[7] * q**3
    folded = np.flatnonzero(np.diff(radial * upper / lower) <= 0.0)
    limit = radial[folded[0]] if len(folded) else np.inf
    return np.asarray(r2 <= limit**2, np.bool_)


def _is_reached(
    rays: NDArray[np.float64], pixels: NDArray[np.float64], camera: Intrinsics
) -> NDArray[np.bool_]:
    """Return the pixels, (n, 2), to which their undistorted rays come through a camera's lens.

    To those beyond the turning point of its distortion polynomial no ray comes.
    """
    if not any(camera.distortion):
        return np.ones(len(rays), np.bool_)
    missed_px = np.abs(_project(rays, camera) - pixels).max(axis=1)
    return np.asarray((missed_px < 0.5) & _invertible(rays, camera), np.bool_)


def remapped_image(work: Masked[P], new: Intrinsics, turn: Quat = IDENTITY) -> Masked[P]:
    """Return the image of a camera with other optics, turned by `turn`, from the same place.

    Pixels that the old camera did not see are black, infinitely far, and not kept. Colours are
    interpolated linearly; depth, ids and mask take the nearest pixel.
    """
    reading = work.reading
    if reading.intrinsics == new and turn == IDENTITY:
        return work
    maps = remap_between(reading.intrinsics, new, turn)
    ids = _move_pixels(reading.object_ids, maps, 0)
    mask = maps.seen.copy() if work.mask is None else _move_pixels(work.mask, maps, 0)
    if isinstance(reading, DepthReading):
        depth_m = _move_depth(reading.depth_m, maps)
        made = replace(reading, depth_m=depth_m, intrinsics=new, object_ids=ids)
        return Masked(made, mask)
    image = cv2.remap(
        reading.image_bgr, maps.u_px, maps.v_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    image[maps.seen == 0] = 0
    depth = None if reading.depth_m is None else _move_depth(reading.depth_m, maps)
    moved = replace(reading, image_bgr=image, depth_m=depth, object_ids=ids, intrinsics=new)
    return Masked(moved, mask)


def _move_pixels(
    plane: NDArray[Pixel] | None, maps: ImageRemap, outside: float
) -> NDArray[Pixel] | None:
    """Return an image plane remapped to another camera; None for None."""
    if plane is None:
        return None
    found: NDArray[Pixel] = cv2.remap(
        plane,
        maps.u_px,
        maps.v_px,
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=outside,
    )
    found[maps.seen == 0] = outside
    return found


def _move_depth(depth_m: NDArray[np.float32], maps: ImageRemap) -> NDArray[np.float32]:
    """Return a depth image remapped to another camera, along its own optical axis."""
    moved = _move_pixels(depth_m, maps, np.inf)
    assert moved is not None  # noqa: S101 - only None gives None
    if maps.z_ratio is not None:
        moved = moved * maps.z_ratio
    return moved


def camera_disagreement_px(a: Intrinsics, b: Intrinsics) -> float:
    """Return the distance between the images of a corner's ray in two cameras of one size, pixels.

    Different distortion counts as infinite: only `camera_model` corrects it.
    """
    if a == b:
        return 0.0
    if _coefficients(a) != _coefficients(b):
        return float("inf")
    across = [abs((u - a.cx_px) / a.fx_px * b.fx_px + b.cx_px - u) for u in (0.0, a.width_px - 1.0)]
    down = [abs((v - a.cy_px) / a.fy_px * b.fy_px + b.cy_px - v) for v in (0.0, a.height_px - 1.0)]
    return math.hypot(max(across), max(down))


def _coefficients(camera: Intrinsics) -> tuple[float, ...]:
    """Return the distortion of a camera up to its last coefficient that is not 0."""
    last = max((index for index, value in enumerate(camera.distortion, 1) if value), default=0)
    return camera.distortion[:last]
