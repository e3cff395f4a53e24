"""log.jsonl: what happened in a run, one JSON object a line, in order."""

import json
from pathlib import Path
from types import TracebackType
from typing import Self


class RunLog:
    """Appends events with their time on the run clock; a context manager."""

    def __init__(self, *, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Self:
        # Half of a surrogate pair, as a vehicle or an error may say it, is written as JSON escapes.
        self._file = self._path.open("x", encoding="utf-8", errors="backslashreplace")
        return self

    def write(self, t_s: float, event: str, **details: str | float | bool | None) -> None:
        """Append one event; it is on its way to the disk when this returns. Raises OSError.

        What is told when the log is closed already, as the loop shuts down, has no line.
        """
        if self._file.closed:
            return
        line = {"t_s": round(t_s, 6), "event": event, **details}
        self._file.write(json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n")
        self._file.flush()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()
