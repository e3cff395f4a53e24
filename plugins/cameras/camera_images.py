"""Image files of cameras: upright as they are stored, with 8 bits a channel; pure."""

from io import BytesIO

import cv2

from wil_campaign.foundation.files.images import ImageError, decode_image_file
from wil_campaign.plugins.cameras.frame_stamps import checked_frame
from wil_campaign.vehicles.readings import BgrImage

_ORIENTATION, _BITS_PER_SAMPLE = 0x0112, 258
_UPRIGHT = 1
_PNG, _TIFF = b"\x89PNG", (b"II*\0", b"MM\0*")
_EXIF = (b"Exif", b"eXIf")
_HEAD_BYTES = 65_536
"""JPEG has it in its first segments, PNG before the pixels; WebP says in byte 20 whether it has."""


def decode_camera_image(name: str, data: bytes) -> BgrImage:
    """Return the pixels of an image file of a camera.

    Raises ImageError, also for one that is marked as rotated, and for one with 16 bits a channel:
    the upper 8, which a decoder would keep, are nearly black of a sensor with 12. Raises
    SourceError.
    """
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    image = checked_frame(name, decode_image_file(data, flags))
    require_8_bits(data)
    if _has_tags(data):
        orientation = _tag(data, _ORIENTATION, _UPRIGHT)
        if orientation in range(2, 9):
            raise ImageError(
                f"it is marked as rotated (EXIF orientation {orientation}), as phones do; turn it "
                "upright: mogrify -auto-orient FILE"
            )
    return image


def _has_tags(data: bytes) -> bool:
    """Return whether an image file may have tags."""
    if data[8:16] == b"WEBPVP8X":
        return bool(data[20] & 8)
    head = data[:_HEAD_BYTES]
    return data.startswith(_TIFF) or any(mark in head for mark in _EXIF)


def require_8_bits(data: bytes) -> None:
    """Raise ImageError for an image file, which can be decoded, with over 8 bits a channel."""
    bits = 8
    if data.startswith(_PNG) and len(data) > 24:
        bits = data[24]
    elif data.startswith(_TIFF):
        bits = _tag(data, _BITS_PER_SAMPLE, 8)
    if bits > 8:
        raise ImageError(
            f"it has {bits} bits a channel, and a camera's image 8; scale it to 8 bits by the "
            "range of your sensor"
        )


def _tag(data: bytes, tag: int, default: int) -> int:
    """Return a whole number among an image file's tags; the first of several."""
    from PIL import Image  # noqa: PLC0415 - few images have tags

    try:
        with Image.open(BytesIO(data)) as image:
            found = image.getexif().get(tag, default)
    except Exception:  # noqa: BLE001 - damaged tags cause anything; the pixels are sound
        return default
    number = found[0] if isinstance(found, tuple) and found else found
    return number if isinstance(number, int) else default
