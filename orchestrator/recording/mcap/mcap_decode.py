"""Decodes messages of run.mcap as readings, exact to the bit where recorded exactly; pure."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from mcap.records import Channel
from numpy.typing import NDArray

from wil_campaign.foundation.files.images import decode_image
from wil_campaign.orchestrator.recording.mcap.mcap_json import (
    Json,
    bytes_of,
    number,
    pose_in,
    vector,
)
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    Drawing,
    DrawnEffects,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Reading,
    Source,
    reading_types,
)
from wil_campaign.vehicles.readings.numbers import number_fields
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

Parts = Mapping[str, NDArray[Any]]
"""Arrays of an image: "depth", "ids" and, of one that was drawn again, "image"."""


def is_reading(channel: Channel) -> bool:
    """Return whether a channel's messages are readings, or images that are drawn again."""
    return channel.metadata.get("part") in {"reading", "drawing"}


def reading_topic(channel: Channel) -> str:
    """Return the topic of a channel's readings, which that of drawings has below it."""
    return f"/{channel.metadata['source']}/{channel.metadata['sensor']}"


def decode(document: Json, parts: Parts) -> Reading:
    """Return the reading decoded from an MCAP message.

    Raises KeyError, ValueError or TypeError for a foreign document.
    """
    wil = document["wil"]
    reading: Reading = _READINGS.get(wil["type"], _numbers)(document, parts)
    return replace(reading, sensor=wil["sensor"]) if "sensor" in wil else reading


def image_of(document: Json) -> NDArray[Any]:
    """Return the pixels decoded from an MCAP image message. Raises ValueError."""
    wil, data = document["wil"], np.frombuffer(bytes_of(document["data"]), np.uint8)
    if "format" not in document:
        pixels: NDArray[Any] = data.view(np.dtype(wil["dtype"])).reshape(wil["shape"])
        return pixels
    image = decode_image(data.tobytes())
    image.setflags(write=False)
    return image


def camera_of(document: Json) -> tuple[Intrinsics, Pose | None]:
    """Return optics and pose of an image's camera; the pose is None where it was not recorded.

    Raises KeyError, ValueError or TypeError for a document that has none.
    """
    wil = document["wil"]
    return _intrinsics(wil["intrinsics"]), _camera_pose(wil["camera_pose"])


def drawing_of(value: Json) -> Drawing:
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
    right, below = (number(one) for one in value["streak_px"])
    down, across = (int(one) for one in value["noise_roll_px"])
    return DrawnEffects(
        seed=tuple(int(one) for one in value["seed"]),
        noise_std_dn=number(value["noise_std_dn"]),
        gain=number(value["gain"]),
        offset_dn=number(value["offset_dn"]),
        streak_px=(right, below),
        noise_roll_px=(down, across),
    )


def _times(wil: Json) -> tuple[float, float, int, Source]:
    """Return decoded times, sequence number and source of a reading."""
    return number(wil["t_s"]), number(wil["arrived_s"]), wil["seq"], wil["source"]


def _intrinsics(value: Json) -> Intrinsics:
    return Intrinsics(
        width_px=value["width_px"],
        height_px=value["height_px"],
        fx_px=number(value["fx_px"]),
        fy_px=number(value["fy_px"]),
        cx_px=number(value["cx_px"]),
        cy_px=number(value["cy_px"]),
        distortion=tuple(number(one) for one in value["distortion"]),
    )


def _camera_pose(value: Json) -> Pose | None:
    """Decode the pose of a rendered image's camera; None for None."""
    if value is None:
        return None
    w, x, y, z = (number(one) for one in value["q_wxyz"])
    return Pose(vector(value["position_ned_m"]), (w, x, y, z))


def _camera(document: Json, parts: Parts) -> CameraReading:
    wil = document["wil"]
    return CameraReading(
        *_times(wil),
        image_bgr=parts["image"] if "image" in parts else image_of(document),
        intrinsics=_intrinsics(wil["intrinsics"]),
        depth_m=parts.get("depth"),
        object_ids=parts.get("ids"),
        camera_pose=_camera_pose(wil["camera_pose"]),
        rendered=wil["rendered"],
        drawing=drawing_of(wil["drawing"]) if "drawing" in wil else None,
    )


def _depth(document: Json, parts: Parts) -> DepthReading:
    wil = document["wil"]
    return DepthReading(
        *_times(wil),
        depth_m=image_of(document),
        intrinsics=_intrinsics(wil["intrinsics"]),
        object_ids=parts.get("ids"),
        camera_pose=_camera_pose(wil["camera_pose"]),
        rendered=wil["rendered"],
    )


def _scan(document: Json, _: Parts) -> LidarScanReading:
    wil = document["wil"]
    ids = wil["object_ids"]
    return LidarScanReading(
        *_times(wil),
        ranges_m=np.array([number(one) for one in document["ranges"]], np.float32),
        start_angle_rad=number(wil["start_angle_rad"]),
        step_rad=number(wil["step_rad"]),
        range_min_m=number(wil["range_min_m"]),
        range_max_m=number(wil["range_max_m"]),
        object_ids=None if ids is None else np.frombuffer(bytes_of(ids), np.uint8),
        mount=pose_in(document["pose"]),
    )


def _points(document: Json, _: Parts) -> LidarPointsReading:
    stride = document["point_stride"]
    packed = np.frombuffer(bytes_of(document["data"]), np.uint8).reshape(-1, stride)
    points = np.ascontiguousarray(packed[:, :12]).view("<f4")
    return LidarPointsReading(
        *_times(document["wil"]),
        points_frd_m=points,
        object_ids=packed[:, 12].copy() if stride == 13 else None,
        mount=pose_in(document["pose"]),
    )


def _rangefinder(document: Json, _: Parts) -> RangefinderReading:
    wil = document["wil"]
    return RangefinderReading(
        *_times(wil),
        range_m=number(document["ranges"][0]),
        range_min_m=number(wil["range_min_m"]),
        range_max_m=number(wil["range_max_m"]),
        mount=pose_in(document["pose"]),
    )


def _gps(document: Json, _: Parts) -> GpsReading:
    wil = document["wil"]
    return GpsReading(
        *_times(wil),
        latitude_deg=number(document["latitude"]),
        longitude_deg=number(document["longitude"]),
        altitude_m=number(document["altitude"]),
        velocity_ned_m_s=vector(wil["velocity_ned_m_s"]),
        horizontal_accuracy_m=number(wil["horizontal_accuracy_m"]),
        vertical_accuracy_m=number(wil["vertical_accuracy_m"]),
        fix_type=wil["fix_type"],
        satellites=wil["satellites"],
    )


def _pose(document: Json, _: Parts) -> PoseReading:
    wil = document["wil"]
    t_s, arrived_s, seq, source = _times(wil)
    velocity = wil["velocity_ned_m_s"]
    return PoseReading(
        t_s,
        arrived_s,
        source,
        pose=pose_in(document["pose"]),
        velocity_ned_m_s=None if velocity is None else vector(velocity),
        seq=seq,
    )


def _imu(document: Json, _: Parts) -> ImuReading:
    force, rates = document["linear_acceleration"], document["angular_velocity"]
    return ImuReading(
        *_times(document["wil"]),
        specific_force_frd_m_s2=vector([force[axis] for axis in "xyz"]),
        rates_frd_rad_s=vector([rates[axis] for axis in "xyz"]),
    )


def _microphone(document: Json, _: Parts) -> MicrophoneReading:
    wil = document["wil"]
    return MicrophoneReading(
        *_times(wil),
        samples=np.frombuffer(bytes_of(document["data"]), "<i2"),
        sample_rate_hz=document["sample_rate"],
        full_scale_pa=number(wil["full_scale_pa"]),
    )


def _numbers(document: Json, _: Parts) -> Reading:
    wil = document["wil"]
    kind: Any = reading_types()[wil["type"]]
    stamps = dict(zip(("t_s", "arrived_s", "seq", "source"), _times(wil), strict=True))
    numbers = {name: of(number(document[name])) for name, of in number_fields(kind).items()}
    reading: Reading = kind(**stamps, **numbers)
    return reading


_READINGS: Mapping[str, Callable[[Json, Parts], Reading]] = {
    "camera": _camera,
    "depth": _depth,
    "lidar": _scan,
    "lidar_points": _points,
    "rangefinder": _rangefinder,
    "gps": _gps,
    "pose": _pose,
    "imu": _imu,
    "microphone": _microphone,
}
