"""Where a stream can be joined, and what loses its ground: without sockets, from a file."""

from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from tests.plugins.cameras.conftest import known_picture, number_of
from wil_campaign.plugins.cameras.av_grabber import AvGrabber
from wil_campaign.plugins.cameras.av_input import AvInput, av_input, opening_error
from wil_campaign.plugins.cameras.image_files import VideoFile
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.worlds.camera import Intrinsics

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
    with pytest.raises(SourceError, match=r"without a key frame to start decoding.*parameter sets"):
        AvGrabber(source=source, open_timeout_s=0.0).open()


def jpegs(path: Path, damage: Callable[[int, bytes], bytes], count: int = 12) -> AvInput:
    """Write images that are coded alone, as a device with `format: mjpeg` sends them."""
    written = [damage(k, cv2.imencode(".jpg", known_picture(k))[1].tobytes()) for k in range(count)]
    path.write_bytes(b"".join(written))
    return AvInput("v4l2", str(path), "mjpeg")


@pytest.mark.parametrize(
    "damage",
    [
        pytest.param(lambda data: data[: len(data) // 2], id="cut off"),
        pytest.param(lambda data: data[:1500] + data[2500:], id="with a hole"),
    ],
)
def test_a_jpeg_that_is_not_whole_is_damaged_and_no_other(
    damage: Callable[[bytes], bytes], tmp_path: Path
) -> None:
    def some(k: int, data: bytes) -> bytes:
        return damage(data) if k in {4, 7, 8} else data

    found = grabbed(jpegs(tmp_path / "v.mjpeg", some))
    assert found == [None if k in {4, 7, 8} else k for k in range(12)]
    source = jpegs(tmp_path / "all.mjpeg", lambda _, data: damage(data))
    with pytest.raises(SourceError, match="each of its images arrives damaged or cut off"):
        AvGrabber(source=source, open_timeout_s=0.0).open()


def test_damaged_notes_beside_the_pixels_and_bytes_after_them_change_nothing(
    tmp_path: Path,
) -> None:
    def odd(k: int, data: bytes) -> bytes:
        notes = [b"\xff\xe0\0\x08AVI1ab", b"\xff\xe1\0\x0cExif\0\0ab??", b""][k % 3]
        return data[:2] + notes + data[2:] + bytes(64 * (k % 2))

    assert grabbed(jpegs(tmp_path / "v.mjpeg", odd)) == list(range(12))


def test_an_image_that_a_device_marks_as_damaged_is_not_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, opened = jpegs(tmp_path / "v.mjpeg", lambda _, data: data), av.open

    class Device:
        """FFmpeg's V4L2 gives an empty packet, with its time, for a buffer with an error."""

        def __init__(self, container: Any) -> None:
            self._container, self.streams = container, container.streams
            self.close = container.close

        def demux(self, stream: Any) -> Iterator[Any]:
            for k, packet in enumerate(self._container.demux(stream)):
                if k == 3:
                    empty = av.Packet(b"")
                    empty.pts, empty.time_base = 3, Fraction(1, 25)
                    yield empty
                yield packet

    monkeypatch.setattr(av, "open", lambda *given, **more: Device(opened(*given, **more)))
    assert grabbed(source) == [0, 1, 2, None, *range(3, 12)]


def test_grey_with_more_than_8_bits_is_refused(tmp_path: Path) -> None:
    thermal = np.full((48, 64), 3000, np.uint16)  # of 12 bits: the upper 8 are 11 of 255
    film = tmp_path / "v.mkv"
    with av.open(str(film), "w") as container:
        stream: Any = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "gray16le"
        for _ in range(5):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(thermal, format="gray16le")))
        container.mux(stream.encode(None))
    with pytest.raises(SourceError, match="grey with 16 bits"):
        AvGrabber(source=AvInput("v4l2", str(film)), open_timeout_s=20.0).open()
    recorded = VideoFile(path=film)
    recorded.open()
    with pytest.raises(SourceError, match="grey with 16 bits"):
        recorded.next()
    recorded.close()


def test_a_device_without_the_format_says_what_lists_its_own() -> None:
    error = opening_error("/dev/video0", av.error.ArgumentError(22, "Invalid argument"))
    assert "v4l2-ctl -d /dev/video0 --list-formats-ext" in str(error)
    assert "host, port" not in str(error)


def test_the_size_that_is_requested_of_a_device_is_not_that_of_its_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device that has no 160x120 sends its nearest size: read as 160x120 it was a jumble."""
    film = tmp_path / "v.nut"
    with av.open(str(film), "w") as container:
        stream: Any = container.add_stream("rawvideo", rate=25)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuyv422"
        for k in range(3):
            frame = av.VideoFrame.from_ndarray(known_picture(k, 320, 240), format="bgr24")
            container.mux(stream.encode(frame.reformat(format="yuyv422")))
    opened = av.open

    def open_as_device(_: str, *, format: str, **more: Any) -> Any:  # noqa: A002 - PyAV's name
        assert format == "v4l2"
        return opened(str(film), **more)

    monkeypatch.setattr(av, "open", open_as_device)
    source = av_input("/dev/video0", intrinsics=Intrinsics.from_fov(160, 120, 1.2), rate_hz=25)
    grabber = AvGrabber(source=source, open_timeout_s=20.0)
    grabber.open()
    first = grabber.grab()
    grabber.close()
    assert first is not None
    assert first.image_bgr is not None
    assert first.image_bgr.shape == (240, 320, 3)
    assert number_of(first.image_bgr) == 0
