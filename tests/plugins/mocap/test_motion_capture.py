"""Motion capture: messages, statistics, and the ways in."""

import asyncio
import json
import math
import re
import socket
import sys
from datetime import UTC, datetime
from types import ModuleType
from typing import Any

import msgpack  # type: ignore[import-untyped]  # ships no types
import numpy as np
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from tests.test_house import ROOT
from wil_campaign.plugins.mocap.capture_inputs import UdpCapture, ZmqCapture
from wil_campaign.plugins.mocap.motion_capture import (
    CaptureDecoder,
    decode_frame,
    pose_from_enu,
)
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.feed_statistics import FeedMeter
from wil_campaign.worlds.frames import (
    Pose,
    angle_between,
    frd_from_flu,
    ned_from_enu,
    quat_from_euler,
    rotate,
)


def frame(seq: int, t_s: float, north_m: float = 1.0, **changed: Any) -> dict[str, Any]:
    body = {"name": "drone", "position_m": [north_m, 2.0, -3.0], "q_wxyz": [1.0, 0.0, 0.0, 0.0]}
    message = {"protocol": "wil/mocap/1", "seq": seq, "t_s": t_s, "frame": "ned", "bodies": [body]}
    return message | changed


def packed(*arguments: Any, **changed: Any) -> bytes:
    data: bytes = msgpack.packb(frame(*arguments, **changed))
    return data


def capture() -> CaptureDecoder:
    return CaptureDecoder(bodies={"drone": "real"}, latency_s=0.004)


def test_a_message_becomes_a_reading() -> None:
    (reading,) = capture().receive(packed(0, 500.0), 10.0)
    assert reading.pose == Pose((1.0, 2.0, -3.0))
    assert (reading.source, reading.seq, reading.arrived_s) == ("real", 0, 10.0)
    assert reading.t_s == pytest.approx(9.996)
    assert reading.velocity_ned_m_s is None


def test_json_says_the_same() -> None:
    (a,) = capture().receive(packed(0, 500.0), 10.0)
    (b,) = capture().receive(json.dumps(frame(0, 500.0)).encode(), 10.0)
    assert a == b


def test_velocity_and_enu_are_turned() -> None:
    body = {
        "name": "drone",
        "position_m": [2.0, 1.0, 3.0],
        # Nose to the east, level: in ENU with FLU axes this is no turn at all.
        "q_wxyz": [2.0, 0.0, 0.0, 0.0],
        "velocity_m_s": [0.5, 0.0, 0.1],
    }
    (reading,) = capture().receive(packed(0, 1.0, frame="enu", bodies=[body]), 1.0)
    assert reading.pose.position_ned_m == (1.0, 2.0, -3.0)
    assert reading.pose.yaw_rad == pytest.approx(math.pi / 2)
    assert reading.velocity_ned_m_s == (0.0, 0.5, -0.1)


angles = st.floats(-3.1, 3.1)


@given(angles, angles, angles, st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_turned_body_moves_its_points_as_before(
    roll: float, pitch: float, yaw: float, point_flu: tuple[float, float, float]
) -> None:
    q_enu = quat_from_euler(roll, pitch, yaw)
    pose = pose_from_enu((0.0, 0.0, 0.0), q_enu)
    in_enu = rotate(q_enu, point_flu)
    in_ned = rotate(pose.q_wxyz, frd_from_flu(point_flu))
    assert ned_from_enu(in_ned) == pytest.approx(in_enu, abs=1e-9)


def test_statistics_tell_rate_latency_and_dropouts() -> None:
    feed = capture()
    for k in range(200):
        if k in {50, 120, 121, 122, 123, 124}:
            continue
        late_s = 0.004 + (0.003 if k % 10 == 5 else 0.0)
        feed.receive(packed(k, 500.0 + k / 100), k / 100 + late_s)
    figures = feed.statistics("drone")
    assert figures.samples == 194
    assert figures.rate_hz == pytest.approx(97.0, abs=1.0)
    assert figures.latency_ms_p50 == pytest.approx(4.0, abs=0.1)
    assert figures.latency_ms_p99 == pytest.approx(7.0, abs=0.1)
    assert figures.missing == 6
    assert figures.dropouts == 1
    assert figures.longest_gap_s == pytest.approx(0.06)


def test_a_body_that_is_not_seen_is_invalid_and_keeps_its_number() -> None:
    feed = capture()
    feed.receive(packed(0, 1.0), 1.0)
    unseen = {"name": "drone", "valid": False}
    assert feed.receive(packed(1, 1.01, bodies=[unseen]), 1.01) == []
    assert feed.receive(packed(2, 1.02, bodies=[]), 1.02) == []
    (reading,) = feed.receive(packed(3, 1.03), 1.03)
    assert reading.seq == 3
    assert feed.statistics("drone").invalid == 2


def test_a_pose_that_comes_late_or_twice_is_dropped() -> None:
    feed = capture()
    feed.receive(packed(0, 1.00), 1.00)
    feed.receive(packed(2, 1.02), 1.02)
    assert feed.receive(packed(1, 1.01), 1.03) == []
    assert feed.receive(packed(2, 1.02), 1.03) == []
    assert len(feed.receive(packed(3, 1.03), 1.04)) == 1
    assert feed.statistics("drone").out_of_order == 2


@pytest.mark.parametrize("number", [3, 100_000])
def test_a_sender_that_starts_anew_is_followed(number: int) -> None:
    feed = capture()
    feed.receive(packed(number, 5000.0), 1.0)
    (reading,) = feed.receive(packed(0, 0.0), 2.0)
    assert reading.t_s == pytest.approx(1.996)
    (reading,) = feed.receive(packed(1, 0.01), 2.01)
    assert reading.t_s == pytest.approx(2.006)
    (reading,) = feed.receive(packed(0, 5.0), 3.0)
    assert reading.t_s == pytest.approx(2.996), "its clock is the machine's"
    assert feed.statistics("drone").restarts == 2


def test_two_systems_at_one_socket_are_not_taken_for_one() -> None:
    """As behind a relay: each of them, alone, would be the vehicle."""
    feed = capture()
    for k in range(3):
        feed.receive(packed(k, 1.0 + k / 100), k / 100)
    for k in range(3, 200):
        feed.receive(packed(k, 1.0 + k / 100), k / 100)
        feed.receive(packed(9000 + k, 700.0 + k / 100, 5.0), k / 100 + 0.002)
    figures = feed.statistics("drone")
    assert figures.samples < 10
    assert figures.missing == 0, "by the numbers of another"
    assert feed.garbage > 380
    assert "there are two senders, or its stamps are not seconds" in feed.complaint
    for k in range(200, 1000):
        feed.receive(packed(k, 1.0 + k / 100), k / 100)
    assert feed.statistics("drone").samples > 250, "it is heard again once it is alone"


def test_bodies_are_distinguished() -> None:
    feed = CaptureDecoder(bodies={"a": "real", "b": "twin"})
    pose = {"position_m": [0, 0, 0], "q_wxyz": [1, 0, 0, 0]}
    bodies = [{"name": name, **pose} for name in ("c", "b", "a")]
    readings = feed.receive(packed(0, 1.0, bodies=bodies), 1.0)
    assert [reading.source for reading in readings] == ["real", "twin"]


GARBAGE = [
    (b"", "MessagePack"),
    (b"{broken", "JSON"),
    (b"{" * 5000, "JSON"),
    (b"[1]", "MessagePack|not a map"),
    (packed(0, 1.0, protocol="wil/mocap/2"), "speaks"),
    (packed(0, 1.0, frame="xyz"), "'ned' and 'enu'"),
    (packed(-1, 1.0), "`seq`"),
    (packed(0, float("nan")), "`t_s`"),
    (packed(0, 1.0, bodies=7), "list of maps"),
    (packed(0, 1.0, bodies=[7]), "not a map"),
    (packed(0, 1.0, bodies=[{}] * 65), "65 bodies"),
    (packed(0, 1.0, bodies=[{"name": "drone"}]), "`position_m` is missing"),
    (packed(0, 1.0, bodies=frame(0, 1.0)["bodies"] * 2), "lists a name twice"),
    (
        packed(0, 1.0, bodies=[{"name": "d", "position_m": [0] * 3, "q_wxyz": [0] * 4}]),
        "no direction",
    ),
    (
        packed(0, 1.0, bodies=[{"name": "d", "position_m": [0, 0, 1e999], "q_wxyz": [1, 0, 0, 0]}]),
        "finite",
    ),
]


@pytest.mark.parametrize(("data", "words"), GARBAGE)
def test_garbage_is_counted_and_reported(data: bytes, words: str) -> None:
    with pytest.raises(BadMessageError, match=words):
        decode_frame(data)
    feed = capture()
    assert feed.receive(data, 1.0) == []
    assert feed.garbage == 1
    assert feed.complaint
    assert len(feed.receive(packed(0, 1.0), 1.0)) == 1


@given(st.binary(max_size=200) | st.text().map(str.encode))
def test_any_bytes_are_survived(data: bytes) -> None:
    feed = capture()
    assert feed.receive(data, 1.0) == []
    assert feed.garbage == 1


def test_statistics_need_no_more_memory_with_time() -> None:
    meter = FeedMeter()
    for k in range(10_000):
        meter.add(t_s=k / 100, arrived_s=k / 100 + 0.01)
    assert len(meter._times) == 2000
    assert meter.statistics().samples == 10_000
    assert meter.statistics().rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize(("count", "p50", "p99"), [(1, 1, 1), (2, 1, 2), (100, 50, 99)])
def test_the_latency_is_by_nearest_rank_as_that_of_mixtures(count: int, p50: int, p99: int) -> None:
    meter = FeedMeter()
    for k in range(1, count + 1):
        meter.add(t_s=float(k), arrived_s=k + k / 1024)
    found = meter.statistics()
    assert (found.latency_ms_p50, found.latency_ms_p99) == (p50 * 1000 / 1024, p99 * 1000 / 1024)


async def gathered(readings: list[PoseReading], count: int) -> None:
    for _ in range(300):
        if len(readings) >= count:
            return
        await asyncio.sleep(0.01)
    pytest.fail(f"{len(readings)} readings came")


async def test_datagrams_come_in() -> None:
    readings: list[PoseReading] = []
    feed = capture()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        async with UdpCapture(
            host="127.0.0.1", port=0, capture=feed, deliver=readings.append
        ) as udp:
            port = udp.port
            for data in (packed(0, 1.0, 4.0), b"rubbish", packed(1, 1.01, 5.0)):
                out.sendto(data, ("127.0.0.1", port))
            await gathered(readings, 2)
        out.sendto(packed(2, 1.02), ("127.0.0.1", port))
        await asyncio.sleep(0.02)
    assert [reading.pose.position_ned_m[0] for reading in readings] == [4.0, 5.0]
    assert feed.garbage == 1
    assert abs(readings[0].arrived_s - asyncio.get_running_loop().time()) < 5.0


async def await_dropped(udp: UdpCapture, others: int) -> None:
    for _ in range(300):
        if len(udp.others) >= others:
            return
        await asyncio.sleep(0.01)
    pytest.fail(f"{udp.others} were noticed")


def sender() -> socket.socket:
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("127.0.0.1", 0))
    return end


async def test_poses_of_a_second_sender_are_never_mixed_in() -> None:
    readings: list[PoseReading] = []
    feed = capture()
    inputs = UdpCapture(host="127.0.0.1", port=0, capture=feed, deliver=readings.append)
    async with inputs as udp:
        with sender() as noise, sender() as system, sender() as stranger:
            where = ("127.0.0.1", udp.port)
            noise.sendto(b"rubbish", where)  # who sends no poses takes nobody's place
            system.sendto(packed(0, 1.0, 4.0), where)
            await gathered(readings, 1)
            stranger.sendto(packed(7, 1.01, 99.0), where)
            await await_dropped(udp, 1)
            system.sendto(packed(1, 1.02, 5.0), where)
            await gathered(readings, 2)
            other, own = stranger.getsockname()[1], system.getsockname()[1]
            assert udp.rivals == (
                f"motion capture on UDP 127.0.0.1:0 is sent to by 127.0.0.1:{other} as well as by "
                f"127.0.0.1:{own}, whose poses alone are taken"
            )
    assert [reading.pose.position_ned_m[0] for reading in readings] == [4.0, 5.0]
    assert feed.statistics("drone").missing == 0


async def test_the_sender_that_the_campaign_names_is_taken_even_when_it_comes_second() -> None:
    readings: list[PoseReading] = []
    with sender() as system, sender() as stranger:
        named = f"127.0.0.1:{system.getsockname()[1]}"
        inputs = UdpCapture(
            host="127.0.0.1", port=0, capture=capture(), deliver=readings.append, sender=named
        )
        async with inputs as udp:
            where = ("127.0.0.1", udp.port)
            stranger.sendto(packed(0, 1.0, 99.0), where)
            await await_dropped(udp, 1)
            system.sendto(packed(0, 1.0, 4.0), where)
            await gathered(readings, 1)
            assert udp.rivals == ""
            assert f"as well as by {named}" in "".join(udp.others.values())
    assert [reading.pose.position_ned_m[0] for reading in readings] == [4.0]


async def test_a_port_that_is_taken_is_reported() -> None:
    async with UdpCapture(host="127.0.0.1", port=0, capture=capture(), deliver=print) as first:
        with pytest.raises(SourceError, match=f"UDP 127.0.0.1:{first.port}.*another"):
            async with UdpCapture(
                host="127.0.0.1", port=first.port, capture=capture(), deliver=print
            ):
                pass


async def test_a_publisher_is_received() -> None:
    readings: list[PoseReading] = []
    context = zmq.Context()
    try:
        publisher = context.socket(zmq.PUB)
        port = publisher.bind_to_random_port("tcp://127.0.0.1")
        async with ZmqCapture(
            address=f"tcp://127.0.0.1:{port}",
            capture=capture(),
            deliver=readings.append,
            topic=b"mocap",
        ):
            for k in range(3000):
                publisher.send_multipart([b"mocap", packed(k, 1.0 + k / 100)])
                publisher.send_multipart([b"other", b"rubbish"])
                await asyncio.sleep(0.005)
                if len(readings) > 10:
                    break
    finally:
        context.destroy(linger=0)
    seqs = [reading.seq for reading in readings]
    assert len(readings) > 10
    assert np.all(np.diff(seqs) == 1)


async def test_a_text_that_is_no_address_is_reported() -> None:
    with pytest.raises(SourceError, match="not a valid address"):
        async with ZmqCapture(address="hall", capture=capture(), deliver=print):
            pass


def test_the_bridge_of_the_page_sends_what_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """VRPN's own binding is on no package index: what it reports here is what it documents."""

    class Tracker:
        def __init__(self, address: str) -> None:
            assert address == "drone@10.0.0.1"

        def register_change_handler(self, userdata: object, handler: Any, kind: str) -> None:
            self.handler = handler

        def mainloop(self) -> None:
            at = datetime.fromtimestamp(100.01, UTC)
            pose = {"position": (2.0, 1.0, 3.0), "quaternion": (0.0, 0.0, 0.0, 1.0)}
            self.handler(None, {"sensor": 0, "time": at, **pose})
            raise StopIteration

    module, receiver = ModuleType("vrpn"), ModuleType("receiver")
    receiver.Tracker = Tracker  # type: ignore[attr-defined]
    module.receiver = receiver  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "vrpn", module)
    page = (ROOT / "docs" / "motion-capture.md").read_text("utf-8")
    (source,) = re.findall(r"^```python\n(import json\n.+?)^```$", page, re.MULTILINE | re.DOTALL)
    bridge: dict[str, Any] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.bind(("127.0.0.1", 0))
        with pytest.raises(StopIteration):
            exec(source.replace("5570", str(port.getsockname()[1])), bridge)  # noqa: S102
        bridge["out"].close()
        sent = decode_frame(port.recv(65536))
    assert (sent.seq, sent.t_s) == (0, 100.01)
    (body,) = sent.bodies
    assert body.name == "drone"
    assert body.pose is not None
    assert body.pose.position_ned_m == (1.0, 2.0, -3.0)
    east = Pose.of(0.0, 0.0, 0.0, yaw_rad=math.pi / 2)
    assert angle_between(body.pose.q_wxyz, east.q_wxyz) == pytest.approx(0.0, abs=1e-9)
