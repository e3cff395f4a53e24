"""A node of ROS 2 without ROS: zenoh's keys and rosbags' CDR, in a process of its own.

`python plain_node.py BEHAVIOUR`: what a test asks of it. It is what rmw_zenoh would put on the wire
for a node that subscribes to /camera/image_raw and /odom and publishes /cmd_vel.
"""

import json
import os
import queue
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
IMAGE = "sensor_msgs/msg/Image"
ODOMETRY = "nav_msgs/msg/Odometry"
TWIST = "geometry_msgs/msg/TwistStamped"
TEXT = "std_msgs/msg/String"
MAVROS = ("/mavros/setpoint_velocity/cmd_vel", "/mavros/local_position/odom")
DOMAIN = os.environ.get("ROS_DOMAIN_ID", "0")


def of(name: str, *fields: object) -> Any:
    return STORE.types[name](*fields)


def key(topic: str, kind: str) -> str:
    package, _, word = kind.split("/")
    return f"{DOMAIN}{topic}/{package}::msg::dds_::{word}_/{STORE.hash_rihs01(kind)}"


class Node:
    """Subscriptions whose callbacks run one after the other, as in a single executor."""

    def __init__(self) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([os.environ["WIL_ZENOH_ENDPOINT"]]))
        self.session = zenoh.open(config)
        self._calls: queue.Queue[Callable[[], None]] = queue.Queue()
        self._kept: list[Any] = []
        self._sent = 0

    def subscribe(self, topic: str, kind: str, call: Callable[[Any], None]) -> None:
        def take(sample: Any) -> None:
            message = STORE.deserialize_cdr(sample.payload.to_bytes(), kind)
            self._calls.put(lambda: call(message))

        self._kept.append(self.session.declare_subscriber(key(topic, kind), take))

    def publisher(self, topic: str, kind: str, gid: int = 1) -> Callable[[Any], None]:
        publisher = self.session.declare_publisher(key(topic, kind))

        def publish(message: Any) -> None:
            self._sent += 1
            attachment = struct.pack("<qqB", self._sent, time.time_ns(), 16) + bytes([gid] * 16)
            publisher.put(bytes(STORE.serialize_cdr(message, kind)), attachment=attachment)

        return publish

    def spin(self, is_done: Callable[[], bool]) -> None:
        try:
            while not is_done():
                self._calls.get()()
        finally:  # else its threads keep a process that crashed
            self.session.close()  # type: ignore[no-untyped-call]  # of zenoh


def twist(stamp: Any, forward: float, left: float, up: float, frame: str = "base_link") -> Any:
    zero = of("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    linear = of("geometry_msgs/msg/Vector3", forward, left, up)
    header = of("std_msgs/msg/Header", stamp, frame)
    return of(TWIST, header, of("geometry_msgs/msg/Twist", linear, zero))


class GateFlight:
    """Sees the orange gate, flies through it, and ends the node: ENU, the vehicle heads north."""

    SIZE_M = 1.2
    HALF_FIELD = float(np.tan(np.radians(34.5)))

    def __init__(self, node: Node, *, answers_images: bool) -> None:
        self.position: Any = None
        self.gate: Any = None
        self.seen: list[Any] = []
        self.done = False
        self.answers_images = answers_images
        self.publish = node.publisher("/cmd_vel", TWIST)
        node.subscribe("/camera/image_raw", IMAGE, self.image)
        node.subscribe("/odom", ODOMETRY, self.odometry)

    def odometry(self, message: Any) -> None:
        place = message.pose.pose.position
        self.position = np.array([place.x, place.y, place.z])
        self.publish(self.command(message.header.stamp))

    def image(self, message: Any) -> None:
        self.look(message)
        if self.answers_images:
            self.publish(self.command(message.header.stamp))

    def look(self, message: Any) -> None:
        if self.position is None:
            return
        blue, green, red = (
            message.data.reshape(message.height, message.width, 3).astype(np.int16)[..., i]
            for i in range(3)
        )
        rows, columns = np.nonzero((red - blue > 80) & (red - green > 40) & (green > blue))
        if len(columns) < message.width * message.height / 768:
            return
        focal_px = message.width / 2 / self.HALF_FIELD
        left, right = np.percentile(columns, [0.5, 99.5])
        top, bottom = np.percentile(rows, [0.5, 99.5])
        if left < 4 or right > message.width - 5 or top < 4 or bottom > message.height - 5:
            return
        ahead = focal_px * self.SIZE_M / (bottom - top)
        if 0.9 < ahead < 5:
            east = ahead * ((left + right) / 2 - (message.width - 1) / 2) / focal_px
            up = -ahead * ((top + bottom) / 2 - (message.height - 1) / 2) / focal_px
            self.seen.append([*(self.position + np.array([east, ahead, up]))])
            self.gate = np.median(self.seen[-25:], axis=0)

    def command(self, stamp: Any) -> Any:
        if self.gate is None or self.position is None:
            return twist(stamp, 0.0, 0.0, 0.0)
        east, north, up = self.gate - self.position
        is_aligned = abs(east) < 0.15 and abs(up) < 0.15
        ahead = 0.4 if is_aligned or north < 0.8 else 0.25 if north > 1.3 else 0.0
        self.done = self.done or north < -0.5
        left = float(np.clip(-east, -0.5, 0.5))
        return twist(stamp, ahead, left, float(np.clip(0.8 * up, -0.3, 0.3)))


class PictureFlight:
    """Flies by images alone: its speed depends on all that it has seen, and on their order."""

    LAST = 50

    def __init__(self, node: Node) -> None:
        self.publish = node.publisher("/cmd_vel", TWIST)
        self.answers: list[tuple[int, float]] = []
        node.subscribe("/camera/image_raw", IMAGE, self.image)

    @property
    def done(self) -> bool:
        return len(self.answers) >= self.LAST

    def image(self, message: Any) -> None:
        before = self.answers[-1][1] if self.answers else 0.2
        speed = 0.1 + 0.5 * before + float(np.mean(message.data)) / 10_000
        stamp = message.header.stamp
        self.answers.append((stamp.sec * 10**9 + stamp.nanosec, speed))
        self.publish(twist(stamp, speed, 0.0, 0.0))


class StraightFlight:
    """Flies ahead from its first odometry on, until it is a metre further north.

    looks: it answers images, too, and its speed depends on all of them and on their order.
    """

    def __init__(
        self,
        node: Node,
        *,
        crashes: bool = False,
        looks: bool = False,
        topics: tuple[str, str] = ("/cmd_vel", "/odom"),
    ) -> None:
        self.publish = node.publisher(topics[0], TWIST)
        self.north: float | None = None
        self.crashes = crashes
        self.done = False
        self.speed = 0.5
        if looks:
            node.subscribe("/camera/image_raw", IMAGE, self.image)
        node.subscribe(topics[1], ODOMETRY, self.odometry)

    def image(self, message: Any) -> None:
        self.speed = 0.3 + 0.5 * (1 - self.speed) + float(np.mean(message.data)) / 10_000
        self.publish(twist(message.header.stamp, self.speed, 0.0, 0.0))

    def odometry(self, message: Any) -> None:
        north = message.pose.pose.position.y
        self.north = north if self.north is None else self.north
        if self.crashes and north > self.north + 0.5:
            raise RuntimeError("the node broke on its way")
        self.done = north > self.north + 1.0
        self.speed = 0.1 + 0.8 * self.speed
        self.publish(twist(message.header.stamp, self.speed, 0.0, 0.0))


class OffboardFlight:
    """Climbs to a height, as PX4's example offboard_control does, and lands. folder: of px4_msgs.

    It sends its modes and commands whether or not the vehicle is ready, and a setpoint with each
    odometry, so that time can wait for it.
    """

    UP_M = 2.0

    def __init__(self, node: Node, folder: Path) -> None:
        for file in (folder / "msg").glob("*.msg"):
            name = f"px4_msgs/msg/{file.stem}"
            STORE.register(get_types_from_msg(file.read_text("utf-8"), name))
        kinds = ("OffboardControlMode", "TrajectorySetpoint", "VehicleCommand")
        topics = ("offboard_control_mode", "trajectory_setpoint", "vehicle_command")
        self.publishers = {
            kind: node.publisher(f"/fmu/in/{topic}", f"px4_msgs/msg/{kind}")
            for kind, topic in zip(kinds, topics, strict=True)
        }
        self.count, self.nav_state, self.acknowledged = 0, 0, [0]
        self.done = False
        out = "/fmu/out/vehicle"
        node.subscribe(f"{out}_status_v1", "px4_msgs/msg/VehicleStatus", self.status)
        node.subscribe(f"{out}_odometry", "px4_msgs/msg/VehicleOdometry", self.odometry)
        node.subscribe(f"{out}_command_ack", "px4_msgs/msg/VehicleCommandAck", self.acknowledge)

    def publish(self, kind: str, **fields: object) -> None:
        name = f"px4_msgs/msg/{kind}"
        values = {
            field: np.full(3, np.nan, np.float32) if type_[0] == Nodetype.ARRAY else 0
            for field, type_ in STORE.fielddefs[name][1]
        }
        self.publishers[kind](of(name, *{**values, **fields}.values()))

    def status(self, message: Any) -> None:
        self.nav_state = message.nav_state

    def acknowledge(self, message: Any) -> None:
        self.acknowledged.append(message.command)

    def odometry(self, message: Any) -> None:
        self.count += 1
        self.publish("OffboardControlMode", position=True)
        if self.count == 10:
            self.publish("VehicleCommand", command=176, param1=1.0, param2=6.0)
            self.publish("VehicleCommand", command=400, param1=1.0)
        is_there = self.nav_state == 14 and message.position[2] < 0.02 - self.UP_M
        if is_there and not self.done:
            self.publish("VehicleCommand", command=21)
            self.done = True
        place = np.array([0.0, 0.0, -self.UP_M], np.float32)
        stamp_us = message.timestamp
        self.publish("TrajectorySetpoint", timestamp=stamp_us, position=place, yaw=np.nan)


class AbortingFlight:
    """Hovers, and asks for an abort after its answer to an odometry. leaves: and ends at once."""

    def __init__(self, node: Node, *, at: int, leaves: bool) -> None:
        self.publish = node.publisher("/cmd_vel", TWIST)
        self.abort = node.publisher("/wil/abort", TEXT)
        self.at, self.leaves, self.done = at, leaves, False
        node.subscribe("/odom", ODOMETRY, self.odometry)

    def odometry(self, message: Any) -> None:
        self.publish(twist(message.header.stamp, 0.0, 0.0, 0.0))
        self.at -= 1
        if self.at == 0:
            self.abort(of(TEXT, "low battery"))
            self.done = self.leaves


def main(behaviour: str) -> int:
    if behaviour == "dead":
        sys.exit("the node has no model")
    node = Node()
    if behaviour == "deaf":
        node.subscribe("/clock", "rosgraph_msgs/msg/Clock", lambda _: None)
        old = f"@ros2_lv/{DOMAIN}/1/0/1/MS/%/%/old/%odom/nav_msgs::msg::dds_::Odometry_"
        token = node.session.liveliness().declare_token(f"{old}/RIHS01_0/::,:,:,:,,")
        node.spin(lambda: token is None)
    if behaviour in {"straight", "crash", "looks", "stays", "mavros"}:
        names = MAVROS if behaviour == "mavros" else ("/cmd_vel", "/odom")
        is_crash, is_look = behaviour == "crash", behaviour in {"looks", "stays"}
        straight = StraightFlight(node, crashes=is_crash, looks=is_look, topics=names)
        done = node.publisher("/wil/done", TEXT)
        stays = behaviour == "stays"
        node.spin(lambda: straight.done and (not stays or done(of(TEXT, "there")) is not None))
        sys.stdout.write(f"flew to {os.environ['WIL_GOAL']} as {os.environ['WIL_VEHICLE']}\n")
        return 0
    if behaviour.startswith("aborts"):
        at, leaves = (5, False) if behaviour == "aborts_early" else (300, True)
        aborting = AbortingFlight(node, at=at, leaves=leaves)
        node.spin(lambda: aborting.done)
        return 0
    if behaviour == "px4":
        offboard = OffboardFlight(node, Path(sys.argv[2]))
        node.spin(lambda: False)  # its command ends the flight, and the run this process
        return offboard.count
    if behaviour == "pictures":
        pictures = PictureFlight(node)
        node.spin(lambda: pictures.done)
        sys.stdout.write(json.dumps(pictures.answers) + "\n")
        return 0
    flight = GateFlight(node, answers_images=behaviour == "answers")
    node.spin(lambda: flight.done)
    sys.stdout.write(f"saw the gate in {len(flight.seen)} images\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else "plain"))
