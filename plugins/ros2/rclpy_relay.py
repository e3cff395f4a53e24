"""Relays CDR between a socket and rclpy; a program of its own, run by the Python that has rclpy.

`python rclpy_relay.py DESCRIPTOR`: of a connected stream socket. It imports nothing of ours, for
that Python need not have it. Frames both ways: kind, index of the topic, length, bytes.
"""

import importlib
import json
import socket
import struct
import sys
import threading
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.signals import SignalHandlerOptions

FRAME = struct.Struct("<cHI")
ADVERTISE, PUBLISH = b"A", b"P"
"""What comes; any other kind asks to listen."""
READY, STATUS, MESSAGE = b"R", b"S", b"M"
_LOOK_S = 0.05
_LOOKS_A_SECOND = 20
_DEPTH = 10


class RclpyRelay:
    """A node that publishes what it is sent, and sends what it hears."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._sending = threading.Lock()
        self._publishers: dict[int, Any] = {}
        self._listened: dict[int, str] = {}
        self._latest: dict[int, bytes] = {}
        """What was published last on topics that a service tells."""
        self._subscriptions: list[Any] = []
        self._sent_graph = ""
        self._looks = 0
        self._mismatches: list[str] = []
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("wil")
        self._node.create_timer(_LOOK_S, self._tell_graph)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

    def run(self) -> None:
        """Relay until the socket ends."""
        spinning = threading.Thread(target=self._spin, daemon=True)
        spinning.start()
        self._send(READY, 0, b"")
        stream = self._connection.makefile("rb")
        while len(head := stream.read(FRAME.size)) == FRAME.size:
            kind, index, length = FRAME.unpack(head)
            data = stream.read(length)
            if len(data) < length:
                break
            if kind == PUBLISH:
                self._publish(index, data)
            else:
                self._open(kind, index, json.loads(data))
        self._executor.shutdown(timeout_sec=1.0)
        spinning.join(1.0)
        self._node.destroy_node()
        rclpy.shutdown()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _publish(self, index: int, data: bytes) -> None:
        if index in self._latest:
            self._latest[index] = data
        if (publisher := self._publishers.get(index)) is not None:
            publisher.publish(data)

    def _serve(self, kind: bytes, index: int, name: str) -> None:
        """Offer a topic as a service, too: it tells the newest text, or sends one.

        Raises ImportError where this ROS has no std_srvs.
        """
        from rclpy.serialization import deserialize_message, serialize_message  # noqa: PLC0415
        from std_msgs.msg import String  # noqa: PLC0415
        from std_srvs.srv import Trigger  # noqa: PLC0415

        def tell(_request: Any, response: Any) -> Any:
            data = self._latest[index]
            response.success = bool(data)
            response.message = deserialize_message(data, String).data if data else ""
            return response

        def send(_request: Any, response: Any) -> Any:
            self._send(MESSAGE, index, serialize_message(String(data=f"by the service {name}")))
            response.success = True
            return response

        if kind == ADVERTISE:
            self._latest[index] = b""
        self._node.create_service(Trigger, name, tell if kind == ADVERTISE else send)

    def _open(self, kind: bytes, index: int, topic: dict[str, str]) -> None:
        """Open a topic, and its service where it is to have one."""
        self._open_topic(kind, index, topic)
        if topic.get("service"):
            try:
                self._serve(kind, index, topic["name"])
            except ImportError as error:
                sys.stderr.write(f"{topic['name']} is no service: {error}\n")

    def _open_topic(self, kind: bytes, index: int, topic: dict[str, str]) -> None:
        try:
            cls, quality = _class_of(topic["type"]), _quality(topic["quality"])
        except (ImportError, AttributeError) as error:
            # Nobody in this ROS can subscribe to it, either.
            sys.stderr.write(f"{topic['name']} is left out, for {topic['type']}: {error}\n")
            return
        if kind == ADVERTISE:
            publisher = self._node.create_publisher(cls, topic["name"], quality)
            self._publishers[index] = publisher
            return

        def take(data: bytes) -> None:
            self._send(MESSAGE, index, data)

        self._listened[index] = topic["name"]
        self._subscriptions.append(
            self._node.create_subscription(cls, topic["name"], take, quality, raw=True)
        )

    def _tell_graph(self) -> None:
        """Send who subscribes and publishes, where that has changed; a service subscribes, too."""
        subscribed = {
            str(index): one.get_subscription_count() + (index in self._latest)
            for index, one in list(self._publishers.items())
        }
        publishers = {
            str(index): [
                [one.topic_type, bytes(one.endpoint_gid).hex()]
                for one in self._node.get_publishers_info_by_topic(name)
            ]
            for index, name in list(self._listened.items())
        }
        self._looks += 1
        if self._looks % _LOOKS_A_SECOND == 0:
            self._mismatches = self._look_for_mismatches()
        graph = json.dumps(
            {"subscribed": subscribed, "publishers": publishers, "mismatches": self._mismatches}
        )
        if graph != self._sent_graph:
            self._sent_graph = graph
            self._send(STATUS, 0, graph.encode())

    def _look_for_mismatches(self) -> list[str]:
        """Return in words the subscriptions to our topics that DDS does not match."""
        found = []
        for publisher in list(self._publishers.values()):
            if publisher.get_subscription_count():
                continue
            for their in self._node.get_subscriptions_info_by_topic(publisher.topic_name):
                where = f"the node {their.node_name} subscribes to {publisher.topic_name}"
                ours = _type_name(publisher.msg_type)
                if their.topic_type != ours:
                    found.append(f"{where} with {their.topic_type}, not {ours}")
                    continue
                worst, why = qos_check_compatible(publisher.qos_profile, their.qos_profile)
                if worst == QoSCompatibility.ERROR:
                    found.append(f"{where} with another quality of service: {why.strip()}")
        return sorted(found)

    def _send(self, kind: bytes, index: int, data: bytes) -> None:
        with self._sending:
            try:
                self._connection.sendall(FRAME.pack(kind, index, len(data)) + data)
            except OSError:  # the run is over
                return


def _type_name(cls: Any) -> str:
    return f"{cls.__module__.partition('.')[0]}/msg/{cls.__name__}"


def _class_of(name: str) -> Any:
    package, _, rest = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), rest.rpartition("/")[2])


def _quality(name: str) -> QoSProfile:
    """Return reliable quality of service, which subscribers of best effort hear, too."""
    is_latched = name == "latched"
    local, volatile = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
    return QoSProfile(
        depth=1 if is_latched else _DEPTH,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.BEST_EFFORT if name == "any" else ReliabilityPolicy.RELIABLE,
        durability=local if is_latched else volatile,
    )


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as given:
        RclpyRelay(given).run()
