"""Where a stream can be joined, and what loses its ground: without sockets, from a file."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import pytest

from tests.plugins.cameras.conftest import known_picture, number_of
from wil_campaign.plugins.cameras.av_grabber import AvGrabber
from wil_campaign.plugins.cameras.av_input import AvInput
from wil_campaign.vehicles.sources.camera_source import SourceError

GROUP = 10


def stream(path: Path, numbers: Iterable[int]) -> AvInput:
    """Write the given pictures of a stream with a key picture every GROUP pictures."""
    encoder: Any = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 160, 120, "yuv420p"
    encoder.time_base, encoder.thread_count = Fraction(1, 50), 1
    encoder.options = {
        "preset": "ultrafast",
        "tune": "zerolatency",
        "crf": "12",
        "g": str(GROUP),
        "x264-params": "repeat-headers=1:sliced-threads=0:scenecut=0",
    }
    packets = []
    for k in range(50):
        image = cv2.cvtColor(known_picture(k), cv2.COLOR_BGR2YUV_I420)
        frame = av.VideoFrame.from_ndarray(image, format="yuv420p")
        frame.pts = k
        packets += [bytes(packet) for packet in encoder.encode(frame)]
    path.write_bytes(b"".join(packets[k] for k in numbers))
    return AvInput("rtp", str(path), "h264")


def grabbed(source: AvInput) -> list[int | None]:
    """Return the numbers of the pictures until the end; None for a broken one."""
    grabber = AvGrabber(source=source, open_timeout_s=20.0)
    found: list[int | None] = []
    grabber.open()
    try:
        while True:
            one = grabber.grab()
            if one is not None:
                found.append(None if one.image_bgr is None else number_of(one.image_bgr))
    except SourceError as error:
        assert "has ended" in str(error)  # noqa: PT017 - the end of the file ends the loop
    finally:
        grabber.close()
    return found


@pytest.mark.parametrize("joined", [0, 1, 4, 9])
def test_a_late_reader_starts_at_a_key_picture_and_nothing_is_damaged(
    joined: int, tmp_path: Path
) -> None:
    found = grabbed(stream(tmp_path / "v.h264", range(joined, 50)))
    first = 0 if joined == 0 else GROUP
    assert found == list(range(first, first + len(found)))
    assert len(found) >= 50 - first - 1


def test_after_a_loss_images_are_damaged_until_the_next_key_picture(tmp_path: Path) -> None:
    numbers = [k for k in range(50) if k not in {14, 30}]
    found = grabbed(stream(tmp_path / "v.h264", numbers))
    expected: list[int | None] = [*range(14), *[None] * 5, *range(20, 30), *[None] * 9]
    assert found[: len(expected)] == expected
    assert found[len(expected)] == 40


def test_a_stream_without_a_key_picture_says_so(tmp_path: Path) -> None:
    source = stream(tmp_path / "v.h264", range(1, 10))
    with pytest.raises(SourceError, match="without a key frame to start decoding from"):
        AvGrabber(source=source, open_timeout_s=0.0).open()
