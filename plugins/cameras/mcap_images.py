"""The compressed images of one topic of an MCAP file, as a recording."""

from collections.abc import Collection, Iterable, Iterator
from heapq import heappop, heappush
from io import SEEK_CUR, BytesIO
from itertools import count
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import MAGIC_SIZE, StreamReader
from mcap.summary import Summary

from wil_campaign.foundation.files.images import ImageError
from wil_campaign.foundation.files.lfs import LFS_POINTER, is_lfs_file
from wil_campaign.foundation.files.limits import MAX_CHUNK_BYTES
from wil_campaign.plugins.cameras.camera_images import decode_camera_image
from wil_campaign.plugins.cameras.compressed_image import Decode, decoder_for
from wil_campaign.plugins.cameras.recorded_camera import RecordedImage
from wil_campaign.plugins.readings.messagepack import BadMessageError
from wil_campaign.plugins.readings.sender_clock import clock_set_text
from wil_campaign.vehicles.sources.camera_source import SourceError
from wil_campaign.vehicles.sources.mcap_limits import (
    DAMAGED,
    RECORD_HEAD,
    check_record_length,
    chunk_records,
)

_DRAWN = (
    "in a run's recording, images that the program drew are there with record: {pictures: jpeg}"
)
_TIMES = {Opcode.CHUNK: 0, Opcode.MESSAGE: 6}
"""Where in the content of a chunk its earliest log time stands, and in a message its own."""
_NO_SCHEMA = 0


def _is_mixture(topic: str) -> bool:
    """Return whether a topic is that of a run's mixtures: virtual objects are in them already."""
    return topic.startswith("/mixed/")


class _Timed(NamedTuple):
    """The times of an image: since the first one, and when it was logged; s."""

    offset_s: float
    logged_s: float
    is_stamped: bool


class McapFile:
    """The images of an MCAP file by their own stamps, else by log time; an ImageFile.

    topic: None when the file has one topic of images only, and that is not of a run's mixtures.
    """

    def __init__(self, *, path: Path, topic: str | None = None) -> None:
        self._path = path
        self._topic = topic
        self._stream: IO[bytes] | None = None
        self._messages: Iterator[Message] = iter(())
        self._decode: Decode | None = None
        self._last: _Timed | None = None
        self._zero_s = 0.0

    @property
    def name(self) -> str:
        """Return the MCAP file's path, and the topic."""
        return f"{self._path}:{self._topic}" if self._topic else str(self._path)

    def open(self) -> None:
        """Open the MCAP file and find the topic. Raises SourceError."""
        try:
            if is_lfs_file(self._path):
                raise SourceError(f"{self._path}: {LFS_POINTER}")
            self._stream = self._path.open("rb")
            summary = make_reader(self._stream).get_summary()
            channels = _channels(self._stream, summary)
            topic, self._decode = self._choose_topic(_image_topics(channels))
            wanted = {channel.id for channel, _ in channels if channel.topic == topic}
            self._messages = _messages(self._stream, summary, wanted)
        except OSError as error:
            raise SourceError(f"{self._path}: {error.strerror}; check the path") from error
        except DAMAGED as error:
            raise self._broken_error(error) from error
        self._topic = topic

    def next(self) -> RecordedImage | None:
        """Return the MCAP file's next image. Raises SourceError for one that cannot be read."""
        try:
            message = next(self._messages, None)
        except DAMAGED as error:
            raise self._broken_error(error) from error
        if message is None or self._decode is None:
            return None
        try:
            image = self._decode(bytes(message.data))
        except BadMessageError as error:
            raise SourceError(f"{self.name}: message {message.sequence} {error}") from error
        offset_s = self._offset_after(image.stamp_s, message)
        return RecordedImage(offset_s, self._decode_image(image.data, message.sequence))

    def close(self) -> None:
        """Close the MCAP file."""
        if self._stream is not None:
            self._stream.close()

    def _offset_after(self, stamp_s: float | None, message: Message) -> float:
        """Return an image's time since the first one: by its stamp, else by its log time.

        A stamp of 0 is unset, or the first one of a simulation's time: between an image with and
        one without a stamp the log times tell. Raises SourceError where the sender's clock was set
        between two images: the later ones would not be due for years.
        """
        logged_s, is_stamped = message.log_time * 1e-9, stamp_s is not None
        t_s = logged_s if stamp_s is None else stamp_s
        last = self._last
        if last is None:
            self._zero_s = t_s
        elif last.is_stamped != is_stamped:
            self._zero_s = t_s - (last.offset_s + logged_s - last.logged_s)
        offset_s = t_s - self._zero_s
        if last is not None and is_stamped:
            why = clock_set_text(offset_s - last.offset_s, logged_s - last.logged_s)
            if why:
                raise SourceError(f"{self.name}: the stamp of message {message.sequence} {why}")
        self._last = _Timed(offset_s, logged_s, is_stamped)
        return offset_s

    def _decode_image(self, data: bytes, sequence: int) -> "np.ndarray[Any, np.dtype[np.uint8]]":
        try:
            return decode_camera_image(self.name, data)
        except ImageError as error:
            raise SourceError(
                f"{self.name}: the image of message {sequence} cannot be decoded: {error}"
            ) from error

    def _choose_topic(self, topics: dict[str, Decode]) -> tuple[str, Decode]:
        listed = ", ".join(sorted(topics)) or "none"
        if self._topic is None and len(topics) == 1 and not _is_mixture(listed):
            return next(iter(topics.items()))
        if self._topic is None:
            raise SourceError(
                f"{self._path}: choose one of its image topics by name (it has: {listed}); {_DRAWN}"
            )
        if self._topic not in topics:
            raise SourceError(
                f"{self._path}: has no images on topic {self._topic!r} (it has: {listed}); {_DRAWN}"
            )
        return self._topic, topics[self._topic]

    def _broken_error(self, error: Exception) -> SourceError:
        return SourceError(
            f"{self._path}: not an MCAP file, or a truncated one: {error or type(error).__name__}; "
            "`mcap recover` repairs a truncated one"
        )


def _messages(
    stream: IO[bytes], summary: Summary | None, channels: Collection[int]
) -> Iterator[Message]:
    """Yield the messages of channels in the order of their log times, chunk by chunk.

    Without an index of chunks (a recorder may write none) in the file's order. Raises what DAMAGED
    lists. Chunks overlap in time: a message is yielded once no later chunk can hold an earlier one.
    """
    if summary is None or not summary.chunk_indexes:
        for record in _records(stream):
            if isinstance(record, Message) and record.channel_id in channels:
                yield record
        return
    waiting: list[tuple[int, int, Message]] = []
    order = count()
    for first_ns, place in sorted(_places_of_messages(stream, summary)):
        while waiting and waiting[0][0] < first_ns:
            yield heappop(waiting)[2]
        for record in _records_at(stream, place):
            if isinstance(record, Message) and record.channel_id in channels:
                heappush(waiting, (record.log_time, next(order), record))
    while waiting:
        yield heappop(waiting)[2]


def _places_of_messages(stream: IO[bytes], summary: Summary) -> Iterator[tuple[int, int]]:
    """Yield the earliest log time and the place of each chunk, and of each message beside chunks.

    By the records themselves, for an index may lack some of them; those that it has must be there.
    """
    unseen = {index.chunk_start_offset for index in summary.chunk_indexes}
    opcode, place = 0, MAGIC_SIZE
    while opcode not in {Opcode.DATA_END, Opcode.FOOTER}:
        stream.seek(place)
        opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        if opcode in _TIMES:
            stream.seek(_TIMES[opcode], SEEK_CUR)
            yield int.from_bytes(stream.read(8), "little"), place
        if opcode == Opcode.CHUNK:
            unseen.discard(place)
        place += RECORD_HEAD.size + length
    if unseen:
        raise McapError(f"its index names a chunk at byte {min(unseen)}, where there is none")


def _records_at(stream: IO[bytes], place: int) -> Iterator[Schema | Channel | Message]:
    """Yield the records of the chunk, or the message, at a place."""
    stream.seek(place)
    opcode, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
    check_record_length(length)
    content = ReadDataStream(BytesIO(stream.read(length)))
    if opcode == Opcode.CHUNK:
        yield from chunk_records(Chunk.read(content))
    else:
        yield Message.read(content, length)


def _records(stream: IO[bytes]) -> Iterator[Schema | Channel | Message]:
    stream.seek(0)
    reader = StreamReader(stream, emit_chunks=True, record_size_limit=MAX_CHUNK_BYTES)
    for record in reader.records:
        if isinstance(record, Chunk):
            yield from chunk_records(record)
        elif isinstance(record, Schema | Channel | Message):
            yield record


def _channels(stream: IO[bytes], summary: Summary | None) -> list[tuple[Channel, Schema | None]]:
    """Return the file's channels, each with its schema; from all records unless a summary has all.

    A recorder may repeat only some of them there, or only the channels.
    """
    if summary is not None and _repeats_all(summary):
        schemas, channels = dict(summary.schemas), list(summary.channels.values())
    else:
        records = list(_records_but_messages(stream))
        schemas = {record.id: record for record in records if isinstance(record, Schema)}
        channels = list({one.id: one for one in records if isinstance(one, Channel)}.values())
    return [(channel, schemas.get(channel.schema_id)) for channel in channels]


def _repeats_all(summary: Summary) -> bool:
    """Return whether a summary has all channels, as far as it tells, and all of their schemas."""
    stated = summary.statistics
    wanted = {channel.schema_id for channel in summary.channels.values()} - {_NO_SCHEMA}
    return (
        bool(summary.channels)
        and (stated is None or stated.channel_count == len(summary.channels))
        and wanted <= summary.schemas.keys()
    )


def _image_topics(channels: Iterable[tuple[Channel, Schema | None]]) -> dict[str, Decode]:
    """Return the topics of images with their decoders."""
    found: dict[str, Decode] = {}
    for channel, schema in channels:
        decode = decoder_for(schema.name, channel.message_encoding) if schema else None
        if decode is not None:
            found[channel.topic] = decode
    return found


def _records_but_messages(stream: IO[bytes]) -> Iterator[Schema | Channel]:
    return (record for record in _records(stream) if not isinstance(record, Message))
