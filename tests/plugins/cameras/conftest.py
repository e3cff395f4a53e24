"""Streams that tests watch: a sender of known pictures over RTP, from a thread."""

import threading
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.ports import free_port

Picture = NDArray[np.uint8]
RATE_HZ = 50


def known_picture(k: int, width: int = 160, height: int = 120) -> Picture:
    """Return picture k: two brightnesses at the left say k modulo 3600, the rest moves."""
    rows, columns = np.mgrid[0:height, 0:width]
    wave = 128 + 80 * np.sin((2 * columns + rows + 9 * (k % 60)) / 12.0)
    picture = np.stack((wave, wave, wave - 40), axis=-1).astype(np.uint8)
    picture[: height // 2, : width // 4] = 40 + 3 * (k % 60)
    picture[height // 2 :, : width // 4] = 40 + 3 * (k // 60 % 60)
    return picture


def number_of(picture: Picture) -> int:
    """Return k modulo 3600 of a picture that came back."""
    height, width = picture.shape[:2]
    ones, sixties = (
        round((float(picture[rows, : width // 8].mean()) - 40) / 3)
        for rows in (slice(3 * height // 8), slice(5 * height // 8, None))
    )
    return ones + 60 * sixties


class Sender:
    """Sends pictures until told to stop; `size` says of which size the k-th is."""

    def __init__(
        self, port: int, size: Callable[[int], tuple[int, int]], rate_hz: int = RATE_HZ
    ) -> None:
        self._port = port
        self._size = size
        self._rate_hz = rate_hz
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        k, size = 0, (0, 0)
        container: Any = None
        stream: Any = None
        start_s = time.monotonic()
        while not self._stop.wait(max(0.0, start_s + k / self._rate_hz - time.monotonic())):
            if self._size(k) != size:
                size = self._size(k)
                if container is not None:
                    container.close()
                container, stream = self._open(size)
            image = cv2.cvtColor(known_picture(k, *size), cv2.COLOR_BGR2YUV_I420)
            frame: Any = av.VideoFrame.from_ndarray(image, format="yuv420p")
            frame.pts, frame.time_base = k * 90_000 // self._rate_hz, Fraction(1, 90_000)
            container.mux(stream.encode(frame))
            k += 1
        if container is not None:
            container.close()

    def _open(self, size: tuple[int, int]) -> tuple[Any, Any]:
        container = av.open(f"rtp://127.0.0.1:{self._port}", "w", format="rtp")
        stream: Any = container.add_stream("libx264", rate=self._rate_hz)
        stream.width, stream.height = size
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, 90_000)
        stream.codec_context.thread_count = 1
        stream.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "crf": "12",
            "g": "15",
            "x264-params": "repeat-headers=1:sliced-threads=0:scenecut=0",
        }
        return container, stream


@pytest.fixture(name="free_port")
def given_port() -> int:
    return free_port()


@pytest.fixture
def sending() -> Iterator[Callable[..., Sender]]:
    senders: list[Sender] = []

    def start(
        port: int,
        size: Callable[[int], tuple[int, int]] = lambda _: (160, 120),
        rate_hz: int = RATE_HZ,
    ) -> Sender:
        sender = Sender(port, size, rate_hz)
        senders.append(sender)
        sender.start()
        return sender

    yield start
    for sender in senders:
        sender.stop()
