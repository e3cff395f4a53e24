"""The wire by zenoh: what a node sends comes in its order; services answer as rmw_zenoh's do."""

import json
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh

from wil_campaign.plugins.ros2.messages.ros_messages import TEXT, TWIST, RosMessages
from wil_campaign.plugins.ros2.messages.ros_types import dds_name, ros_name, ros_types
from wil_campaign.plugins.ros2.messages.topics import OWN
from wil_campaign.plugins.ros2.wire import InMessage, WireError
from wil_campaign.plugins.ros2.zenoh_wire import ZenohWire

TYPES = ros_types("jazzy")
SENT = 300


@contextmanager
def session_at(wire: ZenohWire) -> Iterator[Any]:
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([wire.endpoint]))
    with zenoh.open(config) as session:
        yield session


def test_messages_on_two_topics_come_in_the_order_of_the_node() -> None:
    """A word that a node sends before its answering setpoint is there when that is."""
    came: list[str] = []
    is_whole = threading.Event()

    def take(message: InMessage) -> None:
        came.append(message.topic)
        if len(came) == 2 * SENT:
            is_whole.set()

    wire = ZenohWire(domain=3, port=0, types=TYPES)
    try:
        wire.listen("/wil/done", TEXT, take)
        wire.listen("/cmd_vel", TWIST, take)
        with session_at(wire) as node:
            keys = [
                f"3{topic}/{dds_name(kind)}/{TYPES.hash(kind)}"
                for topic, kind in (("/wil/done", TEXT), ("/cmd_vel", TWIST))
            ]
            publishers: list[Any] = [
                node.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
                for key in keys
            ]
            word, setpoint = publishers
            until_s = time.monotonic() + 60.0
            while not all(publisher.matching_status.matching for publisher in publishers):
                assert time.monotonic() < until_s
                time.sleep(0.01)
            for _ in range(SENT):
                word.put(b"done")
                setpoint.put(b"setpoint")
            assert is_whole.wait(60.0), len(came)
    finally:
        wire.close()
    assert came == ["/wil/done", "/cmd_vel"] * SENT


SERVED = ("/wil/goal", "/wil/done", "/wil/abort")
HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
"""Of std_srvs/srv/Trigger, as the file Trigger.json of std_srvs says."""
GID = bytes(range(16))
KEY = "autonomy.ros2.distribution"
OURS = TYPES.hash(TEXT)


@pytest.fixture
def services() -> Iterator[tuple[ZenohWire, list[InMessage]]]:
    """Return a wire that offers the services of a run, and what they send."""
    came: list[InMessage] = []
    wire = ZenohWire(domain=3, port=0, types=TYPES)
    try:
        wire.advertise(next(one for one in OWN if one.name == "/wil/goal"), "/wil/goal")
        for name in SERVED[1:]:
            wire.listen(name, TEXT, came.append)
        yield wire, came
    finally:
        wire.close()


def call(session: Any, name: str, number: int) -> tuple[bool, str, tuple[int, bytes]]:
    """Call a service as rmw_send_request does; return success, message, number and name."""
    attachment = struct.pack("<qqB", number, 1, 16) + GID
    replies = session.get(
        f"3{name}/std_srvs::srv::dds_::Trigger_/{HASH}",
        target=zenoh.QueryTarget.ALL_COMPLETE,
        payload=b"\0\1\0\0\0",  # a request has one octet, for it has no fields
        attachment=attachment,
        timeout=60.0,
    )
    (reply,) = replies
    assert reply.ok is not None, reply.err
    data, attached = reply.ok.payload.to_bytes(), reply.ok.attachment.to_bytes()
    answered, sent_ns, length = struct.unpack_from("<qqB", attached)
    assert (length, time.time_ns() - sent_ns < 600e9) == (16, True)
    (size,) = struct.unpack_from("<I", data, 8)
    return bool(data[4]), data[12 : 12 + size - 1].decode(), (answered, attached[17:])


def test_services_answer_what_calls_them(
    services: tuple[ZenohWire, list[InMessage]],
) -> None:
    wire, came = services
    with session_at(wire) as node:
        assert call(node, "/wil/goal", 7) == (False, "", (7, GID))
        assert wire.is_subscribed("/wil/goal")  # the service has to know the newest
        wire.publish("/wil/goal", RosMessages(TYPES).text('{"altitude_m": 1.2}'), 0)
        assert call(node, "/wil/goal", 8) == (True, '{"altitude_m": 1.2}', (8, GID))
        assert call(node, "/wil/done", 1) == (True, "", (1, GID))
        assert call(node, "/wil/abort", 2) == (True, "", (2, GID))
    texts = [TYPES.deserialize(one.cdr or b"", TEXT).data for one in came]
    assert [one.topic for one in came] == ["/wil/done", "/wil/abort"]
    assert texts == ["by the service /wil/done", "by the service /wil/abort"]


def test_the_graph_shows_the_services(services: tuple[ZenohWire, list[InMessage]]) -> None:
    wire, _ = services
    with session_at(wire) as node:
        found = [str(one.ok.key_expr) for one in node.liveliness().get("@ros2_lv/3/**")]
    tokens = sorted(one.partition("/SS/")[2] for one in found if "/SS/" in one)
    ends = f"std_srvs::srv::dds_::Trigger_/{HASH}/1:2:1,10:,:,:,,"
    assert tokens == [f"%/%/wil/%wil%{name}/{ends}" for name in ("abort", "done", "goal")]


@pytest.mark.parametrize(
    ("dds", "hash_", "fault"),
    [
        ("std_msgs::msg::dds_::String_", TYPES.hash(TEXT), ""),
        (
            "std_msgs::msg::dds_::String_",
            "TypeHashNotSupported",
            f" of another ROS, whose hash is TypeHashNotSupported and not {OURS} ({KEY})",
        ),
        (
            "std_msgs::msg::dds_::Bool_",
            TYPES.hash(TEXT),
            ", not std_msgs/msg/String",
        ),
    ],
)
def test_subscriptions_that_do_not_match_are_named(
    services: tuple[ZenohWire, list[InMessage]], dds: str, hash_: str, fault: str
) -> None:
    wire, _ = services
    with session_at(wire) as node:
        of = "@ros2_lv/3/1/0/1/MS/%/%/old/%wil%goal"
        token = node.liveliness().declare_token(f"{of}/{dds}/{hash_}/::,:,:,:,,")
        until_s = time.monotonic() + 60.0
        while not list(node.liveliness().get(f"{of}/**")):
            assert time.monotonic() < until_s
            time.sleep(0.01)
        named = f"the node old subscribes to /wil/goal with {ros_name(dds)}{fault}"
        assert wire.mismatches() == ([named] if fault else [])
        token.undeclare()


def test_a_router_that_runs_already_is_named() -> None:
    wire = ZenohWire(domain=3, port=0, types=TYPES)
    try:
        port = int(wire.endpoint.rpartition(":")[2])
        with pytest.raises(WireError, match=r"zenoh cannot listen at .*; end the router there"):
            ZenohWire(domain=3, port=port, types=TYPES)
    finally:
        wire.close()
