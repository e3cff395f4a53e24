"""The bodies of run.mcap messages for each kind of reading; pure."""

from collections.abc import Mapping
from typing import Any
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.orchestrator.recording.mcap.mcap_schemas import numbers_schema
from wil_campaign.orchestrator.recording.mcap.mcap_settings import ImageSettings
from wil_campaign.vehicles.readings import CameraReading, DepthReading, Drawing, Reading
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.vehicles.readings.messages import Json, plain_json_document
from wil_campaign.vehicles.readings.numbers import number_fields_of_reading
from wil_campaign.worlds.camera import Intrinsics

Body = tuple[str, dict[str, Json], bytes | None]
"""Schema, fields, and the bytes of the field `data` if there is one."""


def _image_facts(reading: CameraReading | DepthReading, parts: list[str]) -> dict[str, Json]:
    """Return the fields of an image reading that its MCAP message body adds."""
    return {
        "intrinsics": plain_json_document(reading.intrinsics),
        "camera_pose": None
        if reading.camera_pose is None
        else plain_json_document(reading.camera_pose),
        "rendered": reading.rendered,
        "parts": parts,
    }


_ENCODINGS: Mapping[tuple[str, int], str] = {
    ("uint8", 3): "bgr8",
    ("uint8", 1): "8UC1",
    ("float32", 1): "32FC1",
}
"""Names of pixel formats in Foxglove and ROS, by type and channels."""


def raw_image_body(array: NDArray[Any], wil: dict[str, Json]) -> Body:
    """Return an image as a lossless MCAP message body, whatever its shape and type."""
    height, width = (*array.shape, 1, 1)[:2]
    channels = array.shape[2] if array.ndim == 3 else 1
    fields = {
        "width": width,
        "height": height,
        "encoding": _ENCODINGS.get((str(array.dtype), channels), "unknown"),
        "step": width * channels * array.itemsize,
        "wil": {**wil, "shape": list(array.shape), "dtype": str(array.dtype), "exact": True},
    }
    return "foxglove.RawImage", fields, array.tobytes()


def camera_body(reading: CameraReading, images: ImageSettings, parts: list[str]) -> Body:
    """Return a camera image's MCAP message body in the configured format, else raw."""
    image, facts = reading.image_bgr, _image_facts(reading, parts)
    is_bgr = image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3 and image.size > 0
    if images.format == "raw" or not is_bgr:
        return raw_image_body(image, facts)
    if images.format == "png":
        # level 1: higher ones take three times as long for a few percent
        coded = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    else:
        coded = jpeg_of_image(image, images.quality)
    facts["exact"] = images.format == "png"
    fields = {"format": images.format, "wil": facts}
    return "foxglove.CompressedImage", fields, coded


def jpeg_of_image(image_bgr: NDArray[Any], quality: int) -> bytes:
    """Return an image as JPEG. quality: 1 to 100."""
    return cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def drawing_body(reading: CameraReading, drawing: Drawing) -> Body:
    """Return the MCAP message body of an image that is drawn again from it: it has no pixels.

    Its digests are those of the pixels, of distances and of ids, row by row.
    """
    arrays = {"image": reading.image_bgr, "depth": reading.depth_m, "ids": reading.object_ids}
    digests = {name: image_digest_of(array) for name, array in arrays.items() if array is not None}
    drawn = {**plain_json_document(drawing), "crc32": digests}
    return "wil.Drawing", {"wil": {**_image_facts(reading, []), "drawing": drawn}}, None


def image_digest_of(array: NDArray[Any]) -> int:
    """Return the CRC-32 of an image's bytes; 0.3 ms for 640x480."""
    return crc32(np.ascontiguousarray(array).data)


def depth_body(reading: DepthReading, parts: list[str]) -> Body:
    """Return a depth image's lossless MCAP message body."""
    facts = {**_image_facts(reading, parts), "mount": plain_json_document(reading.mount)}
    return raw_image_body(reading.depth_m, facts)


def calibration_body(i: Intrinsics) -> Body:
    """Return the camera model's MCAP message body, for viewers."""
    model = "rational_polynomial" if len(i.distortion) >= 8 else "plumb_bob"
    fields = {
        "width": i.width_px,
        "height": i.height_px,
        "distortion_model": model if i.distortion else "",
        "D": list(i.distortion),
        "K": [i.fx_px, 0.0, i.cx_px, 0.0, i.fy_px, i.cy_px, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [i.fx_px, 0.0, i.cx_px, 0.0, 0.0, i.fy_px, i.cy_px, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
    return "foxglove.CameraCalibration", fields, None


def reading_body(reading: Reading) -> Body:
    """Return the MCAP message body of any reading except images."""
    kind = type(reading)
    traits = traits_of(kind)
    if traits.schema is None or traits.encode is None:
        return (
            numbers_schema(kind),
            {name: getattr(reading, name) for name in number_fields_of_reading(kind)},
            None,
        )
    fields, data = traits.encode(reading)
    return traits.schema["title"], fields, data
