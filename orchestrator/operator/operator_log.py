"""operator.jsonl: every operator command with its time, its operator and its result."""

import json
import time
from collections import deque
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock, Thread

from wil_campaign.safety.guard.core.operator_command import OperatorCommand

_WRITTEN_WITHIN_S = 0.05
_CLOSED_WITHIN_S = 5.0
_MOST_LINES = 10_000


class OperatorLog:
    """The operator log: one line for each command, executed or refused.

    A full disk must not prevent an abort: the line is lost then. A stalled one must not delay the
    next command: a thread writes the lines while there are any. Used by any thread.
    """

    def __init__(self, *, path: Path) -> None:
        self._path = path
        self._lock = Lock()
        self._lines: deque[bytes] = deque(maxlen=_MOST_LINES)
        self._writer: Thread | None = None
        self._unwritten_lines = 0

    def write(self, command: OperatorCommand, *, ok: bool, text: str) -> None:
        """Append a command and its reply to the operator log."""
        self._append(who=command.who, command=command.kind, ok=ok, text=text)

    def refused(self, text: str, *, who: str = "") -> None:
        """Append a refused message, which was invalid or unauthorised, to the operator log."""
        self._append(who=who, command="", ok=False, text=text)

    def note(self, text: str) -> None:
        """Append an event of an operator channel to the operator log."""
        self._append(who="", command="", ok=True, text=text)

    def close(self) -> int:
        """Wait for the lines that a slow disk has not taken yet; return how many are lost.

        Also counts those that the disk refused, and those for which there was no room.
        """
        with self._lock:
            writer = self._writer
        if writer is not None:
            writer.join(_CLOSED_WITHIN_S)
        with self._lock:
            return self._unwritten_lines + len(self._lines) + (self._writer is not None)

    def _append(self, **fields: str | bool) -> None:
        stamp = datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"utc": stamp, **fields}, ensure_ascii=False)
        with self._lock:
            self._unwritten_lines += len(self._lines) == _MOST_LINES
            self._lines.append((line + "\n").encode("utf-8", "backslashreplace"))
            if self._writer is not None:
                return  # the disk is slow, and each line would wait
            # A daemon: a process that ends must not wait for a disk.
            self._writer = writer = Thread(target=self._write_lines, name="operator", daemon=True)
            try:
                writer.start()
            except RuntimeError:  # the system starts none: the next line's writer writes this one
                self._writer = None
                return
        writer.join(_WRITTEN_WITHIN_S)

    def _write_lines(self) -> None:
        while True:
            with self._lock:
                if not self._lines:
                    self._writer = None
                    return
                line = self._lines.popleft()
            try:
                with self._path.open("ab") as stream:
                    stream.write(line)
            except OSError:
                with self._lock:
                    self._unwritten_lines += 1
