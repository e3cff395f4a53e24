"""log.jsonl: the events of a run, one JSON object per line, in order."""

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from wil_campaign.foundation.background_file import BackgroundFile
from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.safety.model.verdict import DecisiveEvent, DecisiveKind

_WRITTEN_WITHIN_S = 0.05
"""How long an event waits for its line, so that a process that dies right after it loses none."""

_KINDS: dict[str, DecisiveKind] = {
    "ERROR": "ERROR",
    "INVALID": "INVALID",
    "FAIL": "FAIL",
    "ABORTED": "ABORTED",
}

Detail = str | float | bool | None


class RunLog:
    """A run's log (log.jsonl): events with their run-clock time; a context manager."""

    def __init__(self, *, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Self:
        # Opened to append: internal exceptions are written also before this is opened.
        self._file = BackgroundFile(self._path, append=True)
        return self

    @property
    def is_removed(self) -> bool:
        """Return whether the file was removed, as of its last event, or of its end."""
        return self._file.is_removed

    def write(self, t_s: float, event: str, **details: Detail) -> None:
        """Append an event to the run's log, written on return by any but a stalled disk.

        Raises OSError. An event after the log was closed, as the loop shuts down, is ignored.
        """
        if self._file.closed:
            return
        self._file.write(_line(t_s, event, details))
        self._file.flush(_WRITTEN_WITHIN_S)

    def __exit__(self, *_: object) -> None:
        self._file.close()


def append_event(path: Path, t_s: float, event: str, **details: Detail) -> None:
    """Append an event to a run's log, which may be open elsewhere. Raises OSError."""
    with path.open("ab") as file:
        file.write(_line(t_s, event, details))


def _line(t_s: float, event: str, details: dict[str, Detail]) -> bytes:
    """Return an event as a line of a run's log.

    A lone surrogate, as in a vehicle's or an error's text, is a JSON escape in it.
    """
    line = {"t_s": round(t_s, 6), "event": event, **details}
    text = json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n"
    return text.encode("utf-8", "backslashreplace")


@dataclass(frozen=True, slots=True)
class CutLog:
    """The log of a run that has no result: its stages, its decisive events, its last time."""

    stages: frozenset[str] = frozenset()
    decisive: tuple[DecisiveEvent, ...] = ()
    end_s: float = 0.0


def read_cut_log(path: Path) -> CutLog:
    """Return what a run logged before its process was lost; damaged lines are left out."""
    stages: set[str] = set()
    decisive: list[DecisiveEvent] = []
    end_s = 0.0
    with suppress(OSError), path.open("rb") as lines:
        for text in lines:
            with suppress(ValueError, KeyError, TypeError):
                line = loads_limited_json(text)
                end_s = max(end_s, float(line["t_s"]))
                if line["event"] == "stage":
                    stages.add(line["stage"])
                if line["event"] == "decisive":
                    decisive.append(decisive_event(line))
    return CutLog(frozenset(stages), tuple(decisive), end_s)


def decisive_event(line: Mapping[str, Any]) -> DecisiveEvent:
    """Return the decisive event of a line of a run's log. Raises KeyError."""
    return DecisiveEvent(
        line["t_s"],
        _KINDS[line["kind"]],
        line["reason"],
        line.get("source", ""),
        line.get("note", ""),
        line.get("trace", ""),
    )
