"""The wire by rclpy, in a process of the Python that has it: any middleware of the user's ROS."""

import asyncio
import json
import os
import socket
import struct
import threading
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from wil_campaign.plugins.ros2.messages.topics import ABORT, DONE, GOAL, OutTopic
from wil_campaign.plugins.ros2.node_process import NodeProcess, started_node
from wil_campaign.plugins.ros2.wire import InMessage, Take, WireError

FRAME = struct.Struct("<cHI")
ADVERTISE, LISTEN, PUBLISH = b"A", b"L", b"P"
READY, STATUS, MESSAGE = b"R", b"S", b"M"
"""Frames as rclpy_relay.py has them, which can import nothing of ours."""
_RELAY = Path(__file__).with_name("rclpy_relay.py")
_PROFILE = Path(__file__).with_name("shared_memory.xml")
_START_S = 30.0
_LOOK_S = 0.1


class RclpyWire:
    """Publishes and listens by a relay. connection: a stream socket to it. domain: of ROS."""

    def __init__(self, connection: socket.socket, relay: NodeProcess, domain: int) -> None:
        self._connection = connection
        self._relay = relay
        self._domain = domain
        self._sending = threading.Lock()
        self._indices: dict[str, int] = {}
        self._listened: dict[int, tuple[str, Take]] = {}
        self._types: dict[int, str] = {}
        self._subscribers: dict[int, int] = {}
        self._mismatches: list[str] = []
        self.is_ready = threading.Event()
        self._reader = threading.Thread(target=self._read, name="rclpy relay", daemon=True)
        self._reader.start()

    def advertise(self, topic: OutTopic, name: str) -> None:
        """Offer a topic under a name."""
        fields = {"name": name, "type": topic.type, "quality": topic.quality}
        if topic.name == GOAL:
            fields["service"] = GOAL
        index = self._indices[name] = len(self._indices)
        self._send(ADVERTISE, index, json.dumps(fields).encode())

    def listen(self, name: str, type_: str, take: Take) -> None:
        """Call `take` with each message on a topic; and with publishers of other types."""
        index = len(self._listened)
        self._listened[index] = (name, take)
        self._types[index] = type_
        fields = {"name": name, "type": type_, "quality": "any"}
        if name in {ABORT, DONE}:
            fields["service"] = name
        self._send(LISTEN, index, json.dumps(fields).encode())

    def is_subscribed(self, name: str) -> bool:
        """Return whether anybody subscribes to an advertised topic, as ROS last knew."""
        return self._subscribers.get(self._indices[name], 0) > 0

    def publish(self, name: str, cdr: bytes, stamp_ns: int) -> bool:
        """Publish a message; return whether the relay took it."""
        del stamp_ns
        return self._send(PUBLISH, self._indices[name], cdr)

    def mismatches(self) -> list[str]:
        """Return in words the subscriptions by another type or quality, as ROS last knew."""
        return self._mismatches

    def trouble(self) -> str:
        """Return in words how the relay has ended; "" while it runs."""
        return f"the relay of rclpy {self._relay.ending}" if self._relay.has_ended else ""

    def environment(self) -> Mapping[str, str]:
        """Return the variables that a node of this run needs beside those it has."""
        return graph_environment(self._domain)

    def close(self) -> None:
        """End the relay's input, upon which it ends."""
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._reader.join()
        self._connection.close()

    def _send(self, kind: bytes, index: int, data: bytes) -> bool:
        with self._sending:
            try:
                self._connection.sendall(FRAME.pack(kind, index, len(data)))
                self._connection.sendall(data)
            except OSError:
                return False
        return True

    def _read(self) -> None:
        """Take what the relay sends, until it ends."""
        with suppress(OSError), self._connection.makefile("rb") as stream:
            while len(head := stream.read(FRAME.size)) == FRAME.size:
                kind, index, length = FRAME.unpack(head)
                data = stream.read(length)
                if kind == READY:
                    self.is_ready.set()
                elif kind == STATUS:
                    self._receive_graph(json.loads(data))
                elif kind == MESSAGE and len(data) == length:
                    name, take = self._listened[index]
                    take(InMessage(name, self._types[index], data))

    def _receive_graph(self, graph: dict[str, Any]) -> None:
        """Take who subscribes, and who publishes to us."""
        self._subscribers = {int(index): count for index, count in graph["subscribed"].items()}
        self._mismatches = graph["mismatches"]
        for index, publishers in graph["publishers"].items():
            name, take = self._listened[int(index)]
            for type_, sender in publishers:
                take(InMessage(name, type_, None, sender))


@asynccontextmanager
async def open_rclpy(
    python: str, *, domain: int, folder: Path, log: Path
) -> AsyncIterator[RclpyWire]:
    """Run a relay by a Python that has rclpy. Raises WireError.

    folder: to which the path of the Python is relative. log: of the relay.
    """
    ours, theirs = socket.socketpair()
    with ours, theirs:
        try:
            async with started_node(
                (python, str(_RELAY), str(theirs.fileno())),
                environment={**os.environ, **graph_environment(domain)},
                folder=folder,
                log=log,
                on_end=_ignore_end,
                inherited=(theirs.fileno(),),
            ) as relay:
                theirs.close()
                wire = RclpyWire(ours, relay, domain)
                try:
                    await asyncio.get_running_loop().run_in_executor(
                        None, _await_ready, wire, relay
                    )
                    yield wire
                finally:
                    wire.close()
        finally:
            theirs.close()


def _await_ready(wire: RclpyWire, relay: NodeProcess) -> None:
    """Wait until the relay is in the graph. Raises WireError."""
    until_s = time.monotonic() + _START_S
    while not wire.is_ready.wait(_LOOK_S):
        if relay.has_ended or time.monotonic() >= until_s:
            raise WireError(
                f"the relay of rclpy does not start ({relay}): {relay.last_lines()}; give the "
                "Python of your ROS by autonomy.ros2.python, and source its setup.bash first"
            )


def _ignore_end() -> None:
    """Take no notice of the relay's end: what is published then is refused."""


def graph_environment(domain: int) -> dict[str, str]:
    """Return the variables of ROS by which the graph of a run stays on this machine."""
    found = {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    if not {"FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"} & set(os.environ):
        found["FASTDDS_DEFAULT_PROFILES_FILE"] = str(_PROFILE)
    return found
