"""Reads image files, after a check of the size that their headers state.

Supported are PNG, JPEG, BMP, TIFF, WebP and PNM, which OpenCV decodes; of meshes also TGA.
"""

import re
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.foundation.files.lfs import LFS_POINTER, is_lfs_pointer
from wil_campaign.foundation.files.limits import MAX_IMAGE_BYTES, MAX_IMAGE_PIXELS
from wil_campaign.foundation.files.paths import is_file

Size = tuple[int, int]
"""Width and height, in pixels."""

_PNM = re.compile(rb"P[1-6](?:\s+|#[^\n]*\n)+(\d{1,9})(?:\s+|#[^\n]*\n)+(\d{1,9})\s")
_PNM_HEAD_BYTES = 4096


class ImageError(ValueError):
    """An image file that is of an unsupported kind, damaged or too large; says why."""


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any]:
    """Return the pixels of a file, as cv2.imread does with these flags.

    Raises ImageError; OSError when the file cannot be read.
    """
    return decode_image_file(read_image_bytes(path), flags)


def read_image_bytes(path: Path) -> bytes:
    """Return the bytes of an image file. Raises ImageError, OSError."""
    if not is_file(path):
        raise ImageError("there is no such file")
    if path.stat().st_size > MAX_IMAGE_BYTES:
        raise ImageError(f"it is larger than {MAX_IMAGE_BYTES} bytes")
    return path.read_bytes()


def decode_image_file(data: bytes, flags: int = cv2.IMREAD_COLOR) -> NDArray[Any]:
    """Return the pixels of an image file's bytes. Raises ImageError."""
    if len(data) > MAX_IMAGE_BYTES:
        raise ImageError(f"it is larger than {MAX_IMAGE_BYTES} bytes")
    size = image_size(data)
    if size is None and is_lfs_pointer(data):
        raise ImageError(LFS_POINTER)
    if size is None:
        raise ImageError("not a PNG, JPEG, BMP, TIFF, WebP or PNM image")
    check_image_size(*size)
    try:
        image: NDArray[Any] | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ImageError("it is damaged") from error
    if image is None:
        raise ImageError("it is damaged")
    return image


def read_tga(path: Path) -> NDArray[np.uint8]:
    """Return the pixels of a TGA file, (height, width, 4), BGR and alpha.

    Such a file does not begin with a mark of its own: its name says what it is. Raises ImageError;
    OSError when the file cannot be read.
    """
    # Only meshes have such images.
    from PIL import Image  # noqa: PLC0415

    try:
        with Image.open(path, formats=["TGA"]) as image:
            check_image_size(*image.size)
            rgba = np.asarray(image.convert("RGBA"))
    except (ValueError, SyntaxError, IndexError, struct.error) as error:
        raise error if isinstance(error, ImageError) else ImageError("it is damaged") from error
    return rgba[:, :, [2, 1, 0, 3]]


def check_image_size(width_px: int, height_px: int) -> None:
    """Raise ImageError for an image that is too large to be decoded."""
    if width_px * height_px > MAX_IMAGE_PIXELS:
        raise ImageError(
            f"it is {width_px} x {height_px} px; at most {MAX_IMAGE_PIXELS} pixels are decoded"
        )


def image_size(data: bytes) -> Size | None:
    """Return the size that an image's header states; None for an unsupported kind."""
    for magic, size in _KINDS:
        if data.startswith(magic):
            try:
                return size(data)
            except (struct.error, IndexError, ValueError):
                return None
    return None


def _png(data: bytes) -> Size:
    width, height = struct.unpack_from(">II", data, 16)
    return width, height


def _jpeg(data: bytes) -> Size | None:
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in {0xC4, 0xC8, 0xCC}:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return width, height
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _bmp(data: bytes) -> Size:
    if struct.unpack_from("<I", data, 14)[0] == 12:
        width, height = struct.unpack_from("<HH", data, 18)
    else:
        width, height = struct.unpack_from("<ii", data, 18)
    return abs(width), abs(height)


def _webp(data: bytes) -> Size | None:
    kind = data[12:16]
    if data[8:12] != b"WEBP":
        return None
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (packed,) = struct.unpack_from("<I", data, 21)
        return (packed & 0x3FFF) + 1, (packed >> 14 & 0x3FFF) + 1
    if kind == b"VP8X":
        return (
            int.from_bytes(data[24:27], "little") + 1,
            int.from_bytes(data[27:30], "little") + 1,
        )
    return None


def _tiff(data: bytes) -> Size | None:
    """Return the largest size of all directories: the decoder chooses one of them."""
    order = "<" if data[:2] == b"II" else ">"
    found: list[Size] = []
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    seen: set[int] = set()
    while at and at not in seen:
        seen.add(at)
        (count,) = struct.unpack_from(f"{order}H", data, at)
        sides = {256: 0, 257: 0}
        for entry in range(at + 2, at + 2 + 12 * count, 12):
            tag, kind = struct.unpack_from(f"{order}HH", data, entry)
            if tag in sides:
                form = "H" if kind == 3 else "I"
                (sides[tag],) = struct.unpack_from(f"{order}{form}", data, entry + 8)
        found.append((sides[256], sides[257]))
        (at,) = struct.unpack_from(f"{order}I", data, at + 2 + 12 * count)
    return max(found, key=lambda size: size[0] * size[1], default=None)


def _pnm(data: bytes) -> Size | None:
    found = _PNM.match(data[:_PNM_HEAD_BYTES])
    return None if found is None else (int(found[1]), int(found[2]))


_KINDS: tuple[tuple[bytes, Callable[[bytes], Size | None]], ...] = (
    (b"\x89PNG\r\n\x1a\n", _png),
    (b"\xff\xd8\xff", _jpeg),
    (b"BM", _bmp),
    (b"RIFF", _webp),
    (b"II*\0", _tiff),
    (b"MM\0*", _tiff),
    *((b"P%d" % kind, _pnm) for kind in range(1, 7)),
)
