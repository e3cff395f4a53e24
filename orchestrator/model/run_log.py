"""log.jsonl: the events of a run, one JSON object per line, in order."""

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
        # Opened to append: internal exceptions are written also before this is opened. A lone
        # surrogate, as in a vehicle's or an error's text, is written as a JSON escape.
        self._file = self._path.open("a", encoding="utf-8", errors="backslashreplace")
        return self

    @property
    def is_removed(self) -> bool:
        """Return whether the file was removed: writing to it is lost without an error."""
        return not self._file.closed and os.fstat(self._file.fileno()).st_nlink == 0

    def write(self, t_s: float, event: str, **details: Detail) -> None:
        """Append an event to the run's log, flushed on return. Raises OSError.

        An event after the log was closed, as the loop shuts down, is ignored.
        """
        if self._file.closed:
            return
        self._file.write(_line(t_s, event, details))
        self._file.flush()

    def __exit__(self, *_: object) -> None:
        self._file.close()


def append_event(path: Path, t_s: float, event: str, **details: Detail) -> None:
    """Append an event to a run's log, which may be open elsewhere. Raises OSError."""
    with path.open("a", encoding="utf-8", errors="backslashreplace") as file:
        file.write(_line(t_s, event, details))


def _line(t_s: float, event: str, details: dict[str, Detail]) -> str:
    """Return an event as a line of a run's log."""
    line = {"t_s": round(t_s, 6), "event": event, **details}
    return json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n"
