"""Depth images by RTP, from a real encoder, and by a stand-in for RealSense's library."""

import asyncio
import math
import socket
import struct
import sys
import threading
from collections.abc import Callable
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest

from tests.ports import free_port
from wil_campaign.plugins.depth_cameras import depth_grabber
from wil_campaign.plugins.depth_cameras.depth_grabber import GrabbedDepth, GrabbedReadings
from wil_campaign.plugins.depth_cameras.realsense import open_realsense, realsense_fault
from wil_campaign.plugins.depth_cameras.rtp_depth import (
    DepthLines,
    open_rtp_depth,
    rtp_depth_fault,
)
from wil_campaign.vehicles.readings import DepthReading
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.sources.camera_source import SourceError, SourceStalledError
from wil_campaign.vehicles.sources.source_request import SourceRequest
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

WIDTH, HEIGHT = 160, 120
LENS = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)


def request(address: str, **changes: Any) -> SourceRequest:
    given: dict[str, Any] = {
        "address": address,
        "sensor": "depth",
        "kind": "depth",
        "side": "real",
        "mount": AT_ORIGIN,
        "camera": LENS,
        "rate_hz": 15.0,
        "topic": "",
        "latency_s": 0.0,
        "open_s": 20.0,
        "stall_s": 20.0,
    }
    return SourceRequest(**given | changes)


def millimetres(number: int) -> Any:
    """Return an image that no other one is like: all 16 bits are used, and 0 is there."""
    ramp = np.arange(WIDTH * HEIGHT, dtype=np.uint32) * 37 + 1000 * number
    values = ramp.astype(np.uint16).reshape(HEIGHT, WIDTH)
    values[5, 5] = 0
    return values


class Encoder:
    """FFmpeg's own encoder and RTP sender: two bytes a pixel, the higher one first."""

    def __init__(self, port: int) -> None:
        self._out = av.open(f"rtp://127.0.0.1:{port}?pkt_size=1400", "w", format="rtp")
        self._stream: Any = self._out.add_stream("rawvideo", rate=15)
        self._stream.width, self._stream.height = WIDTH, HEIGHT
        self._stream.pix_fmt = "uyvy422"
        self._stream.options = {"field_order": "progressive"}
        self._stream.time_base = Fraction(1, 90_000)
        self._sent = 0

    def send(self, values: Any) -> None:
        frame: Any = av.VideoFrame(WIDTH, HEIGHT, "uyvy422")
        frame.planes[0].update(values.astype(">u2").tobytes())
        frame.pts, frame.time_base = 6000 * self._sent, Fraction(1, 90_000)
        self._sent += 1
        for packet in self._stream.encode(frame):
            self._out.mux(packet)

    def close(self) -> None:
        self._out.close()


async def test_a_real_encoder_s_16_bits_arrive_as_they_were() -> None:
    port = free_port()
    encoder, sent = Encoder(port), [millimetres(k) for k in range(60)]

    async def send() -> None:
        while True:
            for values in sent:
                encoder.send(values)
                await asyncio.sleep(1.0 / 15.0)

    sending = asyncio.create_task(send())
    try:
        async with open_rtp_depth(request(f"rtp://127.0.0.1:{port}")) as live:
            found = [await anext(live) for _ in range(6)]
            assert live.counts.delivered == 6
    finally:
        sending.cancel()
        encoder.close()
    for reading in found:
        assert isinstance(reading, DepthReading)
        assert reading_fault(reading) is None
        first = next(k for k, values in enumerate(sent) if values[0, 1] == round_mm(reading)[0, 1])
        assert np.array_equal(round_mm(reading), sent[first])
        assert math.isinf(reading.depth_m[5, 5]), "0 is nothing"
    times = [one.t_s for one in found]
    # An image that is less late than those before it corrects the clock once, by milliseconds.
    by_sender = np.median(np.diff(times))
    assert by_sender == pytest.approx(1.0 / 15.0, abs=1e-3), "by the stamps of the sender"


def round_mm(reading: DepthReading) -> Any:
    seen = np.where(np.isinf(reading.depth_m), 0.0, reading.depth_m)
    return np.round(seen * 1000.0).astype(np.uint16)


def packets(values: Any, stamp: int, *, lines_each: int = 2, sender: int = 7) -> list[bytes]:
    """Return an image's packets, of whole lines, the last one marked."""
    made: list[bytes] = []
    height, width = values.shape
    for first in range(0, height, lines_each):
        lines = range(first, min(first + lines_each, height))
        heads = b"".join(
            struct.pack(">HHH", 2 * width, line, 0x8000 if line != lines[-1] else 0)
            for line in lines
        )
        pixels = b"".join(values[line].astype(">u2").tobytes() for line in lines)
        is_last = 0x80 if lines[-1] == height - 1 else 0
        head = struct.pack(">BBHII", 0x80, is_last | 96, first, stamp, sender)
        made.append(head + b"\0\0" + heads + pixels)
    return made


def test_an_image_with_a_lost_line_is_never_handed_on() -> None:
    values = np.arange(1, 25).reshape(6, 4)
    lines = DepthLines(width_px=4, height_px=6)
    first, second, third = (packets(values, stamp) for stamp in (90, 180, 2**32 - 90))
    assert [lines.receive(one) for one in third[:-1]] == [None, None]
    assert "8 of 24" not in str(lines.receive(third[-1])), "whole, though a stamp is about to wrap"
    results = [lines.receive(one) for one in (first[0], first[2])]
    assert results[0] is None
    assert results[1] is not None
    assert results[1].depth_m is None
    assert "16 of 24 pixels of an image arrived" in results[1].why
    found = [lines.receive(one) for one in (second[0], first[1], second[1], second[2])]
    assert found[:3] == [None] * 3, "a packet that was overtaken changes nothing"
    assert found[3] is not None
    assert found[3].depth_m == pytest.approx(values * 1e-3)
    unended = [lines.receive(one) for one in (*packets(values, 300)[:2], packets(values, 400)[0])]
    assert unended[2] is not None
    assert "16 of 24" in unended[2].why, "its last packet was lost"


class Sent:
    """A DepthGrabber of packets that were sent."""

    def __init__(self, sent: list[bytes]) -> None:
        self._sent = iter(sent)
        self._lines = DepthLines(width_px=4, height_px=6)

    def open(self) -> None:
        pass

    def grab(self) -> GrabbedDepth | None:
        packet = next(self._sent, None)
        if packet is not None:
            return self._lines.receive(packet)
        threading_pause(1)
        return None

    def close(self) -> None:
        pass


@pytest.mark.parametrize(("sender", "stamp"), [(8, 90_000), (8, 899_000), (7, 6000)])
async def test_a_sender_that_starts_anew_is_followed_and_counted(sender: int, stamp: int) -> None:
    values = np.arange(1, 25).reshape(6, 4)
    before = (packets(values, 900_000 + 6000 * k) for k in range(3))
    after = (packets(values, stamp + 6000 * k, sender=sender) for k in range(5))
    sent = Sent([packet for image in (*before, *after) for packet in image])
    asked = request("rtp://0.0.0.0:5600", camera=Intrinsics.from_fov(4, 6, 1.2), stall_s=5.0)
    async with GrabbedReadings(request=asked, grabber=sent, remedy="") as live:
        found = [await anext(live) for _ in range(8)]
    assert [one.seq for one in found] == list(range(8))
    assert (live.counts.damaged, live.counts.restarts) == (0, 1)


def test_an_image_that_later_ones_overtook_is_counted_once() -> None:
    values = np.arange(1, 25).reshape(6, 4)
    lines = DepthLines(width_px=4, height_px=6)
    sent = [*packets(values, 12_000), *packets(values, 6000), *packets(values, 18_000)]
    results = [one for one in map(lines.receive, sent) if one is not None]
    assert [one.depth_m is not None for one in results] == [True, False, True]
    assert "after those of a later image" in results[1].why


def test_images_that_never_arrived_are_counted_by_the_stamps() -> None:
    values = np.arange(1, 25).reshape(6, 4)
    lines = DepthLines(width_px=4, height_px=6, rate_hz=15.0)
    broken = packets(values, 8 * 6000)[1:]
    sent = [packets(values, k * 6000) for k in (1, 2, 5, 6)] + [broken]
    sent += [packets(values, k * 6000) for k in (10, 11)] + [packets(values, 900, sender=8)]
    results = [one for image in sent for packet in image if (one := lines.receive(packet))]
    assert [one.skipped for one in results] == [0, 0, 2, 0, 0, 2, 0, 0]
    assert [one.depth_m is None for one in results].index(True) == 4


INTERLACED = struct.pack(">BBHIIHHHH", 0x80, 96, 1, 1, 7, 0, 8, 0x8001, 0) + bytes(8)


@pytest.mark.parametrize(
    ("packet", "said"),
    [
        (b"\x00" * 20, "no packet of RTP"),
        (b"\x80", "requires"),
        (packets(np.ones((6, 5)), 1)[0], "pixels up to 5, and the sensor of the campaign has 4x6"),
        (packets(np.ones((8, 4)), 1)[3], "line 6 has"),
        (INTERLACED, "interlaced"),
        (packets(np.ones((6, 4)), 1)[0][:-3], "buffer is smaller"),
    ],
)
def test_what_is_no_depth_of_this_camera_is_refused(packet: bytes, said: str) -> None:
    grabbed = DepthLines(width_px=4, height_px=6).receive(packet)
    assert grabbed is not None
    assert grabbed.depth_m is None
    assert said in grabbed.why


async def test_a_port_that_is_taken_and_one_where_nothing_comes() -> None:
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    with pytest.raises(SourceError, match="cannot listen there"):
        async with open_rtp_depth(request(f"rtp://127.0.0.1:{taken.getsockname()[1]}")):
            pass
    taken.close()
    with pytest.raises(SourceError, match="raw video by RFC 4175"):
        async with open_rtp_depth(request(f"rtp://127.0.0.1:{free_port()}", open_s=0.3)):
            pass


def test_addresses_and_types_that_do_not_fit_are_named() -> None:
    assert rtp_depth_fault("rtp://0.0.0.0:5600", "depth") == ""
    assert "is not rtp://HOST:PORT" in rtp_depth_fault("rtp://0.0.0.0", "depth")
    assert "the sensor is a lidar" in rtp_depth_fault("rtp://0.0.0.0:5600", "lidar")
    assert realsense_fault("realsense://any", "depth") == ""
    assert realsense_fault("realsense://012345", "depth") == ""
    assert "SERIAL" in realsense_fault("realsense://", "depth")
    assert "the sensor is a gps" in realsense_fault("realsense://any", "gps")


class Library:
    """A stand-in for pyrealsense2: what its documents say of the calls that are made."""

    stream = SimpleNamespace(depth="depth")
    format = SimpleNamespace(z16="z16")

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.lens = SimpleNamespace(width=WIDTH, height=HEIGHT, fx=LENS.fx_px * 1.001)
        self.numbers = iter([5, 6, 9, 10])
        self.shape = (HEIGHT, WIDTH)
        self.trouble = ""
        self.stopped = 0
        self.opening: Callable[[], None] = lambda: None
        self.stopping: Callable[[], None] = lambda: None

    def config(self) -> Any:
        return SimpleNamespace(
            enable_device=self.asked.append,
            enable_stream=lambda *mode: self.asked.append(mode),
        )

    def pipeline(self) -> Any:
        return self

    def start(self, config: Any) -> Any:
        if self.trouble:
            raise RuntimeError(self.trouble)
        scale = SimpleNamespace(get_depth_scale=lambda: 0.0001)
        profile = SimpleNamespace(get_intrinsics=lambda: self.lens)
        return SimpleNamespace(
            get_device=lambda: SimpleNamespace(first_depth_sensor=lambda: self.opening() or scale),
            get_stream=lambda kind: SimpleNamespace(as_video_stream_profile=lambda: profile),
        )

    def stop(self) -> None:
        self.stopped += 1
        self.stopping()

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, Any]:
        number = next(self.numbers, None)
        if number is None:
            threading_pause(timeout_ms)
            return False, None
        values = np.full(self.shape, 12_345, np.uint16)
        values[0, 0] = 0
        frame = SimpleNamespace(
            get_frame_number=lambda: number,
            get_timestamp=lambda: 1e12 + number * 1000.0 / 15.0,
            get_data=lambda: values,
        )
        return True, SimpleNamespace(get_depth_frame=lambda: frame)


def threading_pause(timeout_ms: int) -> None:
    """Wait a moment, as the library does, without an event of ours."""
    import time

    time.sleep(min(timeout_ms, 20) * 1e-3)


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    made = Library()
    monkeypatch.setitem(sys.modules, "pyrealsense2", made)
    return made


async def test_a_realsense_gives_metres_by_its_own_scale(library: Library) -> None:
    mount = Pose((0.1, 0.0, -0.2))
    async with open_realsense(request("realsense://0123", stall_s=0.5, mount=mount)) as live:
        found = [await anext(live) for _ in range(4)]
        assert library.asked == ["0123", ("depth", WIDTH, HEIGHT, "z16", 15)]
        with pytest.raises(SourceStalledError):
            await anext(live)
    assert library.stopped == 1
    for reading in found:
        assert isinstance(reading, DepthReading)
        assert reading.depth_m[1, 1] == pytest.approx(1.2345)
        assert math.isinf(reading.depth_m[0, 0])
        assert (reading.intrinsics, reading.rendered) == (LENS, False)
        assert reading.mount == mount
    assert [one.seq for one in found] == [0, 1, 4, 5], "two frames never came"


async def opening(library: Library, **changes: Any) -> str:
    with pytest.raises(SourceError) as raised:
        async with open_realsense(request("realsense://any", open_s=0.5, **changes)):
            pass
    return str(raised.value)


async def test_a_realsense_that_does_not_fit_is_refused(library: Library) -> None:
    library.trouble = "No device connected"
    assert "160x120 at 15 Hz: No device connected" in await opening(library)
    library.trouble = ""
    library.lens.width = 320
    assert "is 320x120, and the sensor of the campaign has 160x120" in await opening(library)
    library.lens.width, library.lens.fx = WIDTH, 400.0
    assert "its focal length is 400 px" in await opening(library)
    library.lens.fx, library.shape = LENS.fx_px, (2, 2)
    assert "an image of uint16 (2, 2)" in await opening(library)


def fails(text: str) -> Callable[[], None]:
    """Return a call of the library that fails as all of its calls do."""

    def call() -> None:
        raise RuntimeError(text)

    return call


async def test_what_a_library_raises_as_it_opens_is_reported_and_as_it_stops_hides_nothing(
    library: Library, capfd: pytest.CaptureFixture[str]
) -> None:
    library.opening, library.stopping = fails("hwmon command failed"), fails("stop() failed")
    assert "real depth from realsense://any: RuntimeError: hwmon" in await opening(library)
    library.opening = lambda: None
    async with open_realsense(request("realsense://any")) as live:
        await anext(live)
    assert library.stopped == 2
    assert "Traceback" not in capfd.readouterr().err


async def test_a_device_that_does_not_open_is_not_waited_for_without_end(
    library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = threading.Event()

    def hang() -> None:
        answers.wait(30.0)

    library.opening = hang
    monkeypatch.setattr(depth_grabber, "_OPENING_MARGIN_S", 0.1)
    monkeypatch.setattr(depth_grabber, "_STOP_S", 0.1)
    async with asyncio.timeout(20.0):
        assert "did not open within 0.5 s" in await opening(library)
    answers.set()


async def test_without_the_library_the_message_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(SourceError, match="pip install pyrealsense2"):
        async with open_realsense(request("realsense://any")):
            pass
