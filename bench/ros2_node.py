"""A ROS 2 node that flies by one of the shipped autonomies: what it sees comes from topics alone.

    python -P bench/ros2_node.py MODULE:CLASS

It is what a team's node is to a run: it gets images, camera_info and odometry, and answers with a
TwistStamped; it begins at the stage `goal`, for all that comes while the vehicle takes off, too. It
needs no ROS. Frames: ENU on the topics, NED in the autonomy.
"""

import importlib
import json
import os
import queue
import sys
from typing import Any

import zenoh

from wil_campaign.api import CameraReading, Telemetry, VelocitySetpoint
from wil_campaign.plugins.ros2.messages.ros_frames import attitude_ned, enu_from_ned
from wil_campaign.plugins.ros2.messages.ros_messages import (
    CAMERA_INFO,
    IMAGE,
    ODOMETRY,
    TEXT,
    TWIST,
)
from wil_campaign.plugins.ros2.messages.ros_types import dds_name, ros_types
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, frd_from_flu, rotate

TYPES = ros_types("jazzy")
TOPICS = {
    "/wil/stage": TEXT,
    "/camera/camera_info": CAMERA_INFO,
    "/camera/image_raw": IMAGE,
    "/odom": ODOMETRY,
}
_NS = 1_000_000_000


def key(topic: str, kind: str) -> str:
    return f"{os.environ['ROS_DOMAIN_ID']}{topic}/{dds_name(kind)}/{TYPES.hash(kind)}"


class Hosted:
    """An autonomy, by messages. session: of zenoh."""

    def __init__(self, session: zenoh.Session, factory: Any) -> None:
        goal, parameters = (json.loads(os.environ[f"WIL_{n}"]) for n in ("GOAL", "PARAMETERS"))
        self._autonomy = factory(goal=goal, parameters=parameters, seed=int(os.environ["WIL_SEED"]))
        self._twists = session.declare_publisher(key("/cmd_vel", TWIST))
        self._done = session.declare_publisher(key("/wil/done", TEXT))
        self._lens: Intrinsics | None = None
        self._images = 0
        self._flies = False
        self._velocity, self._turn = (0.0, 0.0, 0.0), 0.0

    def take(self, topic: str, message: Any) -> None:
        """Take a message; answer an image or odometry with a setpoint of its stamp."""
        if topic == "/wil/stage":
            self._flies = self._flies or message.data == "goal"
            return
        if topic.endswith("info"):
            fx, _, cx, _, fy, cy, *_ = (float(one) for one in message.k)
            self._lens = Intrinsics(message.width, message.height, fx, fy, cx, cy)
            return
        t_s = message.header.stamp.sec + message.header.stamp.nanosec / _NS
        if topic == "/odom" and self._flies:
            self._act(t_s, message)
        elif topic != "/odom" and self._flies and self._lens is not None:
            image = message.data.reshape(message.height, message.width, 3)
            reading = CameraReading(
                t_s, t_s, self._images, "mixed", image, self._lens, sensor="camera"
            )
            self._images += 1
            self._autonomy.perceive(reading)
        self._answer(message.header.stamp)

    def _act(self, t_s: float, odometry: Any) -> None:
        place, turned = odometry.pose.pose.position, odometry.pose.pose.orientation
        q_wxyz = attitude_ned((turned.w, turned.x, turned.y, turned.z))
        pose = Pose(enu_from_ned((place.x, place.y, place.z)), q_wxyz)
        moved = odometry.twist.twist.linear
        velocity = rotate(q_wxyz, frd_from_flu((moved.x, moved.y, moved.z)))
        command = self._autonomy.act(Telemetry(t_s, pose, velocity))
        setpoint = command.setpoint
        if not isinstance(setpoint, VelocitySetpoint):
            sys.exit(f"{setpoint} is no velocity")
        self._velocity, self._turn = setpoint.velocity_ned_m_s, setpoint.yaw_rate_rad_s or 0.0
        if command.done:
            self._done.put(TYPES.serialize(TYPES.cls(TEXT)("done"), TEXT))

    def _answer(self, stamp: Any) -> None:
        vector, twist = TYPES.cls("geometry_msgs/msg/Vector3"), TYPES.cls("geometry_msgs/msg/Twist")
        header = TYPES.cls("std_msgs/msg/Header")(stamp, "map")
        moved = twist(vector(*enu_from_ned(self._velocity)), vector(0.0, 0.0, -self._turn))
        self._twists.put(TYPES.serialize(TYPES.cls(TWIST)(header, moved), TWIST))


def main() -> None:
    module, _, name = sys.argv[1].partition(":")
    factory = getattr(importlib.import_module(module), name)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([os.environ["WIL_ZENOH_ENDPOINT"]]))
    came: queue.Queue[tuple[str, bytes]] = queue.Queue()
    with zenoh.open(config) as session:
        hosted = Hosted(session, factory)
        kept = [
            session.declare_subscriber(
                key(topic, kind),
                lambda sample, topic=topic: came.put((topic, sample.payload.to_bytes())),
            )
            for topic, kind in TOPICS.items()
        ]
        while kept:  # the run ends this process
            topic, data = came.get()
            hosted.take(topic, TYPES.deserialize(data, TOPICS[topic]))


if __name__ == "__main__":
    main()
