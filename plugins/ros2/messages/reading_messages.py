"""The messages of a reading, by topic; and the frames of sensors."""

import re
from collections.abc import Callable, Iterator
from functools import partial

from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup, SensorSetup
from wil_campaign.plugins.ros2.messages.ros_frames import optical_in_body, sensor_in_body
from wil_campaign.plugins.ros2.messages.ros_messages import BODY_FRAME, FrameTransform, RosMessages
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    PoseReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

Made = tuple[str, Callable[[], bytes]]
"""A topic, and what makes the message."""


def reading_messages(
    reading: Reading,
    make: RosMessages,
    stamp_ns: int,
    *,
    prefix: str = "",
    within: str = "",
    compressed: bool,
) -> Iterator[Made]:
    """Yield the messages of a reading; none of sound.

    prefix: of the topics, as "/real". within: of its frame, as "twin/".
    """
    name = ros_word_of_name(reading.sensor)
    frame, base = within + name, f"{prefix}/{name}"
    match reading:
        case CameraReading():
            frame = within + optical_frame(name)
            info = partial(make.camera_info, reading.intrinsics, stamp_ns, frame)
            yield f"{base}/camera_info", info
            yield f"{base}/image_raw", partial(make.image, reading, stamp_ns, frame)
            if compressed:
                small = partial(make.compressed, reading, stamp_ns, frame)
                yield f"{base}/image_raw/compressed", small
        case DepthReading():
            frame = within + optical_frame(name)
            info = partial(make.camera_info, reading.intrinsics, stamp_ns, frame)
            yield f"{base}/camera_info", info
            yield f"{base}/image_raw", partial(make.depth, reading, stamp_ns, frame)
        case LidarScanReading():
            yield f"{base}/scan", partial(make.scan, reading, stamp_ns, frame)
        case LidarPointsReading():
            yield f"{base}/points", partial(make.points, reading, stamp_ns, frame)
        case RangefinderReading():
            yield f"{base}/range", partial(make.range, reading, stamp_ns, frame)
        case ImuReading():
            yield f"{base}/data", partial(make.imu, reading, stamp_ns, frame)
        case GpsReading():
            yield f"{base}/fix", partial(make.fix, reading, stamp_ns, frame)
        case PoseReading():
            yield f"{base}/pose", partial(make.captured, reading, stamp_ns)
        case _:
            return


def sensor_transforms(sensors: tuple[SensorSetup, ...]) -> tuple[FrameTransform, ...]:
    """Return the frames of sensors in base_link, those of stabilized cameras aside."""
    fixed = (sensor for sensor in sensors if not is_stabilized(sensor))
    return tuple(frame for sensor in fixed for frame in sensor_frames(sensor, AT_ORIGIN))


def sensor_frames(sensor: SensorSetup, body: Pose) -> Iterator[FrameTransform]:
    """Yield a sensor's frames in base_link. body: the vehicle's pose, which moves a gimbal.

    A depth camera has two, for the points that a recipe may make of it are forward, left, up.
    """
    name = ros_word_of_name(sensor.name)
    if isinstance(sensor, CameraSetup | DepthSetup):
        mount = sensor.mount.in_body(body)
        yield FrameTransform(BODY_FRAME, optical_frame(name), *optical_in_body(mount))
        if isinstance(sensor, CameraSetup):
            return
    else:
        mount = sensor.mount
    yield FrameTransform(BODY_FRAME, name, *sensor_in_body(mount))


def is_stabilized(sensor: SensorSetup) -> bool:
    """Return whether a sensor is a camera on a gimbal."""
    return isinstance(sensor, CameraSetup | DepthSetup) and sensor.mount.stabilized


def optical_frame(name: str) -> str:
    """Return the frame of a camera: right, down, forward."""
    return f"{name}_optical"


def ros_word_of_name(name: str) -> str:
    """Return a sensor's name as topics and frames can have it."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return word if word[:1].isalpha() else f"sensor_{word}"
