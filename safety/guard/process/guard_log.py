"""guard.jsonl: what the guard did, one JSON object a line, whatever becomes of the others."""

import json
from pathlib import Path

from wil_campaign.foundation.background_file import BackgroundFile
from wil_campaign.foundation.processes.linux import raise_process_priority


def guard_file(path: Path, *, append: bool = False) -> BackgroundFile:
    """Return a file of the guard: nothing waits for it, and its thread has the guard's priority.

    Both use one interpreter lock: a thread of lower priority could keep the guard from it.
    """
    return BackgroundFile(path, append=append, waits=False, begin=raise_process_priority)


class GuardLog:
    """The guard's log file; each line is given to the disk at once, and never waited for.

    A disk that takes no more is no reason to fall: `trouble` says what happened, the lines after
    it are lost.
    """

    def __init__(self, *, path: Path) -> None:
        self.trouble = ""
        self._file = guard_file(path, append=True)

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
