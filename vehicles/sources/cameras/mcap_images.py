"""The compressed images of one topic of an MCAP file, as a recording."""

from collections.abc import Iterator
from heapq import heappop, heappush
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.summary import Summary

from vehicles.sources.camera_source import SourceError
from vehicles.sources.cameras.compressed_image import Decode, decoder_for
from vehicles.sources.cameras.frame_stamps import check_image
from vehicles.sources.cameras.recorded_camera import RecordedImage
from vehicles.sources.mcap_limits import DAMAGED, RECORD_HEAD, check_length, chunk_records
from vehicles.sources.messagepack import BadMessageError
from worlds.files.images import ImageError, decode_image


class McapFile:
    """The images of an MCAP file by their own stamps, else by log time; an ImageFile.

    topic: None when the file has one topic of images only.
    """

    def __init__(self, *, path: Path, topic: str | None = None) -> None:
        self._path = path
        self._topic = topic
        self._stream: IO[bytes] | None = None
        self._messages: Iterator[Message] = iter(())
        self._decode: Decode | None = None
        self._first_s: float | None = None

    @property
    def name(self) -> str:
        """Return the MCAP file's path, and the topic."""
        return f"{self._path}:{self._topic}" if self._topic else str(self._path)

    def open(self) -> None:
        """Open the MCAP file and find the topic. Raises SourceError."""
        try:
            self._stream = self._path.open("rb")
            reader = make_reader(self._stream)
            topic, self._decode = self._choose_topic(_image_topics(reader))
            self._messages = _messages(self._stream, reader.get_summary(), topic)
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
        t_s = image.stamp_s if image.stamp_s is not None else message.log_time * 1e-9
        if self._first_s is None:
            self._first_s = t_s
        return RecordedImage(t_s - self._first_s, self._decode_image(image.data, message.sequence))

    def close(self) -> None:
        """Close the MCAP file."""
        if self._stream is not None:
            self._stream.close()

    def _decode_image(self, data: bytes, sequence: int) -> "np.ndarray[Any, np.dtype[np.uint8]]":
        try:
            return check_image(self.name, decode_image(data))
        except ImageError as error:
            raise SourceError(
                f"{self.name}: the image of message {sequence} cannot be decoded: {error}"
            ) from error

    def _choose_topic(self, topics: dict[str, Decode]) -> tuple[str, Decode]:
        listed = ", ".join(sorted(topics)) or "none"
        if self._topic is None and len(topics) == 1:
            return next(iter(topics.items()))
        if self._topic is None:
            raise SourceError(
                f"{self._path}: choose one of its image topics by name (it has: {listed})"
            )
        if self._topic not in topics:
            raise SourceError(
                f"{self._path}: has no images on topic {self._topic!r} (it has: {listed})"
            )
        return self._topic, topics[self._topic]

    def _broken_error(self, error: Exception) -> SourceError:
        return SourceError(
            f"{self._path}: not an MCAP file, or a truncated one: {error or type(error).__name__}; "
            "`mcap recover` repairs a truncated one"
        )


def _messages(stream: IO[bytes], summary: Summary | None, topic: str) -> Iterator[Message]:
    """Yield the messages of a topic in the order of their log times, chunk by chunk.

    Raises what DAMAGED lists. Chunks overlap in time: a message is yielded once no later chunk can
    hold an earlier one.
    """
    if summary is None or not summary.chunk_indexes:
        raise McapError("it has no index of chunks")
    channels = {one.id for one in summary.channels.values() if one.topic == topic}
    chunks = sorted(summary.chunk_indexes, key=lambda one: one.message_start_time)
    waiting: list[tuple[int, int, Message]] = []
    order = count()
    for index in chunks:
        while waiting and waiting[0][0] < index.message_start_time:
            yield heappop(waiting)[2]
        stream.seek(index.chunk_start_offset)
        _, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        check_length(length)
        for record in chunk_records(Chunk.read(ReadDataStream(BytesIO(stream.read(length))))):
            if isinstance(record, Message) and record.channel_id in channels:
                heappush(waiting, (record.log_time, next(order), record))
    while waiting:
        yield heappop(waiting)[2]


def _image_topics(reader: Any) -> dict[str, Decode]:
    summary = reader.get_summary()
    found: dict[str, Decode] = {}
    for channel in summary.channels.values() if summary is not None else ():
        schema = summary.schemas.get(channel.schema_id)
        decode = decoder_for(schema.name, channel.message_encoding) if schema else None
        if decode is not None:
            found[channel.topic] = decode
    return found
