"""Writes an MCAP file in chunks, each of which reaches the operating system as a whole."""

from io import FileIO
from pathlib import Path

from mcap.writer import CompressionType, Writer

from wil_campaign.orchestrator.recording.mcap.mcap_encode import McapChannel, McapMessage
from wil_campaign.orchestrator.recording.mcap.mcap_schemas import mcap_schema_texts

LIBRARY = "wil-campaign"

_COMPRESSION = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
_NEVER = 1 << 62
"""A size at which the library never ends a chunk: this module does, and writes it at once."""
_MESSAGE_OVERHEAD_BYTES = 31


class _Unbuffered:
    """The unbuffered file under the MCAP library: every write reaches the operating system.

    A Python buffer would be lost with a killed process; on a full disk it would be written again,
    and fail again, when the file is closed.
    """

    def __init__(self, raw: FileIO) -> None:
        self._raw = raw

    def write(self, data: bytes) -> int:
        """Write all bytes to the MCAP file. Raises OSError."""
        rest = memoryview(data)
        while rest:
            rest = rest[self._raw.write(rest) :]
        return len(data)

    def tell(self) -> int:
        """Return how many bytes the MCAP file has."""
        return self._raw.tell()

    def flush(self) -> None:
        """Do nothing: the MCAP file has no buffer."""


class ChunkedFile:
    """Writes an MCAP file in chunks; raises OSError when the disk fails.

    A chunk ends when it holds chunk_bytes or spans chunk_ns of log time, by the messages alone:
    equal messages give equal bytes. Raises FileExistsError for an existing file.
    """

    def __init__(self, *, path: Path, compression: str, chunk_bytes: int, chunk_ns: int) -> None:
        self._raw = FileIO(str(path), "xb")
        self._writer = Writer(
            _Unbuffered(self._raw),  # type: ignore[arg-type]  # it only needs these methods
            chunk_size=_NEVER,
            compression=_COMPRESSION[compression],
            enable_data_crcs=True,
        )
        self._chunk_bytes = chunk_bytes
        self._chunk_ns = chunk_ns
        self._channels: dict[McapChannel, int] = {}
        self._schemas: dict[str, int] = {}
        self._pending_bytes = 0
        self._began_ns = 0

    def start(self, metadata: dict[str, str]) -> None:
        """Write the MCAP file's header and schemas."""
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata("wil.recording", metadata)

    def write(self, message: McapMessage, schema: bytes | None = None) -> None:
        """Append a message to the MCAP file; schema: of its channel unless fixed."""
        if self._pending_bytes == 0:
            self._began_ns = message.log_ns
        self._writer.add_message(
            self._channel(message.channel, schema),
            log_time=message.log_ns,
            publish_time=message.publish_ns,
            sequence=message.sequence,
            data=message.data,
        )
        self._pending_bytes += len(message.data) + _MESSAGE_OVERHEAD_BYTES
        spans_ns = message.log_ns - self._began_ns
        if self._pending_bytes >= self._chunk_bytes or spans_ns >= self._chunk_ns:
            self.flush()

    def flush(self) -> None:
        """End the MCAP file's chunk; what was written so far survives a killed process."""
        if self._pending_bytes:
            self._pending_bytes = 0
            self._writer.flush()  # type: ignore[no-untyped-call]  # mcap leaves it untyped

    def finish(self, metadata: dict[str, str]) -> None:
        """Write the MCAP file's last chunk, metadata and the index."""
        self.flush()
        self._writer.add_metadata("wil.counts", metadata)
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it untyped

    def close(self) -> int:
        """Close the MCAP file and return its size in bytes."""
        size = self._raw.tell()
        self._raw.close()
        return size

    def _channel(self, channel: McapChannel, schema: bytes | None) -> int:
        known = self._channels.get(channel)
        if known is not None:
            return known
        if channel.schema not in self._schemas:
            text = mcap_schema_texts()[channel.schema] if schema is None else schema
            number = self._writer.register_schema(channel.schema, "jsonschema", text)
            self._schemas[channel.schema] = number
        facts = {"source": channel.source, "sensor": channel.sensor, "part": channel.part}
        self._channels[channel] = self._writer.register_channel(
            channel.topic, "json", self._schemas[channel.schema], facts
        )
        return self._channels[channel]
