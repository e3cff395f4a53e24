"""Standard output and standard error, the one place where the command line writes to them."""

import io
import os
import shutil
import sys
from contextlib import suppress
from typing import TextIO, cast

_LEAST_COLUMNS = 20
"""In fewer, help and tables are laid out for ever, or not printed at all."""


class StreamError(Exception):
    """Standard output failed; says why."""


def write_stdout(text: object) -> None:
    """Write a line to standard output. Raises StreamError; BrokenPipeError without a reader."""
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        _redirect_to_null(sys.stdout)
        raise
    except OSError as error:
        _redirect_to_null(sys.stdout)
        raise StreamError(f"standard output: {error.strerror or error}") from error


def write_stderr(text: object) -> None:
    """Write a line to standard error; a closed stream is ignored."""
    with suppress(OSError):
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()


def ignore_broken_pipe() -> TextIO:
    """Return standard output as a stream that ignores a broken pipe.

    After a failed write (the reader of the pipe or the terminal has gone, the disk is full) further
    text is discarded: a flight does not end because its output cannot be written.
    """
    return cast("TextIO", _BrokenPipeStream(sys.stdout))


class _BrokenPipeStream(io.TextIOBase):
    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]  # typeshed has a plain attribute
        return self._stream.encoding or "utf-8"

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._stream.fileno()

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except OSError:
            _redirect_to_null(self._stream)
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            _redirect_to_null(self._stream)

    def close(self) -> None:
        """Leave the stream to its owner: the collector calls this, maybe once it is closed."""


def repair_standard_streams() -> None:
    """Make all three standard streams open and able to take any text.

    A closed stream (`>&-`) would be None, and the next file we open would get its descriptor.
    Characters that an encoding other than UTF-8 lacks are written as escapes.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free: this one
            os.set_inheritable(number, True)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="backslashreplace")


def widen_output() -> None:
    """Have texts laid out for 20 columns at least, whatever COLUMNS or the terminal says."""
    given = os.environ.get("COLUMNS", "")
    columns = shutil.get_terminal_size().columns
    if columns < _LEAST_COLUMNS or (given.isdecimal() and int(given) < _LEAST_COLUMNS):
        os.environ["COLUMNS"] = str(max(columns, _LEAST_COLUMNS))


def _redirect_to_null(stream: TextIO) -> None:
    """Redirect a failed standard stream to nothing, so that its last flush is quiet."""
    with suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)
