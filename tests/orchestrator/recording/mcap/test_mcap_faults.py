"""run.mcap when something goes wrong: cut, killed, late, full, and none at all."""

import errno
import io
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from io import FileIO
from pathlib import Path
from typing import Any, cast

import pytest
import zstandard
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

from tests.orchestrator.mcap_runs import (
    PROVENANCE,
    SMALL_CHUNKS,
    a_run,
    camera,
    key,
    read,
    recorder,
)
from wil_campaign.foundation import background_file
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap import mcap_file, mcap_writer
from wil_campaign.orchestrator.recording.mcap.mcap_encode import McapEncoder
from wil_campaign.orchestrator.recording.mcap.mcap_settings import LOSSLESS
from wil_campaign.orchestrator.recording.mcap.mcap_writer import RecordingReport
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.plugins.python.mcap_reader import (
    RecordedEvent,
    RecordedReading,
    Recording,
)
from wil_campaign.vehicles.readings import Reading


def test_equal_runs_give_equal_bytes_and_the_report_counts(tmp_path: Path) -> None:
    reports = [a_run(tmp_path / name) for name in ("a.mcap", "b.mcap")]
    a, b = ((tmp_path / name).read_bytes() for name in ("a.mcap", "b.mcap"))
    assert a == b
    assert reports[0] == RecordingReport(1 + 30 * 4 + 1, (), 0, len(a), None)
    assert reports[0].complete
    a_run(tmp_path / "c.mcap", epoch_s=VIRTUAL_EPOCH_S + 1.0)
    assert (tmp_path / "c.mcap").read_bytes() != a


def test_a_backlog_of_one_picture_gives_the_same_bytes_under_a_virtual_clock(
    tmp_path: Path,
) -> None:
    a_run(tmp_path / "a.mcap")
    report = a_run(tmp_path / "b.mcap", settings=replace(LOSSLESS, backlog_bytes=1))
    assert report.complete
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_it_records_within_a_virtual_run(tmp_path: Path) -> None:
    async def run() -> RecordingReport:
        with recorder(tmp_path / "run.mcap") as one:
            one.event(0.0, "info", "stage", "ready")
            return one.close()

    assert run_virtual(run()).complete
    assert len(read(tmp_path / "run.mcap")[0]) == 1


def test_a_cut_file_reads_up_to_its_last_whole_chunk(tmp_path: Path) -> None:
    path, cut = tmp_path / "run.mcap", tmp_path / "cut.mcap"
    a_run(path, settings=SMALL_CHUNKS)
    whole = path.read_bytes()
    everything = [key(one) for one in read(path)[0]]
    ends = list(_chunk_ends(whole))
    assert len(ends) > 6
    for length in range(0, len(whole), 1000):
        cut.write_bytes(whole[:length])
        found, recording = read(cut)
        assert [key(one) for one in found] == everything[: len(found)]
        chunks = sum(end <= length for end, _ in ends)
        messages = sum(count for _, count in ends[:chunks])
        assert len(found) == messages
        assert recording.end is not None
        assert not recording.end.whole
        assert f"byte {recording.end.read_bytes}" in recording.end.reason


def _chunk_ends(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield where each chunk ends, and how many of its messages are items of ours."""
    reader = StreamReader(io.BytesIO(data), emit_chunks=True)
    position = 8
    channels: dict[int, str] = {}
    for record in reader.records:
        if type(record).__name__ == "DataEnd":
            return
        opcode_and_length = data[position : position + 9]
        position += 9 + int.from_bytes(opcode_and_length[1:], "little")
        if type(record).__name__ == "Chunk":
            inner = StreamReader(io.BytesIO(_records_of(record)), skip_magic=True)
            count = 0
            for one in _until_end(inner):
                if type(one).__name__ == "Channel":
                    channels[one.id] = one.metadata["part"]
                elif type(one).__name__ == "Message":
                    count += channels[one.channel_id] in {"reading", "provenance", "event"}
            yield position, count


def _records_of(chunk: Any) -> bytes:
    return zstandard.decompress(chunk.data, chunk.uncompressed_size)


def _until_end(reader: StreamReader) -> Iterator[Any]:
    try:
        yield from reader.records
    except EndOfFile:
        return


def test_a_damaged_chunk_ends_the_reading_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    a_run(path, settings=SMALL_CHUNKS)
    data = bytearray(path.read_bytes())
    (first, first_count), (second, _) = list(_chunk_ends(bytes(data)))[:2]
    assert second - first > 9000
    for back in (10, 500, 3000, 8000):
        broken = bytearray(data)
        broken[second - back] ^= 0xFF
        path.write_bytes(broken)
        found, recording = read(path)
        assert recording.end is not None
        assert not recording.end.whole
        assert recording.end.reason.startswith(f"damaged after byte {recording.end.read_bytes}")
        assert first <= recording.end.read_bytes < second
        assert len(found) == first_count


def test_each_flipped_byte_of_the_data_is_noticed(tmp_path: Path) -> None:
    path, damaged = tmp_path / "run.mcap", tmp_path / "damaged.mcap"
    a_run(path, settings=SMALL_CHUNKS)
    whole = path.read_bytes()
    data_end = _data_end(whole)
    heads = {place for place, _ in _records_outside_chunks(whole) if place <= data_end}
    unnoticed = []
    for place in sorted({*range(8, data_end + 13, 997), *heads}):
        damaged.write_bytes(whole[:place] + bytes([whole[place] ^ 0x10]) + whole[place + 1 :])
        recording = Recording(damaged)
        try:
            for _ in recording:
                pass
        except RecordingError:
            continue
        if recording.end is None or recording.end.whole or not recording.end.reason:
            unnoticed.append(place)
    assert not unnoticed


def test_a_recording_of_before_its_checksum_reads_as_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    a_run(path, settings=SMALL_CHUNKS)
    data = bytearray(path.read_bytes())
    place = _data_end(bytes(data))
    data[place + 9 : place + 13] = bytes(4)
    path.write_bytes(data)
    _, recording = read(path)
    assert recording.end is not None
    assert recording.end.whole


def _data_end(data: bytes) -> int:
    return next(at for at, opcode in _records_outside_chunks(data) if opcode == Opcode.DATA_END)


def _records_outside_chunks(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield where each record outside of chunks begins, and its opcode."""
    at = 8
    while at + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield at, opcode
        at += 9 + length


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01"])
def test_a_file_with_nothing_in_it_yet(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    found, recording = read(path)
    assert found == []
    assert recording.end is not None
    assert not recording.end.whole


def test_a_file_that_is_something_else_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"schema: wil/recipe/1\n")
    with pytest.raises(RecordingError, match=r"run\.mcap: not an MCAP file"):
        list(Recording(path))


def test_a_file_of_others_has_nothing_for_us_and_a_forged_one_is_refused(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "other.mcap"
    for facts, message in (({}, b"{}"), ({"part": "reading"}, b"{}"), ({"part": "event"}, b"[")):
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema("x", "jsonschema", b"{}")
            channel = writer.register_channel("/x", "json", schema, facts)
            writer.add_message(channel, 1, message, 1)
            writer.finish()  # type: ignore[no-untyped-call]  # of mcap
        if not facts:
            assert list(Recording(path)) == []
        else:
            with pytest.raises(RecordingError, match=r"/x at 1 ns cannot be read"):
                list(Recording(path))


class _Held:
    """Stands in for the encoder's camera: holds the writing thread until it is let go."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.go = threading.Event()
        original = McapEncoder.encode

        def held(encoder: Any, sensor: str, reading: Reading) -> Any:
            self.go.wait(10.0)
            return original(encoder, sensor, reading)

        monkeypatch.setattr(McapEncoder, "encode", held)


def test_a_wall_clock_drops_what_is_new_and_counts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = _Held(monkeypatch)
    path = tmp_path / "run.mcap"
    settings = replace(LOSSLESS, backlog_bytes=3 * 30_000)
    with recorder(path, clock="wall", settings=settings) as run:
        started_s = time.monotonic()
        for k in range(10):
            run.reading("camera", camera(k))
        run.mixed("camera", camera(3, "mixed"), PROVENANCE, now_s=0.4)
        waited_s = time.monotonic() - started_s
        held.go.set()
        report = run.close()
    assert waited_s < 5.0  # to wait for the thread takes 10 s
    assert report.dropped == (("/mixed/camera", 1), ("/real/camera", 7))
    assert not report.complete
    found, recording = read(path)
    assert [key(one)[2] for one in found] == [0, 1, 2, 4]  # the last is the provenance
    assert recording.counts["dropped /real/camera"] == "7"


def test_a_picture_that_cannot_be_encoded_is_counted_and_reported(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    broken = replace(camera(5), image_bgr=cast("Any", None))
    with recorder(path) as run:
        run.reading("camera", camera(4))
        run.reading("camera", broken)
        run.reading("camera", camera(6))
        report = run.close()
    assert (report.failed, report.fault) == (1, None)
    found, _ = read(path)
    events = [one for one in found if isinstance(one, RecordedEvent)]
    assert [key(one)[2] for one in found if isinstance(one, RecordedReading)] == [4, 6]
    assert events[0].level == 4
    assert "AttributeError" in events[0].message


@pytest.mark.parametrize("clock", ["virtual", "wall"])
def test_a_full_disk_ends_the_recording_and_not_the_flight(
    tmp_path: Path, clock: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = [60_000]

    class Small(FileIO):
        def write(self, data: Any) -> int:
            if room[0] <= 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written = super().write(bytes(data)[: room[0]])
            room[0] -= written
            return written

    monkeypatch.setattr(mcap_file, "FileIO", Small)
    path = tmp_path / "run.mcap"
    report = a_run(path, clock=clock, settings=SMALL_CHUNKS)
    assert report.fault == "run.mcap: No space left on device; recording ended"
    assert not report.unfinished
    assert report.failed > 0
    assert path.stat().st_size == 60_000
    found, recording = read(path)
    assert len(found) > 10
    assert recording.end is not None
    assert not recording.end.whole


def test_the_end_of_a_recording_does_not_wait_for_ever_for_a_disk_that_takes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(background_file, "_MOST_POLLS", 2)
    monkeypatch.setattr(background_file, "_LEAST_POLLS", 2)
    monkeypatch.setattr(mcap_writer, "patience", background_file.DiskPatience())
    released = threading.Event()

    class Stalled(FileIO):
        def write(self, data: Any) -> int:
            assert released.wait(60.0)
            return super().write(data)

    monkeypatch.setattr(mcap_file, "FileIO", Stalled)
    others = set(threading.enumerate())  # also of flights whose disk took nothing
    with recorder(tmp_path / "run.mcap") as run:
        run.reading("camera", camera())
        report = run.close()
    said = "the disk takes nothing, 2 messages wait for it"
    assert (report.fault, report.unfinished, report.complete) == (said, True, False)
    released.set()
    for thread in set(threading.enumerate()) - others:
        thread.join()
    found, recording = read(tmp_path / "run.mcap")
    assert len(found) == 1
    assert recording.end is not None
    assert recording.end.whole, "a disk that comes back gets all"


def test_a_write_that_is_reported_as_lost_when_the_file_is_closed_is_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Remote(FileIO):
        def close(self) -> None:
            if not self.closed:
                super().close()
                raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(mcap_file, "FileIO", Remote)
    report = a_run(tmp_path / "run.mcap")
    assert (report.fault, report.complete) == ("run.mcap: Input/output error", False)


def test_a_reading_after_the_end_of_a_recording_is_ignored(tmp_path: Path) -> None:
    with recorder(tmp_path / "run.mcap") as run:
        first = run.close()
        run.reading("camera", camera())
        assert run.close() is first


def test_a_file_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError), recorder(path):
        pass
    assert path.read_bytes() == b"precious"


KILLED = """
import sys, time
import numpy as np
from pathlib import Path
from wil_campaign.orchestrator.recording.mcap import mcap_writer
from wil_campaign.vehicles.readings import CameraReading, PoseReading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
rng = np.random.default_rng(1)
mcap_writer._IDLE_FLUSH_S = 3600.0  # the last chunk is to be open
with mcap_writer.McapRecorder(path=Path(sys.argv[1]), epoch_s=1.7e9, clock="wall") as run:
    for k in range(400):
        t = k / 100
        image = rng.integers(0, 255, (48, 64, 3), np.uint8)
        run.reading("camera", CameraReading(t, t, k, "real", image, Intrinsics.from_fov(64, 48, 1)))
        run.reading("pose", PoseReading(t, t, "real", Pose((t, 0.0, 0.0)), seq=k))
        time.sleep(0.0005)
    print("all", flush=True)
    time.sleep(600.0)
"""


def readings_in(path: Path) -> int:
    return sum(isinstance(one, RecordedReading) for one in read(path)[0])


def test_a_writer_killed_with_9_leaves_all_but_its_last_chunk(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = subprocess.Popen(  # noqa: S603  # our own program
        [sys.executable, "-c", KILLED, str(path)],
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[4],
        text=True,
    )
    try:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "all\n"
        # Its thread may still have some to write.
        give_up_s = time.monotonic() + 60.0
        while readings_in(path) <= 2 * 250 and time.monotonic() < give_up_s:
            time.sleep(0.05)
    finally:
        writer.send_signal(signal.SIGKILL)
        writer.wait(10.0)
        assert writer.stdout is not None
        writer.stdout.close()
    found, recording = read(path)
    numbers = [key(one)[2] for one in found if isinstance(one, RecordedReading)]
    assert numbers == [k // 2 for k in range(len(numbers))]
    assert 2 * 250 < len(numbers) < 2 * 400  # at most chunk_s is lost, for the thread has caught up
    assert recording.end is not None
    assert not recording.end.whole


def test_a_chunk_is_written_while_nothing_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_writer, "_IDLE_FLUSH_S", 0.01)
    path = tmp_path / "run.mcap"
    with recorder(path, clock="wall") as run:
        run.event(0.0, "info", "stage", "hold")
        deadline_s = time.monotonic() + 60.0
        while not read(path)[0] and time.monotonic() < deadline_s:
            time.sleep(0.005)
        assert len(read(path)[0]) == 1
