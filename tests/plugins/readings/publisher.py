"""A program that publishes readings, for tests."""

import asyncio
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import zmq

from wil_campaign.plugins.readings.reading_message import PROTOCOL
from wil_campaign.worlds.camera import Intrinsics

REACH = {"range_min_m": 0.1, "range_max_m": 12.0}
LENS = Intrinsics.from_fov(3, 2, 1.2)
"""Of the depth camera whose messages these are."""
ALL: dict[str, dict[str, Any]] = {
    "depth": {"camera": {"width_px": 3, "height_px": 2}, "depth_m": [1, 2, 3, None, 5, 6.5]},
    "rangefinder": {"range_m": 1.5, **REACH},
    "lidar": {"ranges_m": [1.0, None, 2.5], "start_angle_rad": -1.0, "step_rad": 1.0, **REACH},
    "lidar_points": {"points_frd_m": [1, 0, 0, 0, 2.5, 0]},
    "imu": {"specific_force_frd_m_s2": [0, 0, -9.8], "rates_frd_rad_s": [0, 0, 0.1]},
    "gps": {
        "latitude_deg": 47.4,
        "longitude_deg": 8.5,
        "altitude_m": 488.0,
        "velocity_ned_m_s": [1, 2, 3],
        "horizontal_accuracy_m": 1.0,
        "vertical_accuracy_m": 2.0,
    },
    "pose": {"position_ned_m": [1, 2, -3], "q_wxyz": [2, 0, 0, 0]},
    "microphone": {"samples": [0, -32768, 32767], "sample_rate_hz": 8000, "full_scale_pa": 2.0},
}


def message(kind: str, seq: int = 0, t_s: float = 100.0, **changes: Any) -> dict[str, Any]:
    head = {"protocol": PROTOCOL, "sensor": "one", "type": kind, "seq": seq, "t_s": t_s}
    return head | ALL[kind] | changes


class Publisher:
    """A program that publishes messages."""

    def __init__(self) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        self.address = f"tcp://127.0.0.1:{self._socket.bind_to_random_port('tcp://127.0.0.1')}"

    def send(self, *messages: dict[str, Any]) -> None:
        for one in messages:
            self._socket.send_multipart([b"topic", msgpack.packb(one)])

    def close(self) -> None:
        self._context.destroy(linger=0)


async def publishing(publisher: Publisher, kind: str, hz: float = 50.0, **changes: Any) -> None:
    """Publish readings until cancelled, on a clock of their own."""
    seq, loop = 0, asyncio.get_running_loop()
    while True:
        if kind == "microphone":
            changes["samples"] = [seq % 1000, 1, 2]  # The same sound again would be a frozen one.
        publisher.send(message(kind, seq, loop.time() - 1000.0, **changes))
        seq += 1
        await asyncio.sleep(1.0 / hz)
