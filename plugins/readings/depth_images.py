"""Depth images of other programs, in their units and layouts, as metres; pure.

Units of ROS by REP 118: 16UC1 in millimetres, where 0 is nothing; 32FC1 in metres, where NaN and
infinity are nothing. sensor_msgs/Image of ROS 1 is serialised by its own rules, little-endian.
"""

import struct
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.vehicles.readings import DepthImage
from wil_campaign.worlds.camera import Intrinsics

_FOCAL_APART = 0.02
"""A factory's focal length and the one of a campaign differ by less: 1 degree of 69."""
_FORMATS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
"""NumPy's format by the encoding of sensor_msgs/Image."""


def metres_of_depths(millimetres: NDArray[Any], scale_m: float = 1e-3) -> DepthImage:
    """Return distances of whole numbers as metres; 0 is infinity. scale_m: of one."""
    depth_m = millimetres.astype(np.float32) * np.float32(scale_m)
    depth_m[millimetres == 0] = np.inf
    return depth_m


def check_depth_camera(
    camera: Intrinsics, *, width_px: int, height_px: int, fx_px: float | None = None
) -> None:
    """Raise BadMessageError for an image that a camera of the campaign cannot have taken.

    fx_px: the sender's focal length; None where it does not tell.
    """
    if (width_px, height_px) != (camera.width_px, camera.height_px):
        raise BadMessageError(
            f"the depth image is {width_px}x{height_px}, and the sensor of the campaign has "
            f"{camera.width_px}x{camera.height_px}: set one to the other"
        )
    if fx_px is not None and abs(fx_px - camera.fx_px) > _FOCAL_APART * camera.fx_px:
        raise BadMessageError(
            f"its focal length is {fx_px:.5g} px, and that of the campaign {camera.fx_px:.5g} px: "
            "give the sensor fx_px, fy_px, cx_px and cy_px of the device"
        )


def ros_depth(message: Any, camera: Intrinsics) -> DepthImage:
    """Return the depth image of a decoded sensor_msgs/Image. Raises BadMessageError, ValueError."""
    width_px, height_px, step = int(message.width), int(message.height), int(message.step)
    check_depth_camera(camera, width_px=width_px, height_px=height_px)
    if (kind := _FORMATS.get(message.encoding)) is None:
        raise BadMessageError(
            f"its encoding is {message.encoding!r:.40}: depth is 16UC1 (millimetres) or 32FC1 "
            "(metres)"
        )
    pixel = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(bytes(message.data), np.uint8)
    if step < width_px * pixel.itemsize or len(rows) != step * height_px:
        raise BadMessageError(f"it has {len(rows)} bytes, in {height_px} rows of {step}")
    used = rows.reshape(height_px, step)[:, : width_px * pixel.itemsize]
    values = np.ascontiguousarray(used).view(pixel)
    if pixel.kind == "u":
        return metres_of_depths(values)
    if np.isnan(values).all():
        raise BadMessageError("all of its distances are NaN")
    # REP 117: -inf is nearer than what is measured.
    depth_m: DepthImage = np.nan_to_num(
        values.astype(np.float32), nan=np.inf, neginf=0.0, posinf=np.inf
    )
    return depth_m


def ros1_image(data: bytes) -> Any:
    """Return the fields of a sensor_msgs/Image of ROS 1. Raises ValueError, struct.error."""
    seconds, nanoseconds, at = *struct.unpack_from("<II", data, 4), 12
    _, at = _counted(data, at)
    height, width = struct.unpack_from("<II", data, at)
    encoding, at = _counted(data, at + 8)
    is_bigendian, step = struct.unpack_from("<BI", data, at)
    pixels, _ = _counted(data, at + 5)
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds)),
        height=height,
        width=width,
        encoding=encoding.decode(),
        is_bigendian=is_bigendian,
        step=step,
        data=pixels,
    )


def _counted(data: bytes, at: int) -> tuple[bytes, int]:
    """Return bytes that follow their number, and their end."""
    (length,) = struct.unpack_from("<I", data, at)
    if (end := at + 4 + length) > len(data):
        raise ValueError(f"it ends {end - len(data)} bytes too early")
    return data[at + 4 : end], end
