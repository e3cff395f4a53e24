"""Reads a simulator's output from its file, line by line as the file grows."""

import re
from collections import deque
from pathlib import Path

_TAIL_LINES = 15
_COLOURS = re.compile(rb"\x1b\[[0-9;]*[A-Za-z]")


class Output:
    """A simulator's output: the complete lines of a growing file, without colours."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = 0
        self._rest = b""
        self._tail: deque[str] = deque(maxlen=_TAIL_LINES)

    def new_lines(self, *, ended: bool = False) -> list[str]:
        """Return the simulator's output lines since the last call.

        ended: the simulator has ended, so that an unterminated last line is complete.
        """
        with self._path.open("rb") as file:
            file.seek(self._offset)
            data = file.read()
        self._offset += len(data)
        *whole, self._rest = (self._rest + data).split(b"\n")
        if ended and self._rest:
            whole.append(self._rest)
            self._rest = b""
        lines = [_COLOURS.sub(b"", line).decode(errors="replace").strip() for line in whole]
        lines = [line for line in lines if line]
        self._tail.extend(lines)
        return lines

    @property
    def last_output(self) -> str:
        """Return the last lines of a simulator's output."""
        return "\n".join(self._tail)
