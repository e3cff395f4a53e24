"""Writes run.mcap, the readings of both worlds and the mixed ones, in a thread of its own.

The flight queues readings and continues; the thread encodes and writes them. When it cannot keep
up, under a wall clock new readings are dropped and counted; under a virtual clock the flight waits,
so that equal runs give equal bytes. A full disk, or an image that cannot be encoded, never affects
the flight: it is counted in the report.
"""

import threading
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from itertools import count
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Self

import numpy as np

from wil_campaign.foundation.background_file import patience
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.recording.mcap.mcap_encode import (
    LOG,
    LogLevel,
    McapChannel,
    McapEncoder,
    McapMessage,
)
from wil_campaign.orchestrator.recording.mcap.mcap_file import ChunkedFile
from wil_campaign.orchestrator.recording.mcap.mcap_schemas import schema_of_class
from wil_campaign.orchestrator.recording.mcap.mcap_settings import RecordingSettings
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.messages import plain_json_document
from wil_campaign.worlds.camera import CameraMount

SCHEMA = "wil/recording/1"

_SMALL_BYTES = 1024
"""The size of a reading without arrays, or of a note, in the backlog."""
_POLL_S = 0.05
_IDLE_FLUSH_S = 0.5
"""Wall time after which a chunk is written although no message came to end it."""


@dataclass(frozen=True, slots=True)
class TopicLoss:
    """How many messages of a topic are missing. offered: how many were to be recorded."""

    topic: str
    offered: int
    lost: int


@dataclass(frozen=True, slots=True)
class RecordingReport:
    """The report of a written recording: counts, size, and faults.

    written: readings and notes in the file. dropped: by topic, messages for which the backlog was
    full. failed: messages that could not be encoded, or came after the file had failed. fault: why
    it failed, in words; None if it did not. errors: internal errors, not those of the disk. losses:
    the topics with missing messages, for any reason. unfinished: whether the end gave up on a disk
    that took nothing; what waits for it counts as neither failed nor lost.
    """

    written: int
    dropped: tuple[tuple[str, int], ...]
    failed: int
    size_bytes: int
    fault: str | None
    errors: tuple[BaseException, ...] = ()
    losses: tuple[TopicLoss, ...] = ()
    unfinished: bool = False

    @property
    def complete(self) -> bool:
        """Return whether all messages are in the file."""
        return not self.dropped and not self.failed and self.fault is None


@dataclass(frozen=True, slots=True)
class _Item:
    """An item that waits for the MCAP writer's thread."""

    topic: str
    t_s: float
    size_bytes: int
    encode: Callable[[], list[McapMessage]]
    schema: bytes | None = None


class McapRecorder:
    """Writes one run's recording as MCAP; a context manager, used by one thread.

    epoch_s: UTC at which the run clock was zero. facts: metadata for the file's first record,
    before all readings. mounts: of the cameras, as of the Encoder. Leaving the context closes the
    file. Raises OSError when the file cannot be created.
    """

    def __init__(
        self,
        *,
        path: Path,
        epoch_s: float,
        clock: Clock,
        settings: RecordingSettings | None = None,
        facts: Mapping[str, str] | None = None,
        mounts: Mapping[str, CameraMount] | None = None,
    ) -> None:
        self._path = path
        self._facts = dict(facts or {})
        self._waits = clock == "virtual"
        self._settings = settings or RecordingSettings()
        self._encoder = McapEncoder(epoch_s=epoch_s, settings=self._settings, mounts=mounts)
        self._incoming: SimpleQueue[_Item | None] = SimpleQueue()
        self._done: SimpleQueue[int] = SimpleQueue()
        self._backlog_bytes = 0
        self._backlog_items = 0
        self._offered: Counter[str] = Counter()
        self._dropped: Counter[str] = Counter()
        self._unwritten: Counter[str] = Counter()
        self._schemas: dict[type, bytes] = {}
        self._report: RecordingReport | None = None
        self._written = 0
        self._fault: str | None = None
        self._errors: list[BaseException] = []

    @property
    def epoch_ns(self) -> int:
        """Return UTC of the run clock's zero, nanoseconds since 1970."""
        return self._encoder.stamps.epoch_ns

    def __enter__(self) -> Self:
        patience.begin()
        self._file = ChunkedFile(
            path=self._path,
            compression=self._settings.compression,
            chunk_bytes=self._settings.chunk_bytes,
            chunk_ns=round(self._settings.chunk_s * 1e9),
        )
        # a daemon: a process that ends without closing must not wait for it
        threading.Thread(target=self._work, name=f"recorder {self._path.name}", daemon=True).start()
        self._enqueue(_Item("/tf", 0.0, _SMALL_BYTES, self._encoder.fixed_transforms))
        return self

    def reading(self, sensor: str, reading: Reading) -> None:
        """Write a sensor's reading, as delivered, to the MCAP file."""
        encode = self._encoder.encode
        topic = f"/{reading.source}/{sensor}"
        size_bytes = _size_of(reading)
        item = _Item(topic, reading.arrived_s, size_bytes, lambda: encode(sensor, reading))
        self._enqueue(item)

    def mixed(self, sensor: str, reading: Reading | None, provenance: Any, *, now_s: float) -> None:
        """Write a mixed reading, or that there was none, with its provenance.

        provenance: a frozen dataclass of numbers, texts, tuples and dataclasses; it is written
        field by field. now_s: when it was mixed.
        """
        if reading is not None:
            self.reading(sensor, reading)
        self._write_figures(sensor, "provenance", provenance, now_s)

    def visibility(self, sensor: str, visibility: Any, *, now_s: float) -> None:
        """Write how a mixture shows the virtual objects to the MCAP file."""
        self._write_figures(sensor, "visibility", visibility, now_s)

    def _write_figures(self, sensor: str, part: str, figures: Any, now_s: float) -> None:
        schema, kind = f"wil.{part.capitalize()}", type(figures)
        if kind not in self._schemas:
            self._schemas[kind] = schema_of_class(schema, kind)
        channel = McapChannel(f"/mixed/{sensor}/{part}", schema, "mixed", sensor, part)

        def encode() -> list[McapMessage]:
            fields = plain_json_document(figures)
            return [self._encoder.message(channel, fields, t_s=now_s, arrived_s=now_s)]

        self._enqueue(_Item(channel.topic, now_s, _SMALL_BYTES, encode, self._schemas[kind]))

    def event(self, t_s: float, level: LogLevel, name: str, message: str) -> None:
        """Write a line of the run's log to the MCAP file: a stage, a contact, a warning."""
        encode = self._encoder.event
        item = _Item(LOG.topic, t_s, _SMALL_BYTES, lambda: [encode(t_s, level, name, message)])
        self._enqueue(item)

    def close(self) -> RecordingReport:
        """Wait until all is written, close the MCAP file, and return the report.

        Gives up on a disk that takes nothing; the thread goes on, should the disk come back.
        """
        if self._report is None:
            self._incoming.put(None)
            size_bytes, stalled = 0, None
            try:
                while self._backlog_items:
                    self._collect(self._await_done())
                size_bytes = self._await_done()
            except Empty:
                stalled = "the disk takes nothing"
                if self._backlog_items:
                    stalled += f", {self._backlog_items} messages wait for it"
            dropped = tuple(sorted(self._dropped.items()))
            self._report = RecordingReport(
                self._written,
                dropped,
                self._unwritten.total(),
                size_bytes,
                self._fault or stalled,
                tuple(self._errors),
                self._losses(),
                unfinished=stalled is not None,
            )
        return self._report

    def _await_done(self) -> int:
        """Return the size of the next message that is written. Raises Empty: the disk is dead."""
        for poll in count():
            try:
                size_bytes = self._done.get(timeout=_POLL_S)
            except Empty:
                if not patience.waits_on(poll):
                    raise
            else:
                patience.renew()
                break
        return size_bytes

    def _losses(self) -> tuple[TopicLoss, ...]:
        # A copy: after an end that gave up, the thread still counts.
        lost = self._dropped + self._unwritten.copy()
        return tuple(TopicLoss(topic, self._offered[topic], lost[topic]) for topic in sorted(lost))

    def __exit__(self, *_: object) -> None:
        self.close()

    def _enqueue(self, item: _Item) -> None:
        """Queue an item for the writer's thread; only the caller's side counts the backlog."""
        if self._report is not None:
            return
        self._offered[item.topic] += 1
        while not self._done.empty():
            self._collect(self._done.get_nowait())
        limit = self._settings.backlog_bytes
        while self._backlog_items and self._backlog_bytes + item.size_bytes > limit:
            if not self._waits:
                self._dropped[item.topic] += 1
                return
            self._collect(self._done.get())
        self._backlog_bytes += item.size_bytes
        self._backlog_items += 1
        self._incoming.put(item)

    def _collect(self, size_bytes: int) -> None:
        self._backlog_bytes -= size_bytes
        self._backlog_items -= 1

    def _work(self) -> None:
        """Encode and write items until the end (runs in the writer's thread)."""
        self._run_guarded(
            lambda: self._file.start(
                {
                    **self._facts,
                    "schema": SCHEMA,
                    "epoch_ns": str(self._encoder.stamps.epoch_ns),
                }
            )
        )
        while (item := self._next()) is not None:
            if self._fault is None:
                self._write(item)
            else:
                self._unwritten[item.topic] += 1
            self._done.put(item.size_bytes)
        if self._fault is None:
            self._run_guarded(lambda: self._file.finish(self._counts()))
        size_bytes = 0
        try:
            size_bytes = self._file.close()
        except OSError as error:  # a network folder reports a lost write here
            self._fault = self._fault or f"{self._path.name}: {error.strerror or error}"
        except Exception as error:  # noqa: BLE001  # `close` waits for this thread
            self._errors.append(error)
        self._done.put(size_bytes)

    def _next(self) -> _Item | None:
        """Return the writer's next item; flush the file when idle."""
        if self._waits:
            return self._incoming.get()
        while True:
            try:
                return self._incoming.get(timeout=_IDLE_FLUSH_S)
            except Empty:
                if self._fault is None:
                    self._run_guarded(self._file.flush)

    def _write(self, item: _Item) -> None:
        try:
            messages = item.encode()
        except Exception as error:  # noqa: BLE001  # a bad reading may raise anything
            self._unwritten[item.topic] += 1
            self._errors.append(error)
            self._write_missing(item.t_s, f"{type(error).__name__}: {error}")
            return
        written = self._run_guarded(lambda: self._append(messages, item.schema))
        self._written += written
        self._unwritten[item.topic] += not written

    def _append(self, messages: list[McapMessage], schema: bytes | None) -> None:
        for message in messages:
            self._file.write(message, schema)

    def _write_missing(self, t_s: float, why: str) -> None:
        message = self._encoder.event(t_s, "error", "recorder", why)
        self._run_guarded(lambda: self._append([message], None))

    def _run_guarded(self, write: Callable[[], None]) -> bool:
        """Write; a disk failure ends the recording, not the flight."""
        try:
            write()
        except OSError as error:
            self._fault = f"{self._path.name}: {error.strerror or error}; recording ended"
        except Exception as error:  # noqa: BLE001  # a thread that dies would stall a virtual run
            self._errors.append(error)
            self._fault = f"{self._path.name}: {type(error).__name__}: {error}; recording ended"
        return self._fault is None

    def _counts(self) -> dict[str, str]:
        counts = {"written": str(self._written), "failed": str(self._unwritten.total())}
        return counts | {f"dropped {topic}": str(n) for topic, n in sorted(self._dropped.items())}


def _size_of(reading: Any) -> int:
    """Return how much memory a reading holds while it waits for the writer."""
    arrays = (getattr(reading, name) for name in _fields_of(reading.__class__))
    return _SMALL_BYTES + sum(each.nbytes for each in arrays if isinstance(each, np.ndarray))


@cache
def _fields_of(kind: type[Any]) -> tuple[str, ...]:
    """Return the names of a reading's fields: looked up once."""
    return tuple(field.name for field in fields(kind))
