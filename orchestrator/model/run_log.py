"""log.jsonl: the events of a run, one JSON object per line, in order."""

import json
from pathlib import Path
from typing import Self

from vehicles.background_file import BackgroundFile

_WRITTEN_WITHIN_S = 0.05
"""How long an event waits for its line, so that a process that dies right after it loses none."""

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
