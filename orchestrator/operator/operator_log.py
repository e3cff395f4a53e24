"""operator.jsonl: every operator command with its time, its operator and its result."""

import contextlib
import json
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from datetime import UTC, datetime
from pathlib import Path

from safety.guard.core.operator_command import OperatorCommand

_WRITTEN_WITHIN_S = 0.05


class OperatorLog:
    """The operator log: one line for each command, executed or refused.

    A full disk must not prevent an abort: the line is lost then. A stalled one must not delay the
    next command: a thread of its own writes the lines.
    """

    def __init__(self, *, path: Path) -> None:
        self._path = path
        self._last: Future[None] | None = None
        self._writer = ThreadPoolExecutor(1, thread_name_prefix=f"writer {path.name}")

    def write(self, command: OperatorCommand, *, ok: bool, text: str) -> None:
        """Append a command and its reply to the operator log."""
        self._append(who=command.who, command=command.kind, ok=ok, text=text)

    def refused(self, text: str, *, who: str = "") -> None:
        """Append a refused message, which was invalid or unauthorised, to the operator log."""
        self._append(who=who, command="", ok=False, text=text)

    def note(self, text: str) -> None:
        """Append an event of an operator channel to the operator log."""
        self._append(who="", command="", ok=True, text=text)

    def _append(self, **fields: str | bool) -> None:
        stamp = datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"utc": stamp, **fields}, ensure_ascii=False)
        data = (line + "\n").encode("utf-8", "backslashreplace")
        before, self._last = self._last, self._writer.submit(self._append_line, data)
        if before is None or before.done():  # else the disk is slow, and each line would wait
            wait([self._last], _WRITTEN_WITHIN_S)
        if self._last.done():
            self._last.result()

    def _append_line(self, line: bytes) -> None:
        with contextlib.suppress(OSError), self._path.open("ab") as stream:
            stream.write(line)
