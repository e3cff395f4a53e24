"""Encodes and decodes images, depth and ids as bytes, by the name of their encoding; pure.

image: `bgr8`, `rgb8` (height x width x 3 bytes, rows from the top), `jpeg`, `png`.
depth: `f32` (height x width little-endian floats, metres along the optical axis, infinity where
nothing is), `u16_mm` (little-endian millimetres, 0 where nothing is), `png16_mm` (the same).
ids: `u8` (height x width bytes, 0 for the background), `png8`.
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.vehicles.readings import BgrImage, DepthImage, IdImage

Buffer = bytes | memoryview
Size = tuple[int, int]
"""Width and height in pixels."""

IMAGE_ENCODINGS = ("bgr8", "rgb8", "jpeg", "png")
DEPTH_ENCODINGS = ("f32", "u16_mm", "png16_mm")
ID_ENCODINGS = ("u8", "png8")


def decode_image_part(data: Buffer, encoding: str, size: Size) -> BgrImage:
    """Return the image part, (height, width, 3) uint8, a copy. Raises BadMessageError."""
    if encoding in {"bgr8", "rgb8"}:
        image = _raw(data, np.dtype(np.uint8), (size[1], size[0], 3), "image")
        return cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if encoding == "rgb8" else image.copy()
    if encoding in {"jpeg", "png"}:
        return _decode_compressed(data, size, cv2.IMREAD_COLOR, (np.uint8, 3), "image")
    raise _unknown("image", encoding, IMAGE_ENCODINGS)


def decode_depth_part(data: Buffer, encoding: str, size: Size) -> DepthImage:
    """Return the depth part, (height, width) float32 metres. Raises BadMessageError."""
    shape = (size[1], size[0])
    if encoding == "f32":
        depth_m = _raw(data, np.dtype("<f4"), shape, "depth").astype(np.float32)
    elif encoding == "u16_mm":
        depth_m = _metres(_raw(data, np.dtype("<u2"), shape, "depth"))
    elif encoding == "png16_mm":
        flags = cv2.IMREAD_UNCHANGED
        depth_m = _metres(_decode_compressed(data, size, flags, (np.uint16, 1), "depth"))
    else:
        raise _unknown("depth", encoding, DEPTH_ENCODINGS)
    nearest_m = float(depth_m.min())  # NaN wins over every number
    if math.isnan(nearest_m):
        raise BadMessageError(f"depth has {int(np.isnan(depth_m).sum())} values that are NaN")
    if nearest_m < 0.0:
        raise BadMessageError(f"depth has a negative value: {nearest_m} m")
    return depth_m


def decode_ids_part(data: Buffer, encoding: str, size: Size) -> IdImage:
    """Return the object id part, (height, width) uint8. Raises BadMessageError."""
    if encoding == "u8":
        return _raw(data, np.dtype(np.uint8), (size[1], size[0]), "ids").copy()
    if encoding == "png8":
        return _decode_compressed(data, size, cv2.IMREAD_UNCHANGED, (np.uint8, 1), "ids")
    raise _unknown("ids", encoding, ID_ENCODINGS)


def encode_image_part(image_bgr: BgrImage, encoding: str, *, jpeg_quality: int = 90) -> Buffer:
    """Return the message part of an image; `bgr8` shares its memory. Raises ValueError."""
    if encoding == "bgr8":
        return np.ascontiguousarray(image_bgr).data.cast("B")
    if encoding == "jpeg":
        options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
        return _bytes(cv2.imencode(".jpg", image_bgr, options))
    if encoding == "png":
        return _bytes(cv2.imencode(".png", image_bgr))
    raise ValueError(f"image encoding {encoding!r}; choose bgr8, jpeg or png")


def encode_depth_part(depth_m: DepthImage) -> Buffer:
    """Return the message part of a depth image as `f32`."""
    return np.ascontiguousarray(depth_m, "<f4").data.cast("B")


def encode_ids_part(object_ids: IdImage) -> Buffer:
    """Return the message part of object ids as `u8`."""
    return np.ascontiguousarray(object_ids).data.cast("B")


def compressed_size(data: Buffer) -> Size | None:
    """Return the image size that a PNG or JPEG part announces; None when it is neither.

    So that a few bytes that announce a huge image are never decoded. PNG: IHDR is the first chunk.
    JPEG: the first frame header (SOF, ITU-T T.81 B.2.2).
    """
    start = bytes(data[:24])
    if start.startswith(b"\x89PNG\r\n\x1a\n") and len(start) == 24:
        return int.from_bytes(start[16:20], "big"), int.from_bytes(start[20:24], "big")
    return _jpeg_size(data) if start.startswith(b"\xff\xd8") else None


def _bytes(encoded: tuple[bool, NDArray[Any]]) -> Buffer:
    """Return a compressed image part's bytes. Raises ValueError when compression failed."""
    done, data = encoded
    if not done:
        raise ValueError("the image cannot be compressed")
    return data.data.cast("B")


def _jpeg_size(data: Buffer) -> Size | None:
    """Return the image size in a JPEG part's header; None when it has none."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in {0xC4, 0xC8, 0xCC}:
            height, width = (int.from_bytes(data[k : k + 2], "big") for k in (at + 5, at + 7))
            return width, height
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _raw(data: Buffer, dtype: np.dtype[Any], shape: tuple[int, ...], name: str) -> NDArray[Any]:
    """Return an uncompressed image part as an array. Raises BadMessageError for a wrong size."""
    needed = dtype.itemsize * math.prod(shape)
    if len(data) != needed:
        raise BadMessageError(f"{name} has {len(data)} bytes, an array of {shape} has {needed}")
    return np.frombuffer(data, dtype).reshape(shape)


def _decode_compressed(
    data: Buffer, size: Size, flags: int, wanted: tuple[type, int], name: str
) -> NDArray[Any]:
    """Return a PNG or JPEG image part decoded. Raises BadMessageError."""
    announced = compressed_size(data)
    if announced is None:
        raise BadMessageError(f"{name} is neither PNG nor JPEG")
    if announced != size:
        raise BadMessageError(f"{name} is {announced[0]}x{announced[1]}, not {size[0]}x{size[1]}")
    try:
        found: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise BadMessageError(f"{name} cannot be decoded: {error}") from error
    if found is None:
        raise BadMessageError(f"{name} cannot be decoded")
    channels = 1 if found.ndim == 2 else found.shape[2]
    if found.dtype != wanted[0] or channels != wanted[1] or found.shape[:2] != size[::-1]:
        raise BadMessageError(f"{name} has {channels} channels of {found.dtype}")
    return found


def _metres(millimetres: NDArray[Any]) -> DepthImage:
    """Return a depth part's millimetres as metres; 0 becomes infinity."""
    depth_m = millimetres.astype(np.float32) / np.float32(1000.0)
    depth_m[millimetres == 0] = np.inf
    return depth_m


def _unknown(name: str, encoding: str, known: tuple[str, ...]) -> BadMessageError:
    return BadMessageError(f"{name} encoding {encoding!r:.40}; known are {', '.join(known)}")
