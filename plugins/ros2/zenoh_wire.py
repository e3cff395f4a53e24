"""The wire by zenoh, as rmw_zenoh has it: keys, attachments and tokens; no ROS is needed.

The session is a router on loopback, of one run: nodes connect to it and to each other. Its formats
are those of rmw_zenoh_cpp from 0.2 on (docs/design.md there, attachment_helpers.cpp).
"""

import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping
from itertools import count
from typing import Any

import zenoh
import zenoh.handlers

from wil_campaign.plugins.ros2.messages.ros_messages import TEXT, RosMessages
from wil_campaign.plugins.ros2.messages.ros_types import RosTypes, dds_name, ros_name
from wil_campaign.plugins.ros2.messages.topics import ABORT, DONE, GOAL, OutTopic
from wil_campaign.plugins.ros2.messages.trigger import TRIGGER, trigger_response
from wil_campaign.plugins.ros2.wire import InMessage, Take, WireError

_HOST = "127.0.0.1"
_GID_BYTES = 16
_TRIES = 8
_QUALITIES = {"reliable": "1:2:1,10:,:,:,,", "latched": "1:1:1,1:,:,:,,"}
"""Reliability, durability and history of rmw/types.h, as liveliness tokens have them."""
_NODE = "wil"
_KIND_PART, _NODE_PART, _HASH_PART = 5, 8, 11
"""Of a token's key: what it is of, and where its node's name begins what follows to the hash."""
_ATTACHMENT = struct.Struct("<qqB")


class ZenohWire:
    """Publishes and listens by zenoh in a domain of ROS. Raises WireError.

    port: of loopback, to listen on; 0 for a free one. Nodes that run already look for 7447.
    """

    def __init__(self, *, domain: int, port: int, types: RosTypes) -> None:
        self._domain = domain
        self._types = types
        self._session, self.endpoint = _open_session(port)
        self._entities = count(1)
        self._lock = threading.Lock()
        self._publishers: dict[str, _Publisher] = {}
        self._subscribers: list[Any] = []
        self._latest: dict[str, bytes] = {}
        """What was published last on topics that a service tells."""
        self._tokens: list[Any] = []
        self._zid = str(self._session.info.zid())
        self._declare_token(f"@ros2_lv/{domain}/{self._zid}/0/0/NN/%/%/{_NODE}")

    def advertise(self, topic: OutTopic, name: str) -> None:
        """Offer a topic: a publisher, and its token in the graph."""
        hash_ = self._types.hash(topic.type)
        key = f"{self._domain}{name}/{dds_name(topic.type)}/{hash_}"
        # A node that is late gets each message all the same: none is dropped on our side.
        publisher = self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK, express=True
        )
        entity = next(self._entities)
        gid = entity.to_bytes(_GID_BYTES, "little")
        self._publishers[name] = _Publisher(publisher, gid, topic.type, hash_)
        self._declare_entity(f"{entity}/MP", name, topic.type, _QUALITIES[topic.quality])
        if topic.name == GOAL:
            self._latest[name] = b""
            self._serve(name, lambda: self._newest_text(name))

    def listen(self, name: str, type_: str, take: Take) -> None:
        """Call `take` with each message on a topic."""

        def on_sample(sample: Any) -> None:
            parts = str(sample.key_expr).rsplit("/", 2)
            found = ros_name(parts[-2]) if len(parts) == 3 else ""
            attached = b"" if sample.attachment is None else sample.attachment.to_bytes()
            take(InMessage(name, found, sample.payload.to_bytes(), _sender(attached)))

        # Not in a thread for each topic: a word that is sent before a setpoint comes before it.
        in_order = zenoh.handlers.Callback(on_sample, indirect=False)
        subscriber = self._session.declare_subscriber(f"{self._domain}{name}/*/*", in_order)
        self._subscribers.append(subscriber)
        self._declare_entity(f"{next(self._entities)}/MS", name, type_, _QUALITIES["reliable"])
        if name in {ABORT, DONE}:
            by_service = RosMessages(self._types).text(f"by the service {name}")

            def send() -> bytes:
                take(InMessage(name, TEXT, by_service))
                return trigger_response("", is_success=True)

            self._serve(name, send)

    def is_subscribed(self, name: str) -> bool:
        """Return whether anybody subscribes to an advertised topic, or a service tells it."""
        is_matched = bool(self._publishers[name].publisher.matching_status.matching)
        return is_matched or name in self._latest

    def publish(self, name: str, cdr: bytes, stamp_ns: int) -> bool:
        """Publish a message; return whether zenoh took it."""
        if name in self._latest:
            self._latest[name] = cdr
        one = self._publishers[name]
        with self._lock:
            one.sent += 1
            attachment = _ATTACHMENT.pack(one.sent, stamp_ns, _GID_BYTES) + one.gid
        try:
            one.publisher.put(cdr, attachment=attachment)
        except zenoh.ZError:
            return False
        return True

    def mismatches(self) -> list[str]:
        """Return in words the subscriptions by another type, or by that of another ROS."""
        found = []
        for reply in self._session.liveliness().get(f"@ros2_lv/{self._domain}/**"):
            parts = [] if reply.ok is None else str(reply.ok.key_expr).split("/")
            if len(parts) <= _HASH_PART or parts[_KIND_PART] != "MS":
                continue
            node, topic, dds, hash_ = parts[_NODE_PART : _HASH_PART + 1]
            ours = self._publishers.get(topic.replace("%", "/"))
            if ours is None or (ros_name(dds), hash_) == (ours.type, ours.hash):
                continue
            where = f"the node {node} subscribes to {topic.replace('%', '/')}"
            if ros_name(dds) != ours.type:
                found.append(f"{where} with {ros_name(dds)}, not {ours.type}")
            else:
                found.append(
                    f"{where} with {ours.type} of another ROS, whose hash is {hash_} and not "
                    f"{ours.hash} (autonomy.ros2.distribution)"
                )
        return sorted(found)

    def trouble(self) -> str:
        """Return "": the session is in this process."""
        return ""

    def environment(self) -> Mapping[str, str]:
        """Return the variables of rmw_zenoh, and the address for other programs."""
        return {
            "RMW_IMPLEMENTATION": "rmw_zenoh_cpp",
            "ZENOH_CONFIG_OVERRIDE": f'connect/endpoints=["{self.endpoint}"]',
            "WIL_ZENOH_ENDPOINT": self.endpoint,
        }

    def close(self) -> None:
        """Close the session."""
        self._session.close()

    def _newest_text(self, name: str) -> bytes:
        """Return the answer of a service that tells the newest text of a topic."""
        cdr = self._latest[name]
        text = str(self._types.deserialize(cdr, TEXT).data) if cdr else ""
        return trigger_response(text, is_success=bool(cdr))

    def _serve(self, name: str, answer: Callable[[], bytes]) -> None:
        """Offer a service of std_srvs/Trigger: a queryable, and its token in the graph."""
        key = f"{self._domain}{name}/{dds_name(TRIGGER)}/{self._types.hash(TRIGGER)}"

        def on_query(query: Any) -> None:
            # The client knows its answer by the number and the name that it sent.
            attached = b"" if query.attachment is None else query.attachment.to_bytes()
            query.reply(key, answer(), attachment=_answered(attached))

        in_order = zenoh.handlers.Callback(on_query, indirect=False)
        self._subscribers.append(self._session.declare_queryable(key, in_order, complete=True))
        self._declare_entity(f"{next(self._entities)}/SS", name, TRIGGER, _QUALITIES["reliable"])

    def _declare_entity(self, entity: str, name: str, type_: str, quality: str) -> None:
        """Declare a publisher (MP), subscriber (MS) or service (SS), so that `ros2` lists it.

        entity: its number and kind.
        """
        of = f"@ros2_lv/{self._domain}/{self._zid}/0/{entity}/%/%/{_NODE}"
        topic, hash_ = name.replace("/", "%"), self._types.hash(type_)
        self._declare_token(f"{of}/{topic}/{dds_name(type_)}/{hash_}/{quality}")

    def _declare_token(self, key: str) -> None:
        self._tokens.append(self._session.liveliness().declare_token(key))


class _Publisher:
    def __init__(self, publisher: Any, gid: bytes, type_: str, hash_: str) -> None:
        self.publisher = publisher
        self.gid = gid
        self.type, self.hash = type_, hash_
        self.sent = 0


def _open_session(port: int) -> tuple[Any, str]:
    """Return a session that listens on a port, and its address. Raises WireError."""
    # zenoh does not say which port it got; a free one may be taken until it listens.
    for _ in range(1 if port else _TRIES):
        endpoint = f"tcp/{_HOST}:{port or _free_port()}"
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", f'["{endpoint}"]')
        try:
            return zenoh.open(config), endpoint
        except zenoh.ZError as error:
            reason = str(error).partition(" at /")[0]
    remedy = "; end the router there (rmw_zenohd): the run is the router of its nodes"
    raise WireError(f"zenoh cannot listen at {endpoint}: {reason}{remedy if port else ''}")


def _free_port() -> int:
    with socket.socket() as free:
        free.bind((_HOST, 0))
        return int(free.getsockname()[1])


def _answered(attachment: bytes) -> bytes:
    """Return the attachment of an answer: the request's, with the time of the answer."""
    if len(attachment) < _ATTACHMENT.size:
        return attachment
    number, _, length = _ATTACHMENT.unpack_from(attachment)
    return _ATTACHMENT.pack(number, time.time_ns(), length) + attachment[_ATTACHMENT.size :]


def _sender(attachment: bytes) -> str:
    """Return the publisher in a message's attachment; "" without one."""
    if len(attachment) < _ATTACHMENT.size + _GID_BYTES:
        return ""
    return attachment[_ATTACHMENT.size :][:_GID_BYTES].hex()
