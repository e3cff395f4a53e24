"""The topics of a node under test: their names, types and quality of service."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from wil_campaign.plugins.ros2.messages.ros_messages import (
    CAMERA_INFO,
    CLOCK,
    COMPRESSED,
    FIX,
    IMAGE,
    IMU,
    ODOMETRY,
    PLAIN_TWIST,
    POINTS,
    POSE,
    RANGE,
    SCAN,
    TEXT,
    TF,
    TRAJECTORY,
    TWIST,
)

Quality = Literal["reliable", "latched"]
"""Reliable with a short queue; latched: late subscribers get the last message, too."""
SETPOINTS: Mapping[str, str] = {
    "/cmd_vel": TWIST,
    # After it: a campaign may give this one the name of that.
    "/cmd_vel_unstamped": PLAIN_TWIST,
    "/setpoint/pose": POSE,
    "/setpoint/trajectory": TRAJECTORY,
}
DONE, ABORT, NOTE = "/wil/done", "/wil/abort", "/wil/note"
WORDS: Mapping[str, str] = {DONE: TEXT, ABORT: TEXT, NOTE: TEXT}
CLOCK_TOPIC, ODOMETRY_TOPIC, POSE_TOPIC = "/clock", "/odom", "/pose"
TF_TOPIC, STATIC_TOPIC = "/tf", "/tf_static"
GOAL, STAGE, VERDICT = "/wil/goal", "/wil/stage", "/wil/verdict"


@dataclass(frozen=True, slots=True)
class OutTopic:
    """A topic that is published to the node. name: as here; other names come from the campaign.

    is_sensor: it has what a sensor senses, without which a node may be blind.
    """

    name: str
    type: str
    quality: Quality = "reliable"
    is_sensor: bool = False


OWN: tuple[OutTopic, ...] = (
    OutTopic(CLOCK_TOPIC, CLOCK),
    OutTopic(ODOMETRY_TOPIC, ODOMETRY),
    OutTopic(POSE_TOPIC, POSE),
    OutTopic(TF_TOPIC, TF),
    OutTopic(STATIC_TOPIC, TF, "latched"),
    OutTopic(GOAL, TEXT, "latched"),
    OutTopic(STAGE, TEXT, "latched"),
    OutTopic(VERDICT, TEXT, "latched"),
)
"""What is published of the vehicle and the run; a node finds its way by the first four."""


def sensor_topics(name: str, kind: str, *, compressed: bool) -> tuple[OutTopic, ...]:
    """Return the topics of a sensor by its name and type; none for a microphone."""
    found = [OutTopic(f"/{name}/{one}", of, is_sensor=True) for one, of in _OF_KIND.get(kind, ())]
    if kind == "camera" and compressed:
        found.append(OutTopic(f"/{name}/image_raw/compressed", COMPRESSED, is_sensor=True))
    return tuple(found)


_OF_KIND: Mapping[str, tuple[tuple[str, str], ...]] = {
    "camera": (("image_raw", IMAGE), ("camera_info", CAMERA_INFO)),
    "depth": (("image_raw", IMAGE), ("camera_info", CAMERA_INFO)),
    "lidar": (("scan", SCAN),),
    "lidar_points": (("points", POINTS),),
    "rangefinder": (("range", RANGE),),
    "imu": (("data", IMU),),
    "gps": (("fix", FIX),),
    "pose": (("pose", POSE),),
}
