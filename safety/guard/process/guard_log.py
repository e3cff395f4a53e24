"""guard.jsonl: what the guard did, one JSON object a line, whatever becomes of the others."""

import json
from pathlib import Path


class GuardLog:
    """The guard's log file; each line is the kernel's at once, so that kill -9 loses none.

    A disk that takes no more is no reason to fall: `trouble` says what happened, the lines after
    it are lost.
    """

    def __init__(self, *, path: Path) -> None:
        self.trouble = ""
        self._file = path.open("a", encoding="utf-8")

    def write(self, t_s: float, event: str, **details: str | float | bool | None) -> None:
        """Append one event to the guard's log."""
        line = {"t_s": round(t_s, 6), "event": event, **details}
        try:
            self._file.write(json.dumps(line, ensure_ascii=False) + "\n")
            self._file.flush()
        except (OSError, ValueError) as error:
            self.trouble = str(error)

    def close(self) -> None:
        """Close the guard's log."""
        try:
            self._file.close()
        except OSError as error:
            self.trouble = str(error)
