"""Picks the perceived readings at given times, and all provenances, in one pass over run.mcap.

Only provenances and the few shown readings are decoded, of some ten thousand messages. A truncated
or damaged file is read up to the damage.
"""

import bisect
import json
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mcap.records import Channel, Message, Metadata

from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.recording.mcap.mcap_chunks import RecordStream
from wil_campaign.orchestrator.recording.mcap.mcap_decode import is_reading_channel

_RECENT = 12
"""Readings of each stream that are kept until the mixture made from them arrives."""
_PERCEIVED = {"sim": "twin", "real": "real"}
"""Source of the readings that the autonomy perceives, by mode; "mixed" in all others."""


@dataclass(frozen=True, slots=True)
class RecordedSight:
    """A perceived reading, undecoded. beside: the readings it was mixed from."""

    wanted_s: float
    perceived: Message
    beside: tuple[Message, ...]
    provenance: Mapping[str, Any]


@dataclass(slots=True)
class RecordedSights:
    """Readings of a recording. sights: by sensor. provenances: by sensor, with run-clock times.

    facts: of the file's beginning. epoch_ns: UTC of the run clock's zero, nanoseconds.
    """

    sights: dict[str, list[RecordedSight]] = field(default_factory=dict)
    provenances: dict[str, list[tuple[float, Mapping[str, Any]]]] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)
    epoch_ns: int = 0
    problems: list[str] = field(default_factory=list)


def read_facts(path: Path) -> Mapping[str, str]:
    """Return the facts at a recording's beginning; empty without them."""
    try:
        for record in RecordStream(path):
            if not isinstance(record, Metadata):
                break
            if record.name == "wil.recording":
                return dict(record.metadata)
    except (OSError, RecordingError):
        pass
    return {}


def read_sights(path: Path, *, mode: str, wanted_s: Iterable[float]) -> RecordedSights:
    """Return the last reading perceived before each wanted time, and all provenances."""
    found = RecordedSights()
    facts = read_facts(path)
    found.facts = facts
    found.epoch_ns = int(facts["epoch_ns"]) if facts.get("epoch_ns", "").isdecimal() else 0
    picker = _Picker(_PERCEIVED.get(mode, "mixed"), sorted(wanted_s), found)
    try:
        stream = RecordStream(path)
        for record in stream:
            if isinstance(record, Channel):
                picker.channels[record.id] = record
            elif isinstance(record, Message):
                picker.receive(record)
        if stream.end is not None and not stream.end.whole:
            found.problems.append(f"{path.name} is incomplete: {stream.end.reason}")
    except RecordingError as error:
        found.problems.append(str(error).replace(str(path), path.name))
    except OSError as error:
        found.problems.append(f"{path.name} cannot be read: {error.strerror or error}")
    picker.finish()
    return found


@dataclass(frozen=True, slots=True)
class _Perceived:
    """A perceived reading with what belongs to it. provenance: None until it was read."""

    message: Message
    beside: tuple[Message, ...]
    provenance: Mapping[str, Any] | None = None


class _Picker:
    """Takes messages in order and picks the last ones before each wanted time."""

    def __init__(self, perceived: str, wanted_s: Sequence[float], sights: RecordedSights) -> None:
        self.channels: dict[int, Channel] = {}
        self._perceived = perceived
        self._wanted_s = wanted_s
        self._sights = sights
        self._last: dict[str, _Perceived] = {}
        self._recent: dict[tuple[str, str], deque[Message]] = {}
        self._picked: dict[str, int] = {}

    def receive(self, message: Message) -> None:
        channel = self.channels.get(message.channel_id)
        if channel is None:
            return
        part, sensor = channel.metadata.get("part"), channel.metadata.get("sensor", "")
        if part == "provenance":
            self._receive_provenance(sensor, message)
        elif is_reading_channel(channel):
            source = channel.metadata.get("source", "")
            if source == self._perceived:
                self._pick(sensor, self._seconds(message))
                self._last[sensor] = _Perceived(message, self._inputs(sensor, {}))
            self._recent.setdefault((source, sensor), deque(maxlen=_RECENT)).append(message)

    def finish(self) -> None:
        """Pick the last readings for times after the end of the file."""
        for sensor in list(self._last):
            self._pick(sensor, float("inf"))

    def _seconds(self, message: Message) -> float:
        return (message.log_time - self._sights.epoch_ns) / 1e9

    def _receive_provenance(self, sensor: str, message: Message) -> None:
        try:
            fields = json.loads(message.data)
        except (ValueError, RecursionError):
            return
        if not isinstance(fields, dict):
            return
        rows = self._sights.provenances.setdefault(sensor, [])
        rows.append((self._seconds(message), fields))
        last = self._last.get(sensor)
        # The first after a mixture is its own; others say why there was none.
        if last is not None and last.provenance is None:
            self._last[sensor] = replace(
                last, provenance=fields, beside=self._inputs(sensor, fields)
            )

    def _pick(self, sensor: str, now_s: float) -> None:
        """Pick the last reading for each wanted time that has passed."""
        last = self._last.get(sensor)
        first = self._picked.get(sensor, 0)
        due = bisect.bisect_left(self._wanted_s, now_s)
        self._picked[sensor] = max(first, due)
        if last is None:
            return
        for wanted_s in self._wanted_s[first:due]:
            sight = RecordedSight(wanted_s, last.message, last.beside, last.provenance or {})
            self._sights.sights.setdefault(sensor, []).append(sight)

    def _inputs(self, sensor: str, provenance: Mapping[str, Any]) -> tuple[Message, ...]:
        """Return the readings a mixture was made from; a name with receivers has its sensor's."""
        return tuple(self._recent_inputs(sensor, provenance)) if self._perceived == "mixed" else ()

    def _recent_inputs(self, sensor: str, provenance: Mapping[str, Any]) -> Iterator[Message]:
        for source in ("real", "twin"):
            recent = self._recent.get((source, sensor)) or self._recent.get(
                (source, sensor.split(" ", maxsplit=1)[0])
            )
            seq = provenance.get(f"given_{source}_seq")
            matching = [message for message in recent or () if message.sequence == seq]
            yield from (matching or list(recent or ())[-1:])[-1:]
