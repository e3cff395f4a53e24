"""Pictures over RTP: a second process sees what was published, and a flight is never held up."""

import asyncio
import base64
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from tests.ports import free_port
from wil_campaign.plugins.outlets.h264_encoder import H264Settings, to_h264_frame
from wil_campaign.plugins.outlets.image_delivery import (
    DeliveryCounts,
    DeliveryError,
    ImageDelivery,
)
from wil_campaign.plugins.outlets.rtp import rtp_delivery
from wil_campaign.plugins.outlets.sdp import RtpAddress, h264_sdp, split_parameter_sets
from wil_campaign.plugins.outlets.threaded_delivery import ThreadedDelivery
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.worlds.camera import Intrinsics

WIDTH, HEIGHT, RATE_HZ = 192, 144, 50
CAMERA = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)


def picture(k: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    wave = 128 + 80 * np.sin((2 * columns + rows + 9 * k) / 15.0)
    image = np.stack((wave - 30, wave, wave + 30), axis=-1).astype(np.uint8)
    image[:, :48] = 30 + 6 * (k % 35)
    return image


def reading(k: int) -> CameraReading:
    t_s = 100.0 + k / RATE_HZ
    return CameraReading(t_s, t_s + 0.01, k, "mixed", picture(k), CAMERA)


RECEIVER = """
import sys, time
import av, numpy as np
sdp, out, wanted = sys.argv[1], sys.argv[2], int(sys.argv[3])
options = {"protocol_whitelist": "file,udp,rtp", "probesize": "32", "analyzeduration": "0",
           "reorder_queue_size": "0", "buffer_size": "4194304"}
print("up", flush=True)
container = av.open(sdp, format="sdp", options=options, timeout=(60.0, 30.0))
stream = container.streams.video[0]
stream.codec_context.thread_count = 1
pictures, times = [], []
for frame in container.decode(stream):
    pictures.append(frame.to_ndarray(format="bgr24"))
    times.append(frame.time if frame.time is not None else np.nan)
    if len(pictures) == wanted:
        break
np.savez(out, pictures=np.stack(pictures), times=np.array(times))
"""


def psnr_db(a: np.ndarray, b: np.ndarray) -> float:
    error = float(np.mean((a.astype(np.float64) - b.astype(np.float64)) ** 2))
    return float(10.0 * np.log10(255.0**2 / max(error, 1e-9)))


@pytest.fixture
def port() -> int:
    return free_port()


async def published(delivery: ThreadedDelivery, receiving: Callable[[], bool]) -> int:
    """Publish at the camera's rate until the receiver has enough; return how many."""
    start_s, k = time.monotonic(), 0
    while receiving() and k < 3000:
        delivery.deliver(reading(k))
        k += 1
        await asyncio.sleep(max(0.0, start_s + k / RATE_HZ - time.monotonic()))
    return k


async def test_a_second_process_sees_the_images_that_were_published(
    port: int, tmp_path: Path
) -> None:
    sdp, out = tmp_path / "mixed.sdp", tmp_path / "seen.npz"
    async with rtp_delivery(
        width_px=WIDTH,
        height_px=HEIGHT,
        rate_hz=RATE_HZ,
        address=RtpAddress(port=port),
        sdp_path=sdp,
        key_interval_s=0.5,
    ) as delivery:
        assert isinstance(delivery, ImageDelivery)
        # Who comes late must see pictures as well: it starts while the stream runs.
        command = [sys.executable, "-c", RECEIVER, str(sdp), str(out), "30"]
        receiver = await asyncio.create_subprocess_exec(*command)
        try:
            await published(delivery, lambda: receiver.returncode is None)
        finally:
            if receiver.returncode is None:
                receiver.kill()
            await receiver.wait()
        counts = delivery.counts
    seen = np.load(out)
    numbers = [round((float(image[:, :24].mean()) - 30) / 6) for image in seen["pictures"]]
    qualities = [
        max(psnr_db(image, picture(number + 35 * turn)) for turn in range(18))
        for image, number in zip(seen["pictures"], numbers, strict=True)
    ]
    assert min(qualities) > 32
    # FFmpeg gives the first picture no time. A busy machine may drop a picture, never stamp it
    # wrong.
    steps = np.diff(seen["times"][1:]) * RATE_HZ
    assert steps == pytest.approx(np.rint(steps), abs=0.01)
    assert [int(step) % 35 for step in np.rint(steps)] == [
        (after - before) % 35 for before, after in pairwise(numbers[1:])
    ]
    assert counts.failed == 0
    assert counts.offered >= counts.delivered + counts.dropped > 30


def test_the_sdp_says_what_the_stream_is() -> None:
    settings = H264Settings(rate_hz=30.0)
    sets = settings.parameter_sets(WIDTH, HEIGHT)
    sdp = h264_sdp(RtpAddress("127.0.0.1", 5600), parameter_sets=sets, rate_hz=30.0)
    lines = sdp.split("\r\n")
    assert lines[0] == "v=0"
    assert "c=IN IP4 127.0.0.1" in lines
    assert "m=video 5600 RTP/AVP 96" in lines
    assert "a=rtpmap:96 H264/90000" in lines
    (fmtp,) = (line for line in lines if line.startswith("a=fmtp:96 "))
    parameters = dict(part.split("=", 1) for part in fmtp.split(" ", 1)[1].split(";"))
    assert parameters["packetization-mode"] == "1"
    assert bytes.fromhex(parameters["profile-level-id"])[0] == 66
    sprop = [base64.b64decode(part) for part in parameters["sprop-parameter-sets"].split(",")]
    assert [part[0] & 0x1F for part in sprop] == [7, 8]
    with pytest.raises(ValueError, match="SPS"):
        h264_sdp(RtpAddress(), parameter_sets=(b"x",), rate_hz=30.0)


def test_every_key_picture_carries_the_parameter_sets_of_the_sdp() -> None:
    settings = H264Settings(rate_hz=10.0, key_interval_s=0.5)
    codec: Any = av.CodecContext.create("libx264", "w")
    settings.configure(codec, WIDTH, HEIGHT)
    packets = [p for k in range(11) for p in codec.encode(to_h264_frame(picture(k), 9000 * k))]
    # One packet for one picture, at once: nothing is held back.
    assert len(packets) == 11
    assert [k for k, packet in enumerate(packets) if packet.is_keyframe] == [0, 5, 10]
    expected = settings.parameter_sets(WIDTH, HEIGHT)
    for packet in packets:
        found = split_parameter_sets(bytes(packet))
        assert found == (expected if packet.is_keyframe else ())


def test_colours_come_back() -> None:
    flat = np.empty((HEIGHT, WIDTH, 3), np.uint8)
    flat[:] = (0, 140, 255)
    settings = H264Settings(rate_hz=10.0, quality_crf=5)
    encoder: Any = av.CodecContext.create("libx264", "w")
    settings.configure(encoder, WIDTH, HEIGHT)
    decoder: Any = av.CodecContext.create("h264", "r")
    packets = encoder.encode(to_h264_frame(flat, 0)) + encoder.encode(None)
    frames = [frame for packet in [*packets, None] for frame in decoder.decode(packet)]
    image = frames[0].to_ndarray(format="bgr24")
    assert np.abs(image.astype(int) - flat.astype(int)).max() <= 4


async def test_images_that_do_not_fit_are_not_sent(port: int) -> None:
    async with rtp_delivery(
        width_px=WIDTH, height_px=HEIGHT, rate_hz=30.0, address=RtpAddress(port=port)
    ) as delivery:
        delivery.deliver(reading(0))
        await settled(delivery, 1)
        delivery.deliver(replace(reading(1), image_bgr=np.zeros((48, 64, 3), np.uint8)))
        await settled(delivery, 2)
        assert "64x48 does not fit the stream of 192x144" in delivery.trouble
        delivery.deliver(reading(0))
        await settled(delivery, 3)
        assert "not newer than the previous one" in delivery.trouble
        delivery.deliver(reading(2))
        await settled(delivery, 4)
        assert delivery.counts == DeliveryCounts(offered=4, delivered=2, dropped=0, failed=2)


async def settled(delivery: ThreadedDelivery, count: int) -> None:
    for _ in range(500):
        counts = delivery.counts
        if counts.delivered + counts.failed + counts.dropped >= count:
            return
        await asyncio.sleep(0.01)
    pytest.fail("the thread does not come on")


async def test_an_unknown_host_is_reported() -> None:
    address = RtpAddress("no.such.host.invalid", 5600)
    with pytest.raises(DeliveryError, match=r"no\.such\.host\.invalid:5600: cannot open"):
        async with rtp_delivery(width_px=64, height_px=48, rate_hz=10.0, address=address):
            pass


async def test_an_sdp_file_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "no_folder" / "mixed.sdp"
    with pytest.raises(DeliveryError, match="cannot open"):
        async with rtp_delivery(width_px=64, height_px=48, rate_hz=10.0, sdp_path=path):
            pass


class StuckSink:
    """A sink that is busy until it is let go."""

    name = "stuck"

    def __init__(self) -> None:
        self.go = threading.Event()
        self.seen: list[int] = []
        self.busy = threading.Event()

    def open(self) -> None:
        pass

    def write(self, reading: CameraReading) -> None:
        self.busy.set()
        self.go.wait(5.0)
        self.seen.append(reading.seq)

    def close(self) -> None:
        pass


async def test_a_way_out_that_is_stuck_drops_and_never_holds_up() -> None:
    sink = StuckSink()
    readings = [reading(k) for k in range(50)]
    async with ThreadedDelivery(sink=sink, depth=2) as delivery:
        delivery.deliver(readings[0])
        await asyncio.to_thread(sink.busy.wait, 5.0)
        before_s = time.monotonic()
        for each in readings[1:]:
            delivery.deliver(each)
        # One that waited for the sink would wait for 5 s.
        assert time.monotonic() - before_s < 2.5
        sink.go.set()
    # The newest ones are the ones worth having; what waits is sent before the end.
    assert sink.seen == [0, 48, 49]
    assert delivery.counts == DeliveryCounts(offered=50, delivered=3, dropped=47, failed=0)


async def test_images_of_a_sink_that_is_stuck_until_the_end_count_as_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("wil_campaign.plugins.outlets.threaded_delivery._CLOSING_LIMIT_S", 0.05)
    sink = StuckSink()
    async with ThreadedDelivery(sink=sink, depth=2) as delivery:
        delivery.deliver(reading(0))
        await asyncio.to_thread(sink.busy.wait, 5.0)
        for k in (1, 2):
            delivery.deliver(reading(k))
    lost = DeliveryCounts(offered=3, delivered=0, dropped=2, failed=1)
    assert delivery.counts == lost
    assert "stuck: an image was not sent within 0.05 s of closing" in delivery.trouble
    sink.go.set()
    await asyncio.to_thread(delivery._thread.join, 5.0)
    # The result is written by then: what happens later changes nothing, and nothing more is sent.
    assert (delivery.counts, sink.seen) == (lost, [0])
    delivery.deliver(reading(3))
    assert delivery.counts == DeliveryCounts(offered=4, delivered=0, dropped=3, failed=1)


async def test_a_picture_that_breaks_the_sink_does_not_end_it() -> None:
    class Picky(StuckSink):
        def write(self, reading: CameraReading) -> None:
            if reading.seq == 1:
                raise ZeroDivisionError("odd picture")
            self.seen.append(reading.seq)

    sink = Picky()
    async with ThreadedDelivery(sink=sink, depth=5) as delivery:
        for k in range(3):
            delivery.deliver(reading(k))
    assert sink.seen == [0, 2]
    assert delivery.counts.failed == 1
    assert delivery.trouble == "stuck: ZeroDivisionError: odd picture"


async def test_a_sink_that_fails_to_open_with_any_error_says_so() -> None:
    class Broken(StuckSink):
        def open(self) -> None:
            raise RuntimeError("no driver")

    with pytest.raises(DeliveryError, match="stuck: RuntimeError: no driver"):
        async with ThreadedDelivery(sink=Broken()):
            pass


async def test_a_sink_that_fails_to_close_is_reported() -> None:
    class Unclosed(StuckSink):
        def close(self) -> None:
            raise OSError(5, "Input/output error")

    async with ThreadedDelivery(sink=Unclosed()) as delivery:
        pass
    assert delivery.trouble == "stuck: cannot be closed: OSError: [Errno 5] Input/output error"
