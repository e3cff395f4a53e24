"""Chunks of MCAP files that are small and state much: refused before memory is taken."""

import struct
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk

from wil_campaign.foundation.files.limits import MAX_CHUNK_BYTES
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import MAGIC, RecordStream
from wil_campaign.plugins.cameras.mcap_images import McapFile
from wil_campaign.plugins.python.mcap_reader import Recording
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.mcap_limits import ChunkLimitError, chunk_records

CLAIMED_BYTES = 30_000_000


@pytest.fixture(autouse=True)
def limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have less to decompress than the limits that users have."""
    monkeypatch.setattr("wil_campaign.vehicles.sources.mcap_limits.MAX_CHUNK_BYTES", 20_000_000)
    monkeypatch.setattr("wil_campaign.vehicles.sources.mcap_limits.MAX_CHUNK_RECORDS", 500)


def chunk(data: bytes, size: int, compression: str) -> Chunk:
    return Chunk(compression, data, 0, 0, 0, size)


def bomb(*, states_size: bool) -> bytes:
    """Return zeros in zstd: a ten thousandth of what they become."""
    compressor = zstandard.ZstdCompressor(write_content_size=states_size)
    return compressor.compress(bytes(CLAIMED_BYTES))


BOMB = bomb(states_size=True)


def written(path: Path, one: Chunk) -> Path:
    """Write a file with one chunk and no index."""
    body = struct.pack("<QQQI", 0, 0, one.uncompressed_size, 0)
    body += struct.pack("<I", len(one.compression)) + one.compression.encode()
    body += struct.pack("<Q", len(one.data)) + one.data
    head = struct.pack("<BQ", Opcode.CHUNK, len(body))
    path.write_bytes(MAGIC + head + body + struct.pack("<BQ", Opcode.FOOTER, 20) + bytes(20))
    return path


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (chunk(BOMB, CLAIMED_BYTES, "zstd"), "at most 20000000 are read"),
        (chunk(BOMB, 10_000, "zstd"), "a chunk states 10000 bytes and its data 30000000"),
        (
            chunk(lz4.frame.compress(bytes(1 << 22)), 10_000, "lz4"),
            "more data than the 10000 bytes",
        ),
        (chunk(b"", 1 << 60, ""), "at most 20000000 are read"),
        (chunk(struct.pack("<BQ", 0, 0) * 600, 5_400, ""), "more than 500 records"),
    ],
)
def test_a_chunk_that_states_too_many_bytes_is_refused(
    one: Chunk, said: str, tmp_path: Path
) -> None:
    tracemalloc.start()
    with pytest.raises(ChunkLimitError, match=said):
        list(chunk_records(one))
    with pytest.raises(RecordingError, match=said):
        list(RecordStream(written(tmp_path / "a.mcap", one)))
    assert tracemalloc.get_traced_memory()[1] < 5e6
    tracemalloc.stop()
    assert len(BOMB) < 10_000
    assert MAX_CHUNK_BYTES < 500_000_000


def test_data_that_does_not_state_its_size_is_damaged(tmp_path: Path) -> None:
    data = bomb(states_size=False)
    path = written(tmp_path / "a.mcap", chunk(data, 10_000, "zstd"))
    stream = RecordStream(path)
    assert list(stream) == []
    assert stream.end is not None
    assert stream.end.reason.startswith("damaged after byte 8")


def test_replay_refuses_it_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "run.mcap", chunk(BOMB, CLAIMED_BYTES, "zstd"))
    assert main(["replay", str(path)]) == 2
    assert "at most 20000000 are read" in capsys.readouterr().err


def test_a_message_that_is_all_brackets_is_not_read(tmp_path: Path) -> None:
    from wil_campaign.plugins.python import mcap_reader

    for data in (b"[" * 6_000_000, b"[" * 100_000):
        with pytest.raises(ValueError, match=r"values|nested"):
            mcap_reader._loads(data)
    assert list(Recording(written(tmp_path / "a.mcap", chunk(b"", 0, "")))) == []


def test_a_camera_file_without_an_index_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", chunk(BOMB, CLAIMED_BYTES, "zstd"))
    file = McapFile(path=path)
    with pytest.raises(SourceError, match=r"not an MCAP file|choose one of its image topics"):
        file.open()
    file.close()


RECORD = struct.pack("<BQ", Opcode.SCHEMA, 15) + struct.pack("<HI", 1, 1) + b"a" + bytes(8)
UNSTATED = zstandard.ZstdCompressor(write_content_size=False)


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (chunk(UNSTATED.compress(RECORD) * 2, 2 * len(RECORD), "zstd"), "states 48 bytes and has"),
        (chunk(lz4.frame.compress(RECORD) * 2, 2 * len(RECORD), "lz4"), "states 48 bytes and has"),
        (chunk(RECORD, 2 * len(RECORD), ""), "a chunk states 48 bytes and has 24"),
        (chunk(RECORD * 2, len(RECORD), ""), "a chunk states 24 bytes and has 48"),
        (chunk(RECORD, len(RECORD), "brotli"), "compressed by 'brotli', not by zstd or lz4"),
    ],
)
def test_a_chunk_of_which_records_would_be_missing_is_damaged(
    one: Chunk, said: str, tmp_path: Path
) -> None:
    """It has no checksum: some of its records were skipped without a word."""
    with pytest.raises(McapError, match=said):
        list(chunk_records(one))
    stream = RecordStream(written(tmp_path / "a.mcap", one))
    assert list(stream) == []
    assert stream.end is not None
    assert said in stream.end.reason


def test_a_message_whose_channel_has_no_record_is_damage(tmp_path: Path) -> None:
    """The record of the channel was damaged in a file without checksums: its messages went."""
    message = struct.pack("<BQ", Opcode.MESSAGE, 22) + struct.pack("<HIQQ", 7, 0, 1, 1)
    stream = RecordStream(written(tmp_path / "a.mcap", chunk(message, len(message), "")))
    assert list(stream) == []
    assert stream.end is not None
    assert "a message is of channel 7, which has no record" in stream.end.reason
