"""The traits of images: camera readings, with what a renderer knows of them, and depth images."""

import math
from typing import Any

import cv2
import numpy as np

from wil_campaign.vehicles.readings import CameraReading, DepthReading, Source
from wil_campaign.vehicles.readings.faults import (
    ReadingFault,
    are_reading_numbers_finite,
    array_fault,
    distances_fault,
    object_ids_fault,
)
from wil_campaign.vehicles.readings.image_messages import decode_camera, decode_depth
from wil_campaign.vehicles.readings.traits import ReadingTraits, has_moved_half_a_metre
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, angle_between
from wil_campaign.worlds.geodesy import LocalFrame

_TURNED_RAD = math.radians(20.0)
"""A camera that turns so far has another part of the world in a third of its image."""
_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)
"""The numbers of distortion coefficients that OpenCV accepts."""
_DEPTHS_M = (0.02, 100.0)
"""Of a depth camera: from nearer than any measures to farther than any; millimetres are beyond."""
_VISIBILITY = "wil_campaign.orchestrator.run.perception.visibility"


def intrinsics_fault(intrinsics: Intrinsics) -> ReadingFault | None:
    """Return the fault of a reading's camera model; None when it has none."""
    i = intrinsics
    if i.width_px < 1 or i.height_px < 1:
        return ReadingFault("intrinsics", f"the image size is {i.width_px}x{i.height_px}")
    if not are_reading_numbers_finite((i.fx_px, i.fy_px, i.cx_px, i.cy_px, *i.distortion)):
        return ReadingFault("intrinsics", f"a number is not finite in {i}")
    if i.fx_px <= 0.0 or i.fy_px <= 0.0:
        return ReadingFault("intrinsics", f"focal lengths {i.fx_px}, {i.fy_px} px are not positive")
    if len(i.distortion) not in _DISTORTION_LENGTHS:
        return ReadingFault(
            "intrinsics",
            f"{len(i.distortion)} distortion coefficients; OpenCV takes {_DISTORTION_LENGTHS}",
        )
    return None


def _size(reading: CameraReading | DepthReading) -> tuple[int, int]:
    """Return an image's height and width by its camera."""
    return reading.intrinsics.height_px, reading.intrinsics.width_px


def _size_text(reading: CameraReading | DepthReading) -> str:
    return f"{reading.intrinsics.width_px} x {reading.intrinsics.height_px}"


def _depth_image_fault(depth_m: Any, size: tuple[int, int]) -> ReadingFault | None:
    fault = array_fault(depth_m, size, np.float32, "depth")
    return fault or distances_fault(depth_m, "depth")


def _camera_fault(reading: CameraReading) -> ReadingFault | None:
    """Check a camera reading; return its fault or None."""
    size = _size(reading)
    fault = array_fault(reading.image_bgr, (*size, 3), np.uint8, "image")
    fault = fault or intrinsics_fault(reading.intrinsics)
    if fault is None and reading.depth_m is not None:
        fault = _depth_image_fault(reading.depth_m, size)
    return fault or object_ids_fault(reading.object_ids, size)


def _depth_fault(reading: DepthReading) -> ReadingFault | None:
    """Check a depth reading; return its fault or None."""
    size = _size(reading)
    fault = intrinsics_fault(reading.intrinsics) or _depth_image_fault(reading.depth_m, size)
    return fault or object_ids_fault(reading.object_ids, size)


def _has_moved(reading: Any, since: Pose, now: Pose) -> bool:
    """Return whether a camera moved or turned so far that its images cannot stay the same."""
    has_turned = angle_between(since.q_wxyz, now.q_wxyz) > _TURNED_RAD
    return has_turned or has_moved_half_a_metre(reading, since, now)


def _compared_pixels(reading: CameraReading) -> tuple[object, ...]:
    # To compare bytes ends at the first that differs: cheaper than any digest.
    return (reading.image_bgr.tobytes(),)


def _compared_depth(reading: DepthReading) -> tuple[object, ...]:
    return (reading.depth_m.tobytes(),) if bool((reading.depth_m < math.inf).any()) else ()


def _blank_camera(sensor: Any, side: Source) -> CameraReading:
    size = (sensor.intrinsics.height_px, sensor.intrinsics.width_px)
    image = np.zeros((*size, 3), np.uint8)
    return CameraReading(0.0, 0.0, 0, side, image, sensor.intrinsics, sensor=sensor.name)


def _blank_depth(sensor: Any, side: Source) -> DepthReading:
    size = (sensor.intrinsics.height_px, sensor.intrinsics.width_px)
    depth_m = np.full(size, np.inf, np.float32)
    return DepthReading(0.0, 0.0, 0, side, depth_m, sensor.intrinsics, sensor=sensor.name)


def _depth_rest_fault(reading: DepthReading, _: Pose, __: LocalFrame) -> str | None:
    seen = reading.depth_m[np.isfinite(reading.depth_m)]
    middle_m = float(np.median(seen)) if seen.size else 1.0
    least_m, most_m = _DEPTHS_M
    if least_m <= middle_m <= most_m:
        return None
    return (
        f"half of its distances are {'below' if middle_m < least_m else 'above'} {middle_m:.4g} m: "
        "its unit is wrong (`depth_m` is in metres, and infinity where nothing came back)"
    )


CAMERA_TRAITS = ReadingTraits(
    fault=_camera_fault,
    decode=decode_camera,
    compared=_compared_pixels,
    has_moved=_has_moved,
    blank=_blank_camera,
    size=_size_text,
    elements="image_bgr",
    axes=2,
    overlaid=True,
    ground_truth=("depth_m", "object_ids", "camera_pose", "drawing"),
    is_large=True,
    visibility=f"{_VISIBILITY}:CAMERA",
    quantities={
        "brightness": lambda r: float(np.mean(cv2.mean(r.image_bgr)[:3])),
        "depth_m": lambda r: r.depth_m,
    },
)
DEPTH_TRAITS = ReadingTraits(
    fault=_depth_fault,
    decode=decode_depth,
    compared=_compared_depth,
    has_moved=_has_moved,
    blank=_blank_depth,
    at_rest=_depth_rest_fault,
    size=_size_text,
    elements="depth_m",
    axes=2,
    overlaid=True,
    ground_truth=("object_ids", "camera_pose"),
    is_large=True,
    visibility=f"{_VISIBILITY}:DEPTH",
    quantities={"depth_m": lambda r: r.depth_m, "nearest_m": lambda r: float(r.depth_m.min())},
)
