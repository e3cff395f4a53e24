"""guard.jsonl: what the guard did, one JSON object a line, whatever becomes of the others."""

import json
from pathlib import Path

from vehicles.background_file import BackgroundFile


class GuardLog:
    """The guard's log file; each line is given to the disk at once, and never waited for.

    A disk that takes no more is no reason to fall: `trouble` says what happened, the lines after
    it are lost.
    """

    def __init__(self, *, path: Path) -> None:
        self.trouble = ""
        self._file = BackgroundFile(path, append=True, waits=False)

    def write(self, t_s: float, event: str, **details: str | float | bool | None) -> None:
        """Append one event to the guard's log."""
        line = {"t_s": round(t_s, 6), "event": event, **details}
        try:
            text = json.dumps(line, ensure_ascii=False) + "\n"
            self._file.write(text.encode("utf-8", "backslashreplace"))
            self._file.flush()
        except (OSError, ValueError) as error:
            self.trouble = str(error)

    def close(self) -> None:
        """Close the guard's log."""
        try:
            self._file.close()
        except OSError as error:
            self.trouble = str(error)
