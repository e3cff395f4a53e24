"""Recordings: video files, folders of images, MCAP; played on any clock."""

import asyncio
import base64
import json
import struct
from collections.abc import Coroutine, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import IndexType, Writer
from PIL import Image

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.cameras.compressed_image import CompressedImage, decoder_for
from wil_campaign.plugins.cameras.image_files import ImageFolder, VideoFile
from wil_campaign.plugins.cameras.mcap_images import McapFile
from wil_campaign.plugins.cameras.recorded_camera import ImageFile, RecordedCamera
from wil_campaign.plugins.offline.errors import OfflineError
from wil_campaign.plugins.offline.image_inputs import InputFileOptics, read_image_reading
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sources.camera_source import CameraSource, ImageChangedError, SourceError
from wil_campaign.worlds.camera import Intrinsics

SMALL = Intrinsics.from_fov(64, 48, 1.0)


def picture(level: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    return np.full((48, 64, 3), level, np.uint8)


def video(path: Path, times_s: list[float]) -> Path:
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        stream.codec_context.thread_count = 1
        stream.options = {"crf": "5", "tune": "zerolatency"}
        for k, t_s in enumerate(times_s):
            frame = av.VideoFrame.from_ndarray(picture(20 * (k % 10) + 20), format="bgr24")
            frame.pts, frame.time_base = round(t_s * 1000), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def folder(path: Path, names: list[str]) -> Path:
    path.mkdir()
    for k, name in enumerate(names):
        cv2.imwrite(str(path / name), picture(20 * (k % 10) + 20))
    return path


def played(file: ImageFile, **more: Any) -> list[CameraReading]:
    async def play() -> list[CameraReading]:
        async with RecordedCamera(file=file, intrinsics=SMALL, **more) as source:
            assert isinstance(source, CameraSource)
            readings = [reading async for reading in source]
        assert source.counts.delivered == len(readings)
        return readings

    return run_virtual(play())


def refused(file: ImageFile, words: str, kind: type[Exception] = SourceError) -> None:
    with pytest.raises(kind, match=words):
        played(file)


def levels(readings: list[CameraReading]) -> list[int]:
    return [round(float(reading.image_bgr.mean()) / 20) for reading in readings]


def test_a_video_plays_at_its_own_times(tmp_path: Path) -> None:
    readings = played(VideoFile(path=video(tmp_path / "v.mp4", [0.0, 0.1, 0.25])), latency_s=0.05)
    assert levels(readings) == [1, 2, 3]
    assert [r.t_s for r in readings] == pytest.approx([0.0, 0.1, 0.25])
    assert [r.arrived_s for r in readings] == pytest.approx([0.05, 0.15, 0.3])
    assert [r.seq for r in readings] == [0, 1, 2]
    assert not any(r.rendered for r in readings)


def test_a_folder_plays_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    path = folder(tmp_path / "images", ["10.png", "9.png", "2.PNG"])
    (path / "notes.txt").write_text("not an image")
    readings = played(ImageFolder(path=path, rate_hz=20.0))
    assert levels(readings) == [3, 2, 1]
    assert [r.t_s for r in readings] == pytest.approx([0.0, 0.05, 0.1])


def test_a_folder_whose_names_are_times_plays_in_their_order(tmp_path: Path) -> None:
    """`str(time.time())` has as few digits as it can: .5 was before .25."""
    names = ["1700000000.5.png", "1700000000.25.png", "1700000001.0.png", "1700000000.125.png"]
    readings = played(ImageFolder(path=folder(tmp_path / "images", names), rate_hz=20.0))
    assert levels(readings) == [4, 2, 1, 3]


def test_a_reader_that_is_slow_misses_images_as_with_a_camera(tmp_path: Path) -> None:
    path = folder(tmp_path / "images", [f"{k}.png" for k in range(10)])

    async def play() -> tuple[list[int], int]:
        source = RecordedCamera(file=ImageFolder(path=path, rate_hz=10.0), intrinsics=SMALL)
        seqs = []
        async with source:
            async for reading in source:
                seqs.append(reading.seq)
                await asyncio.sleep(0.25)
        return seqs, source.counts.dropped

    seqs, dropped = run_virtual(play())
    assert seqs == [0, 2, 4, 7, 9]
    assert dropped == 5


def test_playing_twice_gives_the_same(tmp_path: Path) -> None:
    path = video(tmp_path / "v.mp4", [k / 30 for k in range(10)])
    first, second = (played(VideoFile(path=path)) for _ in range(2))
    assert [r.t_s for r in first] == [r.t_s for r in second]
    assert all(np.array_equal(a.image_bgr, b.image_bgr) for a, b in zip(first, second, strict=True))


def test_a_file_that_cannot_be_played_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("not a video at all")
    (tmp_path / "empty").mkdir()
    broken = folder(tmp_path / "broken", ["1.png"])
    (broken / "2.png").write_bytes(b"\x89PNG rubbish")
    refused(VideoFile(path=tmp_path / "none.mp4"), "no such file")
    refused(VideoFile(path=tmp_path / "text.mp4"), "video that can be decoded")
    refused(VideoFile(path=tmp_path), "folder|decoded")
    refused(ImageFolder(path=tmp_path / "none", rate_hz=1), "No such file")
    refused(ImageFolder(path=tmp_path / "empty", rate_hz=1), "has no image")
    refused(ImageFolder(path=broken, rate_hz=1), "2.png: cannot be read as an image")
    with pytest.raises(SourceError, match="rate is 0"):
        ImageFolder(path=tmp_path, rate_hz=0)


@pytest.mark.parametrize("kind", [".jpg", ".png", ".webp", ".tif"])
def test_a_picture_that_is_marked_as_rotated_is_refused_as_a_video_is(
    tmp_path: Path, kind: str
) -> None:
    """It was played lying on its side, or upside down."""
    path = folder(tmp_path / "images", ["1.png"])
    marked = Image.Exif()
    for orientation in (1, 6):
        marked[0x0112] = orientation
        with Image.open(path / "1.png") as image:
            image.save(path / f"{orientation}0{kind}", exif=marked)
    refused(
        ImageFolder(path=path, rate_hz=5),
        rf"60{kind}: cannot be .*\(EXIF orientation 6\), .*mogrify",
    )
    (path / f"60{kind}").unlink()
    assert len(played(ImageFolder(path=path, rate_hz=5))) == 2


@pytest.mark.parametrize("kind", [".png", ".tif"])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_picture_of_16_bits_is_refused(tmp_path: Path, kind: str, channels: int) -> None:
    """The white of a sensor of 12 bits was 15 of 255."""
    path = tmp_path / "images"
    path.mkdir()
    shape = (24, 32, 3)[: 2 + (channels == 3)]
    cv2.imwrite(str(path / f"1{kind}"), np.full(shape, 4095, np.uint16))
    refused(ImageFolder(path=path, rate_hz=5), "it has 16 bits a channel, .*scale it to 8 bits")
    with pytest.raises(OfflineError, match="it has 16 bits a channel"):
        read_image_reading(path / f"1{kind}", "real", InputFileOptics(69.0))


def test_a_picture_of_another_size_ends_it(tmp_path: Path) -> None:
    path = folder(tmp_path / "images", ["1.png", "2.png"])
    cv2.imwrite(str(path / "3.png"), np.zeros((24, 32, 3), np.uint8))
    refused(ImageFolder(path=path, rate_hz=5), "images are 32x24", ImageChangedError)


def test_a_video_cut_short_ends_or_says_so(tmp_path: Path) -> None:
    whole = video(tmp_path / "v.mp4", [k / 30 for k in range(30)]).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    refused(VideoFile(path=tmp_path / "cut.mp4"), "decoded|broken|ended")
    path = video(tmp_path / "v.mkv", [k / 10 for k in range(40)])
    assert len(played(VideoFile(path=path))) == 40
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    refused(VideoFile(path=path), "is cut off: its last image is at")


def mjpeg(path: Path, times_s: list[float]) -> Path:
    noise = np.random.default_rng(1)
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream: Any = container.add_stream("mjpeg", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for t_s in times_s:
            image = noise.integers(0, 256, (48, 64, 3), np.uint8)
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            frame.pts, frame.time_base = round(t_s * 10), Fraction(1, 10)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("name", ["v.avi", "v.mov"])
def test_a_video_of_single_images_that_was_cut_short_says_so(tmp_path: Path, name: str) -> None:
    """Half of it was played as all of it."""
    path = mjpeg(tmp_path / name, [k / 10 for k in range(40)])
    assert len(played(VideoFile(path=path))) == 40
    with av.open(str(path)) as container:
        ends = [packet.pos + packet.size for packet in container.demux(video=0) if packet.pos]
    path.write_bytes(path.read_bytes()[: ends[29]])
    refused(VideoFile(path=path), "is cut off: its last image is at 2.900 s, and it states 4.000 s")


def test_a_video_of_single_images_one_of_which_is_damaged_says_so(tmp_path: Path) -> None:
    """Its lower part showed the image before."""
    path = mjpeg(tmp_path / "v.avi", [k / 10 for k in range(20)])
    with av.open(str(path)) as container:
        (at, size) = [(one.pos, one.size) for one in container.demux(video=0)][9]
    data = bytearray(path.read_bytes())
    data[at + 8 + size // 2 : at + 8 + size] = bytes(size - size // 2)
    path.write_bytes(data)
    refused(VideoFile(path=path), "the file is damaged")


def test_a_video_whose_last_image_is_shown_for_long_is_whole(tmp_path: Path) -> None:
    path = mjpeg(tmp_path / "v.mov", [0.0, 0.1, 0.2])
    whole = VideoFile(path=path)
    whole.open()
    whole._stated_s = 60.0
    assert [whole.next() is not None for _ in range(4)] == [True, True, True, False]
    whole.close()


def test_closing_waits_for_the_reading_thread(tmp_path: Path) -> None:
    path = video(tmp_path / "v.mp4", [k / 100 for k in range(50)])

    async def cancelled() -> None:
        source = RecordedCamera(file=VideoFile(path=path), intrinsics=SMALL)
        for _ in range(5):
            async with source:
                waiting: Coroutine[Any, Any, CameraReading] = anext(source)
                task = asyncio.ensure_future(waiting)
                await asyncio.sleep(0)
                task.cancel()
            source = RecordedCamera(file=VideoFile(path=path), intrinsics=SMALL)

    asyncio.run(cancelled())


# MCAP

JPEG, BRIGHT = (
    cv2.imencode(".jpg", picture(level), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    for level in (60, 120)
)


def field(number: int, data: bytes) -> bytes:
    return bytes([number << 3 | 2]) + varint(len(data)) + data


def varint(value: int) -> bytes:
    out = b""
    while value > 0x7F:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


def protobuf(seconds: int, nanoseconds: int, image: bytes = JPEG) -> bytes:
    stamp = b"\x08" + varint(seconds) + b"\x10" + varint(nanoseconds)
    return field(1, stamp) + field(4, b"camera") + field(2, image) + field(3, b"jpeg")


def json_message(seconds: int, nanoseconds: int, image: bytes = JPEG) -> bytes:
    stamp = {"sec": seconds, "nsec": nanoseconds}
    data = base64.b64encode(image).decode()
    message = {"timestamp": stamp, "frame_id": "camera", "format": "jpeg", "data": data}
    return json.dumps(message).encode()


def ros2(seconds: int, nanoseconds: int, image: bytes = JPEG) -> bytes:
    head = struct.pack("<iI", seconds, nanoseconds) + struct.pack("<I", 4) + b"cam\0"
    head += struct.pack("<I", 5) + b"jpeg\0"
    head += b"\0" * (-len(head) % 4)
    return b"\0\1\0\0" + head + struct.pack("<I", len(image)) + image


def ros1(seconds: int, nanoseconds: int, image: bytes = JPEG) -> bytes:
    head = struct.pack("<III", 7, seconds, nanoseconds) + struct.pack("<I", 3) + b"cam"
    return head + struct.pack("<I", 4) + b"jpeg" + struct.pack("<I", len(image)) + image


KINDS = {
    "protobuf": ("foxglove.CompressedImage", "protobuf", protobuf),
    "json": ("foxglove.CompressedImage", "json", json_message),
    "ros2": ("sensor_msgs/msg/CompressedImage", "cdr", ros2),
    "ros1": ("sensor_msgs/CompressedImage", "ros1", ros1),
}


def stamped_mcap(path: Path, stamps_s: list[float], logged_s: list[float], **options: Any) -> Path:
    """Write images with these stamps and log times."""
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        schema_id = writer.register_schema("sensor_msgs/msg/CompressedImage", "x", b"")
        channel = writer.register_channel("/camera", "cdr", schema_id)
        for stamp_s, log_s in zip(stamps_s, logged_s, strict=True):
            message = ros2(int(stamp_s), round(stamp_s % 1.0 * 1e9), JPEG)
            writer.add_message(channel, round(log_s * 1e9), message, round(log_s * 1e9))
        writer.finish()  # type: ignore[no-untyped-call]  # of mcap
    return path


def mcap(path: Path, kind: str, topics: list[str], images: list[bytes], **options: Any) -> Path:
    schema, encoding, encode = KINDS[kind]
    with path.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start()
        schema_id = writer.register_schema(schema, "x", b"")
        for topic in topics:
            channel = writer.register_channel(topic, encoding, schema_id)
            for k, image in enumerate(images):
                message = encode(1000, 200_000_000 * k, image)
                writer.add_message(channel, log_time=k, data=message, publish_time=99 - k)
        writer.finish()  # type: ignore[no-untyped-call]  # of mcap
    return path


@pytest.mark.parametrize("kind", list(KINDS))
def test_mcap_images_play_by_their_own_stamps(kind: str, tmp_path: Path) -> None:
    path = mcap(tmp_path / "a.mcap", kind, ["/camera"], [JPEG] * 3)
    readings = played(McapFile(path=path))
    assert [r.t_s for r in readings] == pytest.approx([0.0, 0.2, 0.4])
    assert levels(readings) == [3, 3, 3]


EPOCH_S = 1_790_000_000.0


@pytest.mark.parametrize(
    ("stamps_s", "offsets_s"),
    [
        ([0.0, 0.2, 0.4, 0.6], [0.0, 0.1, 0.3, 0.5]),
        ([0.0, EPOCH_S + 0.1, EPOCH_S + 0.2, EPOCH_S + 0.35], [0.0, 0.1, 0.2, 0.35]),
        ([EPOCH_S, 0.0, 0.0, EPOCH_S + 0.3], [0.0, 0.1, 0.2, 0.3]),
        ([0.0] * 4, [0.0, 0.1, 0.2, 0.3]),
        ([5.0, 12.0, 19.0, 26.0], [0.0, 7.0, 14.0, 21.0]),
    ],
    ids=["simulated", "unset first", "unset later", "never set", "much faster"],
)
def test_a_stamp_of_0_loses_no_image(
    stamps_s: list[float], offsets_s: list[float], tmp_path: Path
) -> None:
    """The first one of a simulation's time was taken for a log time: 1 image of 600 was played."""
    logged_s = [EPOCH_S + 0.1 * k for k in range(4)]
    readings = played(McapFile(path=stamped_mcap(tmp_path / "a.mcap", stamps_s, logged_s)))
    assert [r.t_s for r in readings] == pytest.approx(offsets_s, abs=1e-6)


def test_a_clock_that_was_set_within_a_recording_is_named(tmp_path: Path) -> None:
    """The later images would be due in 57 years, and count neither as dropped nor as missed."""
    logged_s = [EPOCH_S + 0.1 * k for k in range(4)]
    path = stamped_mcap(tmp_path / "a.mcap", [3.0, 3.1, EPOCH_S, EPOCH_S + 0.1], logged_s)
    refused(McapFile(path=path), r"the stamp of message 0 is 1\.79e\+09 s after the one before")


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunking": False},
        {"use_chunking": False, "use_statistics": False, "use_summary_offsets": False},
        {"use_chunking": False, "repeat_channels": False, "repeat_schemas": False},
        {"index_types": IndexType.NONE},
        {"repeat_channels": False},
        {"repeat_channels": False, "use_statistics": False},
        {"repeat_schemas": False},
        {"repeat_channels": False, "repeat_schemas": False, "chunk_size": 400},
    ],
    ids=[
        "unchunked",
        "without statistics",
        "without a summary",
        "chunks without an index",
        "channels in the data alone",
        "channels and their number in the data alone",
        "schemas in the data alone",
        "both in the data alone",
    ],
)
def test_a_sound_file_with_little_in_its_summary_is_read(
    options: dict[str, Any], tmp_path: Path
) -> None:
    path = mcap(tmp_path / "a.mcap", "ros2", ["/left", "/right"], [JPEG] * 3, **options)
    readings = played(McapFile(path=path, topic="/right"))
    assert [r.t_s for r in readings] == pytest.approx([0.0, 0.2, 0.4])
    refused(McapFile(path=path), r"choose one of its image topics.*/left, /right")
    path.write_bytes(path.read_bytes()[:-40])
    refused(McapFile(path=path, topic="/right"), "truncated")


def test_chunks_and_messages_that_no_index_names_are_played(tmp_path: Path) -> None:
    """An index may have some of the chunks alone, and messages may stand beside chunks."""
    whole = mcap(tmp_path / "a.mcap", "ros2", ["/camera"], [JPEG] * 3, chunk_size=400).read_bytes()
    longer = mcap(tmp_path / "b.mcap", "ros2", ["/camera"], [JPEG] * 5, chunk_size=400).read_bytes()
    loose = mcap(tmp_path / "b.mcap", "ros2", ["/camera"], [JPEG] * 5, use_chunking=False)
    for more in (chunks_of(longer)[3:], messages_of(loose.read_bytes())[3:]):
        path = tmp_path / "c.mcap"
        path.write_bytes(with_more(whole, b"".join(more)))
        readings = played(McapFile(path=path))
        assert [reading.t_s for reading in readings] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])


def test_chunks_that_overlap_in_time_are_played_by_their_times(tmp_path: Path) -> None:
    times_s = [0.0, 1.0, 0.1, 0.2]
    two = len(JPEG) * 3 // 2
    path = stamped_mcap(tmp_path / "a.mcap", times_s, times_s, chunk_size=two)
    assert len(chunks_of(path.read_bytes())) == 2
    readings = played(McapFile(path=path))
    assert [reading.t_s for reading in readings] == pytest.approx([0.0, 0.1, 0.2, 1.0])


def test_a_channel_that_a_summary_leaves_out_is_found(tmp_path: Path) -> None:
    whole = mcap(tmp_path / "a.mcap", "ros2", ["/left", "/right"], [JPEG] * 3).read_bytes()
    repeated = [record for opcode, record in records_of(whole) if opcode == Opcode.CHANNEL][-1]
    at = whole.rindex(repeated)
    summary, offsets, _ = struct.unpack("<QQI", whole[-28:-8])
    footer = struct.pack("<QQI", summary, offsets - len(repeated), 0)
    shorter = whole[:at] + whole[at + len(repeated) : -28] + footer + whole[-8:]
    (tmp_path / "b.mcap").write_bytes(shorter)
    refused(McapFile(path=tmp_path / "b.mcap"), r"choose one of its image topics.*/left, /right")


def test_a_chunk_of_the_index_that_is_no_chunk_any_more_is_damage(tmp_path: Path) -> None:
    path = mcap(tmp_path / "a.mcap", "ros2", ["/camera"], [JPEG] * 3, chunk_size=400)
    whole = path.read_bytes()
    at = whole.index(chunks_of(whole)[1])
    path.write_bytes(whole[:at] + b"\x86" + whole[at + 1 :])
    refused(McapFile(path=path), f"its index names a chunk at byte {at}, where there is none")


def records_of(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the opcode and all bytes of each record of a file."""
    at = 8
    while at + 9 <= len(data):
        end = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        yield data[at], data[at:end]
        at = end


def chunks_of(data: bytes) -> list[bytes]:
    return [record for opcode, record in records_of(data) if opcode == Opcode.CHUNK]


def messages_of(data: bytes) -> list[bytes]:
    return [record for opcode, record in records_of(data) if opcode == Opcode.MESSAGE]


def with_more(data: bytes, more: bytes) -> bytes:
    """Return a file with more records at the end of its data; its footer finds the summary."""
    end = next(record for opcode, record in records_of(data) if opcode == Opcode.DATA_END)
    at, size = data.index(end), len(more)
    summary, offsets, _ = struct.unpack("<QQI", data[-28:-8])
    footer = struct.pack("<QQI", summary + size, offsets + size, 0)
    return data[:at] + more + data[at:-28] + footer + data[-8:]


def test_one_of_several_topics_is_named(tmp_path: Path) -> None:
    path = mcap(tmp_path / "a.mcap", "protobuf", ["/left", "/right"], [JPEG])
    assert len(played(McapFile(path=path, topic="/right"))) == 1
    refused(McapFile(path=path), r"choose one of its image topics.*/left, /right")
    with path.open("wb") as stream:  # of images at equal times one alone is seen
        writer = Writer(stream)
        writer.start()
        schema_id = writer.register_schema("sensor_msgs/msg/CompressedImage", "x", b"")
        for topic, image, time_s in (("/left", BRIGHT, 1), ("/right", JPEG, 2)):
            channel = writer.register_channel(topic, "cdr", schema_id)
            writer.add_message(channel, time_s, ros2(time_s, 0, image), time_s)
        writer.finish()  # type: ignore[no-untyped-call]  # of mcap
    assert levels(played(McapFile(path=path, topic="/right"))) == [3]
    assert levels(played(McapFile(path=path, topic="/left"))) == [6]
    refused(McapFile(path=path, topic="/front"), r"'/front'.*/left, /right")


def test_the_mixtures_of_a_run_are_no_camera_unless_they_are_named(tmp_path: Path) -> None:
    """A recording has no others by default, and a mixed gate would pass for a real one."""
    path = mcap(tmp_path / "run.mcap", "json", ["/mixed/camera"], [JPEG])
    refused(McapFile(path=path), r"by name \(it has: /mixed/camera\); .*pictures: jpeg")
    assert len(played(McapFile(path=path, topic="/mixed/camera"))) == 1


@pytest.mark.parametrize("name", ["a.mcap", "a.mp4", "a/1.png"])
def test_a_pointer_of_git_lfs_is_named(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    file: dict[str, ImageFile] = {
        "a.mcap": McapFile(path=path),
        "a.mp4": VideoFile(path=path),
        "a/1.png": ImageFolder(path=path.parent, rate_hz=10.0),
    }
    refused(file[name], "it is a pointer of Git LFS, not the file itself; run `git lfs pull`")


def test_a_file_that_is_no_mcap_says_so(tmp_path: Path) -> None:
    (tmp_path / "b.mcap").write_bytes(b"rubbish" * 100)
    cut = mcap(tmp_path / "c.mcap", "protobuf", ["/camera"], [JPEG] * 5)
    cut.write_bytes(cut.read_bytes()[:-700])
    refused(McapFile(path=tmp_path / "a.mcap"), "No such file")
    refused(McapFile(path=tmp_path / "b.mcap"), "not an MCAP file")
    refused(McapFile(path=cut), "truncated")
    broken = mcap(tmp_path / "d.mcap", "json", ["/camera"], [b"rubbish"])
    refused(McapFile(path=broken), "cannot be decoded")


@pytest.mark.parametrize("kind", list(KINDS))
def test_decoders_read_what_was_written(kind: str) -> None:
    schema, encoding, encode = KINDS[kind]
    decode = decoder_for(schema, encoding)
    assert decode is not None
    assert decode(encode(12, 500_000_000)) == CompressedImage(12.5, "jpeg", JPEG)
    assert decode(encode(0, 0)).stamp_s is None


JSON = st.recursive(
    st.none() | st.integers() | st.text(max_size=5),
    lambda inner: st.dictionaries(
        st.sampled_from(["timestamp", "sec", "nsec", "data", "format"]), inner, max_size=4
    ),
).map(lambda value: json.dumps(value).encode())


@given(kind=st.sampled_from(list(KINDS)), data=st.binary(max_size=80) | JSON)
def test_decoders_of_garbage_say_so_or_give_bytes(kind: str, data: bytes) -> None:
    decode = decoder_for(*KINDS[kind][:2])
    assert decode is not None
    try:
        image = decode(data)
    except BadMessageError:
        return
    assert isinstance(image.data, bytes)
