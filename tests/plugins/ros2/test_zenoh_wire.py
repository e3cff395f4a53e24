"""The wire by zenoh: what a node sends comes in its order."""

import json
import threading
import time
from typing import Any

import zenoh

from wil_campaign.plugins.ros2.messages.ros_messages import TEXT, TWIST
from wil_campaign.plugins.ros2.messages.ros_types import dds_name, ros_types
from wil_campaign.plugins.ros2.wire import InMessage
from wil_campaign.plugins.ros2.zenoh_wire import ZenohWire

TYPES = ros_types("jazzy")
SENT = 300


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
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([wire.endpoint]))
        with zenoh.open(config) as node:
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
            while not all(one.matching_status.matching for one in publishers):
                assert time.monotonic() < until_s
                time.sleep(0.01)
            for _ in range(SENT):
                word.put(b"done")
                setpoint.put(b"setpoint")
            assert is_whole.wait(60.0), len(came)
    finally:
        wire.close()
    assert came == ["/wil/done", "/cmd_vel"] * SENT
