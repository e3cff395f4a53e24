"""Reads the records of an MCAP file in order, as far as the file is whole.

The official reader needs a footer, which the file of a killed writer lacks; this one only needs the
records. Format: the MCAP specification, version 0.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Message, Metadata, Schema

from wil_campaign.foundation.files.paths import open_at_once
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.vehicles.sources.mcap_limits import (
    DAMAGED,
    ChunkLimitError,
    check_record_length,
    chunk_records,
)

MAGIC = b"\x89MCAP0\r\n"


Record = Schema | Channel | Message | Metadata


@dataclass(frozen=True, slots=True)
class RecordStreamEnd:
    """Where reading an MCAP file ended. whole: its writer closed it. reason: why not."""

    whole: bool
    read_bytes: int
    reason: str = ""


class RecordStream:
    """Iterates over an MCAP file's records, chunk by chunk; `end` tells where it ended.

    Memory: one chunk. The checksum of all data, where the file has it, is compared at their end:
    a chunk whose own head is damaged looks like a record of another kind, which is skipped. Raises
    RecordingError for a file that is not MCAP; OSError.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.end: RecordStreamEnd | None = None
        self._checksum = 0
        self._has_all_data = False
        self._channels: set[int] = set()

    def __iter__(self) -> Iterator[Record]:
        with open_at_once(self._path) as file:
            size_bytes = self._path.stat().st_size
            magic = file.read(len(MAGIC))
            if not MAGIC.startswith(magic):
                raise RecordingError(f"{self._path}: not an MCAP file (it begins with {magic!r})")
            self.end = None
            self._channels.clear()
            self._checksum, self._has_all_data = zlib.crc32(magic), False
            while self.end is None:
                yield from self._read_records(file, size_bytes)

    def _read_records(self, file: IO[bytes], size_bytes: int) -> Iterator[Record]:
        """Yield the MCAP file's next records; set `end` when it is cut or damaged."""
        begin = file.tell()
        head = file.read(9)
        length = struct.unpack("<Q", head[1:])[0] if len(head) == 9 else 0
        if len(head) < 9 or file.tell() + length > size_bytes:
            self.end = RecordStreamEnd(
                whole=False, read_bytes=begin, reason=f"cut after byte {begin}"
            )
            return
        try:
            check_record_length(length)
            content = file.read(length)
            if head[0] == Opcode.FOOTER:
                self.end = self._footer(file, begin)
                return
            if not self._has_all_data and self._data_differ(head, content):
                reason = f"damaged before byte {begin}: the checksum of its data differs"
                self.end = RecordStreamEnd(whole=False, read_bytes=begin, reason=reason)
                return
            for record in _parse(head[0], content):
                self._require_channel(record)
                yield record
        except ChunkLimitError as error:
            raise RecordingError(f"{self._path}: after byte {begin}: {error}") from error
        except DAMAGED as error:
            text = str(error) if isinstance(error, McapError) else type(error).__name__
            reason = f"damaged after byte {begin}: {text}"
            self.end = RecordStreamEnd(whole=False, read_bytes=begin, reason=reason)

    def _require_channel(self, record: Record) -> None:
        """Raise McapError for a message whose channel has no record: nobody can say what it is."""
        if isinstance(record, Channel):
            self._channels.add(record.id)
        elif isinstance(record, Message) and record.channel_id not in self._channels:
            raise McapError(f"a message is of channel {record.channel_id}, which has no record")

    def _data_differ(self, head: bytes, content: bytes) -> bool:
        """Return whether the checksum of the MCAP file's data differs at their end; 0: it has none.

        Until then count a record into it.
        """
        if head[0] != Opcode.DATA_END:
            self._checksum = zlib.crc32(content, zlib.crc32(head, self._checksum))
            return False
        self._has_all_data = True
        stated = DataEnd.read(ReadDataStream(BytesIO(content))).data_section_crc
        return stated not in {0, self._checksum}

    def _footer(self, file: IO[bytes], begin: int) -> RecordStreamEnd:
        if not self._has_all_data:
            reason = f"damaged before byte {begin}: the record of the end of its data is missing"
            return RecordStreamEnd(whole=False, read_bytes=begin, reason=reason)
        if file.read(len(MAGIC)) == MAGIC:
            return RecordStreamEnd(whole=True, read_bytes=file.tell())
        return RecordStreamEnd(whole=False, read_bytes=begin, reason=f"cut after byte {begin}")


def _parse(opcode: int, content: bytes) -> Iterator[Record]:
    """Yield the records in an MCAP record's content; chunks are unpacked."""
    stream = ReadDataStream(BytesIO(content))
    # The index of a closed file repeats schemas and channels: reading them twice is harmless.
    match opcode:
        case Opcode.CHUNK:
            yield from chunk_records(Chunk.read(stream))
        case Opcode.METADATA:
            yield Metadata.read(stream)
        case Opcode.SCHEMA:
            yield Schema.read(stream)
        case Opcode.CHANNEL:
            yield Channel.read(stream)
        case Opcode.MESSAGE:
            yield Message.read(stream, len(content))
