"""Real streams: RTP and RTSP come in, and lost data never becomes a picture."""

import asyncio
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count, pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest

from tests.plugins.cameras.conftest import RATE_HZ, Sender, known_picture, number_of
from tests.plugins.cameras.pumping import pump
from wil_campaign.plugins.cameras import av_grabber
from wil_campaign.plugins.cameras.camera_factory import live_camera
from wil_campaign.plugins.cameras.live_camera import LiveCamera
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sources.camera_source import (
    ImageChangedError,
    SourceError,
    SourceStalledError,
)
from wil_campaign.worlds.camera import Intrinsics

CAMERA = Intrinsics.from_fov(160, 120, 1.2)
Sending = Callable[..., Sender]
PATIENT: dict[str, Any] = {"open_timeout_s": 30.0, "stall_timeout_s": 30.0}
"""A busy machine opens a stream late, and sends nothing for seconds."""


def psnr_db(a: np.ndarray, b: np.ndarray) -> float:
    error = float(np.mean((a.astype(np.float64) - b.astype(np.float64)) ** 2))
    return float(10.0 * np.log10(255.0**2 / max(error, 1e-9)))


def right_picture_db(reading: CameraReading) -> float:
    return psnr_db(reading.image_bgr, known_picture(number_of(reading.image_bgr)))


async def taken(source: LiveCamera, count: int) -> list[CameraReading]:
    return [await anext(source) for _ in range(count)]


async def test_rtp_images_come_as_they_were_sent(sending: Sending, free_port: int) -> None:
    sending(free_port)
    address = f"rtp://127.0.0.1:{free_port}"
    async with live_camera(address, intrinsics=CAMERA, rate_hz=RATE_HZ, **PATIENT) as source:
        readings = await taken(source, 80)
    assert min(right_picture_db(reading) for reading in readings) > 30
    assert all(reading.arrived_s >= reading.t_s for reading in readings)
    seqs = [reading.seq for reading in readings]
    assert seqs == sorted(set(seqs))
    assert seqs[0] == 0
    # FFmpeg does not stamp the very first picture of a stream: it is of when it came.
    assert_of_the_senders_time(readings[1:])


def assert_of_the_senders_time(readings: list[CameraReading], rate_hz: int = RATE_HZ) -> None:
    """Fail unless all stamps are of the sender, but of pictures that came quicker than any before.

    They count as not delayed. (A busy machine brings the first ones late. The least delay is kept
    for 10 s.)
    """
    lately = [reading for reading in readings if reading.arrived_s - readings[0].arrived_s < 9.0]
    for before, reading in pairwise(lately):
        steps = number_of(reading.image_bgr) - number_of(before.image_bgr)
        off_s = reading.t_s - before.t_s - steps / rate_hz
        assert off_s < 1e-4
        assert off_s > -1e-4 or reading.arrived_s - reading.t_s < 1e-4


async def test_an_sdp_file_is_an_address(sending: Sending, free_port: int, tmp_path: Path) -> None:
    sdp = tmp_path / "video.sdp"
    sdp.write_text(
        f"v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\n"
        f"m=video {free_port} RTP/AVP 96\na=rtpmap:96 H264/90000\n"
    )
    sending(free_port)
    async with live_camera(str(sdp), intrinsics=CAMERA, **PATIENT) as source:
        assert right_picture_db(await anext(source)) > 30


async def test_a_stream_that_stops_stalls_and_may_go_on(sending: Sending, free_port: int) -> None:
    sender = sending(free_port)
    address = f"rtp://127.0.0.1:{free_port}"
    async with live_camera(address, intrinsics=CAMERA, **PATIENT) as source:
        await taken(source, 5)
        sender.stop()
        source._stall_timeout_s = 1.5
        with pytest.raises(SourceStalledError, match=r"no image for 1\.5 s"):
            await taken(source, 100)
        source._stall_timeout_s = PATIENT["stall_timeout_s"]
        sending(free_port)
        readings = await taken(source, 10)
    assert min(right_picture_db(reading) for reading in readings) > 30


async def test_a_change_of_resolution_in_flight_is_an_error(
    sending: Sending, free_port: int
) -> None:
    is_changed = threading.Event()
    sending(free_port, lambda _: (320, 240) if is_changed.is_set() else (160, 120))
    address = f"rtp://127.0.0.1:{free_port}"
    seen: list[CameraReading] = []

    def take(reading: CameraReading) -> None:
        seen.append(reading)
        if len(seen) == 6:
            is_changed.set()

    async with live_camera(address, intrinsics=CAMERA, **PATIENT) as source:
        with pytest.raises(ImageChangedError, match="images are 320x240"):
            await pump(source, take)
    assert len(seen) > 5
    assert {reading.image_bgr.shape for reading in seen} == {(120, 160, 3)}


async def test_a_camera_of_another_size_than_its_calibration_is_refused(
    sending: Sending, free_port: int
) -> None:
    sending(free_port)
    wrong = Intrinsics.from_fov(640, 480, 1.2)
    async with live_camera(f"rtp://127.0.0.1:{free_port}", intrinsics=wrong, **PATIENT) as source:
        with pytest.raises(ImageChangedError, match=r"images are 160x120.*640x480"):
            await anext(source)


class Lossy:
    """Passes datagrams on, and loses some: `loses(picture, packet)` by their numbers."""

    def __init__(self, to_port: int, loses: Callable[[int, int], bool]) -> None:
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in.bind(("127.0.0.1", 0))
        self._in.settimeout(0.05)
        self.port = self._in.getsockname()[1]
        self._to = ("127.0.0.1", to_port)
        self._loses = loses
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._in.close()

    def _run(self) -> None:
        pictures: dict[bytes, int] = {}
        packets = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            while not self._stop.is_set():
                try:
                    data = self._in.recv(2048)
                except TimeoutError:
                    continue
                packets += 1
                number = pictures.setdefault(data[4:8], len(pictures))
                if not self._loses(number, packets):
                    out.sendto(data, self._to)


@pytest.fixture
def lossy() -> Iterator[Callable[[int, Callable[[int, int], bool]], Lossy]]:
    made: list[Lossy] = []

    def make(port: int, loses: Callable[[int, int], bool]) -> Lossy:
        made.append(Lossy(port, loses))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.mark.parametrize(
    "loses",
    [
        pytest.param(lambda picture, _: picture % 30 in {20, 21, 25}, id="whole pictures"),
        pytest.param(lambda _, packet: packet > 20 and packet % 23 == 0, id="single packets"),
    ],
)
async def test_lost_packets_never_become_a_wrong_picture(
    loses: Callable[[int, int], bool],
    sending: Sending,
    free_port: int,
    lossy: Callable[..., Lossy],
) -> None:
    sending(lossy(free_port, loses).port)
    address = f"rtp://127.0.0.1:{free_port}"
    async with live_camera(address, intrinsics=CAMERA, **PATIENT) as source:
        readings = await taken(source, 45)
    assert source.counts.damaged > 3
    assert readings[-1].seq >= 44 + source.counts.damaged - 1
    assert min(right_picture_db(reading) for reading in readings) > 30


async def test_a_picture_that_comes_late_after_a_pause_gets_no_later_time(
    sending: Sending,
    free_port: int,
    lossy: Callable[..., Lossy],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    paused: list[int] = []

    def pauses(picture: int, _: int) -> bool:
        if picture == 25 and not paused:
            paused.append(picture)
            time.sleep(0.5)
        return False

    monkeypatch.setattr(av_grabber, "_READ_TIMEOUT_S", 0.2)
    sending(lossy(free_port, pauses).port)
    address = f"rtp://127.0.0.1:{free_port}"
    async with live_camera(address, intrinsics=CAMERA, rate_hz=RATE_HZ, **PATIENT) as source:
        readings = await taken(source, 60)
    assert paused
    assert_of_the_senders_time(readings[1:])


async def test_every_picture_of_a_slow_camera_comes(
    sending: Sending, free_port: int, lossy: Callable[..., Lossy]
) -> None:
    delayed: set[int] = set()

    def every_other_is_late(picture: int, _: int) -> bool:
        if picture % 2 and picture not in delayed:
            delayed.add(picture)
            time.sleep(0.1)
        return False

    sending(lossy(free_port, every_other_is_late).port, rate_hz=5)
    address = f"rtp://127.0.0.1:{free_port}"
    async with live_camera(address, intrinsics=CAMERA, rate_hz=5.0, **PATIENT) as source:
        readings = (await taken(source, 9))[1:]  # the first has no stamp
        dropped = source.counts.dropped
    numbers = [number_of(reading.image_bgr) for reading in readings]
    assert numbers[-1] - numbers[0] + 1 - len(numbers) <= dropped
    assert_of_the_senders_time(readings, rate_hz=5)


async def test_rtsp_is_spoken(sending: Sending, free_port: int) -> None:
    with RtspServer(sending) as server:
        address = f"rtsp://user:secret@127.0.0.1:{server.port}/video"
        camera = live_camera(address, intrinsics=CAMERA, rtsp_transport="udp", **PATIENT)
        async with camera as source:
            readings = await taken(source, 5)
            assert source.name == f"rtsp://user:***@127.0.0.1:{server.port}/video"
    assert min(right_picture_db(reading) for reading in readings) > 30


class RtspServer:
    """As little of RFC 2326 as FFmpeg needs to play."""

    def __init__(self, sending: Sending) -> None:
        self._sending = sending
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._thread.join(2.0)

    def _run(self) -> None:
        connection, _ = self._socket.accept()
        self._connection = connection
        with connection, suppress(ConnectionError):
            text = ""
            while data := connection.recv(4096):
                text += data.decode("utf-8", "replace")
                while "\r\n\r\n" in text:
                    request, text = text.split("\r\n\r\n", 1)
                    connection.sendall(self._reply(request))

    def _reply(self, request: str) -> bytes:
        lines = request.split("\r\n")
        method = lines[0].split()[0]
        headers = dict(line.split(": ", 1) for line in lines[1:])
        head, body = [f"CSeq: {headers['CSeq']}"], ""
        if method == "DESCRIBE":
            body = "v=0\r\ns=x\r\nm=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
            head += ["Content-Type: application/sdp", f"Content-Length: {len(body)}"]
        elif method == "SETUP":
            ports = headers["Transport"].split("client_port=")[1].split(";")[0]
            self._client = int(ports.split("-")[0])
            head += [f"Transport: RTP/AVP;unicast;client_port={ports}", "Session: 1"]
        elif method == "PLAY":
            self._sending(self._client)
            head += ["Session: 1"]
        return ("\r\n".join(["RTSP/1.0 200 OK", *head]) + "\r\n\r\n" + body).encode()


class InterleavedServer(RtspServer):
    """The same with all packets on the one connection (RFC 2326, 10.12); it pauses within one."""

    def __init__(self, sending: Sending, *, pause_s: float) -> None:
        super().__init__(sending)
        self._pause_s = pause_s
        self._packets = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._packets.bind(("127.0.0.1", 0))
        self.has_paused = False

    def _reply(self, request: str) -> bytes:
        if request.startswith("SETUP"):
            cseq = request.split("CSeq: ")[1].split("\r\n", maxsplit=1)[0]
            transport = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1"
            return f"RTSP/1.0 200 OK\r\nCSeq: {cseq}\r\n{transport}\r\nSession: 1\r\n\r\n".encode()
        if request.startswith("PLAY"):
            self._client = self._packets.getsockname()[1]
            threading.Thread(target=self._interleave, daemon=True).start()
        return super()._reply(request)

    def _interleave(self) -> None:
        with suppress(OSError), self._packets:
            for k in count():
                packet = self._packets.recv(65_536)
                framed = b"$\0" + len(packet).to_bytes(2, "big") + packet
                if k == 100:
                    self._connection.sendall(framed[: len(framed) // 2])
                    time.sleep(self._pause_s)
                    self.has_paused = True
                    framed = framed[len(framed) // 2 :]
                self._connection.sendall(framed)


async def test_a_pause_within_a_packet_of_rtsp_over_tcp_ends_nothing(
    sending: Sending, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(av_grabber, "_READ_TIMEOUT_S", 0.1)
    with InterleavedServer(sending, pause_s=0.5) as server:
        address = f"rtsp://127.0.0.1:{server.port}/video"
        async with live_camera(address, intrinsics=CAMERA, **PATIENT) as source:
            readings: list[CameraReading] = []
            while len(readings) < 30 or not server.has_paused:
                readings.append(await anext(source))
            readings += await taken(source, 10)
    assert min(right_picture_db(reading) for reading in readings) > 30


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("rtsp://127.0.0.1:9/x", "nothing listens there"),
        ("rtsp://u:secret@127.0.0.1:9/x", r"rtsp://u:\*\*\*@127\.0\.0\.1:9/x: nothing listens"),
        ("/dev/video99", "no such file or device"),
        ("v4l2:///dev/null", "dev/null"),
        ("none.sdp", "session description cannot be read"),
        ("rtp://127.0.0.1", "is not rtp://HOST:PORT"),
        ("rtp://127.0.0.1:99999", "is not rtp://HOST:PORT"),
        ("film.mp4", "is not a live camera"),
    ],
)
async def test_a_stream_that_cannot_be_opened_is_refused_in_words(address: str, words: str) -> None:
    with pytest.raises(SourceError, match=words):
        async with live_camera(address, intrinsics=CAMERA, open_timeout_s=20.0):
            pass


async def test_a_port_where_nothing_comes_is_reported_in_time(free_port: int) -> None:
    loop = asyncio.get_running_loop()
    start_s = loop.time()
    with pytest.raises(
        SourceError, match=r"no image arrived in time.* H\.264 with payload type 96"
    ):
        async with live_camera(
            f"rtp://127.0.0.1:{free_port}", intrinsics=CAMERA, open_timeout_s=0.4
        ):
            pass
    assert loop.time() - start_s < 10.0


async def test_an_rtsp_server_that_says_nothing_is_given_up() -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"rtsp://127.0.0.1:{mute.getsockname()[1]}/x"
        with pytest.raises(SourceError, match="no image arrived in time"):
            async with live_camera(address, intrinsics=CAMERA, open_timeout_s=0.4):
                pass
