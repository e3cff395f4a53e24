"""Images in messages of recordings: pixels, cameras, and what an image was drawn of; pure."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.foundation.files.images import decode_image_file
from wil_campaign.vehicles.readings.images import Drawing, DrawnEffects
from wil_campaign.vehicles.readings.messages import (
    Json,
    bytes_from_base64,
    number_from_json,
    vector_from_json,
)
from wil_campaign.vehicles.readings.traits import Parts
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN, Pose


def decode_camera(document: Json, parts: Parts) -> dict[str, Any]:
    """Return the fields of a camera reading in its message, without its stamps."""
    wil = document["wil"]
    return {
        "image_bgr": parts["image"] if "image" in parts else image_of_message(document),
        "depth_m": parts.get("depth"),
        "drawing": drawing_of_message(wil["drawing"]) if "drawing" in wil else None,
        **_facts(wil, parts),
    }


def decode_depth(document: Json, parts: Parts) -> dict[str, Any]:
    """Return the fields of a depth reading in its message, without its stamps."""
    wil = document["wil"]
    mount = _camera_pose(wil.get("mount")) or AT_ORIGIN
    return {"depth_m": image_of_message(document), "mount": mount, **_facts(wil, parts)}


def _facts(wil: Json, parts: Parts) -> dict[str, Any]:
    """Return the fields that both kinds of images have."""
    return {
        "intrinsics": _intrinsics(wil["intrinsics"]),
        "object_ids": parts.get("ids"),
        "camera_pose": _camera_pose(wil["camera_pose"]),
        "rendered": wil["rendered"],
    }


def image_of_message(document: Json) -> NDArray[Any]:
    """Return the pixels decoded from an MCAP image message. Raises ValueError."""
    wil, data = document["wil"], np.frombuffer(bytes_from_base64(document["data"]), np.uint8)
    if "format" not in document:
        pixels: NDArray[Any] = data.view(np.dtype(wil["dtype"])).reshape(wil["shape"])
        return pixels
    image = decode_image_file(data.tobytes())
    image.setflags(write=False)
    return image


def camera_of_message(document: Json) -> tuple[Intrinsics, Pose | None]:
    """Return optics and pose of an image's camera; the pose is None where it was not recorded.

    Raises KeyError, ValueError or TypeError for a document that has none.
    """
    wil = document["wil"]
    return _intrinsics(wil["intrinsics"]), _camera_pose(wil["camera_pose"])


def drawing_of_message(value: Json) -> Drawing:
    """Return what an image was drawn of. Raises KeyError, ValueError or TypeError."""
    poses = (_camera_pose(one) for one in value["moving"])
    camera_pose, done = _camera_pose(value["camera_pose"]), value["effects"]
    if camera_pose is None:
        raise ValueError("a drawing without the pose of its camera")
    return Drawing(
        camera_pose,
        tuple(pose for pose in poses if pose is not None),
        None if done is None else _effects(done),
    )


def _effects(value: Json) -> DrawnEffects:
    right, below = (number_from_json(one) for one in value["streak_px"])
    down, across = (int(one) for one in value["noise_roll_px"])
    return DrawnEffects(
        seed=tuple(int(one) for one in value["seed"]),
        noise_std_dn=number_from_json(value["noise_std_dn"]),
        gain=number_from_json(value["gain"]),
        offset_dn=number_from_json(value["offset_dn"]),
        streak_px=(right, below),
        noise_roll_px=(down, across),
    )


def _intrinsics(value: Json) -> Intrinsics:
    return Intrinsics(
        width_px=value["width_px"],
        height_px=value["height_px"],
        fx_px=number_from_json(value["fx_px"]),
        fy_px=number_from_json(value["fy_px"]),
        cx_px=number_from_json(value["cx_px"]),
        cy_px=number_from_json(value["cy_px"]),
        distortion=tuple(number_from_json(one) for one in value["distortion"]),
    )


def _camera_pose(value: Json) -> Pose | None:
    """Decode the pose of a rendered image's camera; None for None."""
    if value is None:
        return None
    w, x, y, z = (number_from_json(one) for one in value["q_wxyz"])
    return Pose(vector_from_json(value["position_ned_m"]), (w, x, y, z))
