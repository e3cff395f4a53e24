"""Decompresses chunks of MCAP files within limits: a few bytes may claim to be gigabytes."""

import struct
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream

from wil_campaign.foundation.files.limits import MAX_CHUNK_BYTES, MAX_CHUNK_RECORDS

RECORD_HEAD = struct.Struct("<BQ")
"""Opcode and length of a record: MCAP specification, "Records"."""


class ChunkLimitError(McapError):
    """A chunk or record exceeds the size limit; says by how much."""


DAMAGED = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    RuntimeError,  # lz4 raises it for a damaged frame
    struct.error,
    UnicodeDecodeError,
    IndexError,
    EOFError,
    OverflowError,  # a length beyond what a machine addresses
)
"""The errors that reading a damaged chunk raises, from all libraries involved."""


def check_record_length(length_bytes: int) -> None:
    """Raise ChunkLimitError for a record that is too long to be read."""
    if length_bytes > MAX_CHUNK_BYTES:
        raise ChunkLimitError(
            f"a record has {length_bytes} bytes; at most {MAX_CHUNK_BYTES} are read"
        )


def chunk_records(chunk: Chunk) -> Iterator[Schema | Channel | Message]:
    """Yield the records of a chunk one by one.

    Raises ChunkLimitError before more than the limit is decompressed, and the errors of the
    decompressors and of mcap for a damaged chunk.
    """
    data = _decompressed(chunk)
    if len(data) != chunk.uncompressed_size:
        # Where it has no checksum, records would be missing without a word.
        raise McapError(f"a chunk states {chunk.uncompressed_size} bytes and has {len(data)}")
    plain = replace(chunk, compression="", data=data, uncompressed_size=len(data))
    get_chunk_data_stream(plain, validate_crc=True)
    at = count = 0
    while at < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        at += RECORD_HEAD.size
        if at + length > len(data):
            raise EOFError("a record extends beyond the end of its chunk")
        count += 1
        if count > MAX_CHUNK_RECORDS:
            raise ChunkLimitError(f"a chunk has more than {MAX_CHUNK_RECORDS} records")
        content, at = data[at : at + length], at + length
        if opcode == Opcode.MESSAGE:
            yield Message.read(ReadDataStream(BytesIO(content)), length)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(content)))
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(BytesIO(content)))


def _decompressed(chunk: Chunk) -> bytes:
    check_record_length(chunk.uncompressed_size)
    if chunk.compression == "zstd":
        stated = zstandard.get_frame_parameters(chunk.data).content_size
        if stated not in {chunk.uncompressed_size, zstandard.CONTENTSIZE_UNKNOWN}:
            raise ChunkLimitError(
                f"a chunk states {chunk.uncompressed_size} bytes and its data {stated}"
            )
        return zstandard.ZstdDecompressor(max_window_size=MAX_CHUNK_BYTES).decompress(
            chunk.data, max_output_size=chunk.uncompressed_size
        )
    if chunk.compression == "lz4":
        decompressor = lz4.frame.LZ4FrameDecompressor()
        data: bytes = decompressor.decompress(chunk.data, max_length=chunk.uncompressed_size)
        if not decompressor.eof:
            raise ChunkLimitError(
                f"a chunk has more data than the {chunk.uncompressed_size} bytes it states"
            )
        return data
    if chunk.compression:
        raise McapError(f"a chunk is compressed by {chunk.compression!r}, not by zstd or lz4")
    return chunk.data
