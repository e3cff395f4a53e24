"""log.jsonl: what happened in a run, one JSON object a line, in order."""

import json
import os
from pathlib import Path
from typing import Self

Detail = str | float | bool | None


class RunLog:
    """A run's log (log.jsonl): events with their run-clock time; a context manager."""

    def __init__(self, *, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Self:
        # Appended to, for an exception of ours is written without waiting for this to be open.
        # Half of a surrogate pair, as a vehicle or an error may say it, is written as JSON escapes.
        self._file = self._path.open("a", encoding="utf-8", errors="backslashreplace")
        return self

    @property
    def is_removed(self) -> bool:
        """Return whether the file was removed: what is written is lost, and nothing says so."""
        return not self._file.closed and os.fstat(self._file.fileno()).st_nlink == 0

    def write(self, t_s: float, event: str, **details: Detail) -> None:
        """Append an event to the run's log, flushed on return. Raises OSError.

        What is told when the log is closed already, as the loop shuts down, has no line.
        """
        if self._file.closed:
            return
        self._file.write(_line(t_s, event, details))
        self._file.flush()

    def __exit__(self, *_: object) -> None:
        self._file.close()


def append_event(path: Path, t_s: float, event: str, **details: Detail) -> None:
    """Append an event to a run's log, whoever else has it open. Raises OSError."""
    with path.open("a", encoding="utf-8", errors="backslashreplace") as file:
        file.write(_line(t_s, event, details))


def _line(t_s: float, event: str, details: dict[str, Detail]) -> str:
    """Return an event as a line of a run's log."""
    line = {"t_s": round(t_s, 6), "event": event, **details}
    return json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n"
