"""What a process that ended said last, as one line for the reason of a run."""

import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from wil_campaign.foundation.files.problems import printable_problem

_TAIL_BYTES = 8000
_TAIL_LINES = 3
_AFTER = 3
"""How many lines may follow a traceback that still is what ended the process."""
_FRAME = re.compile(r'  File "(?P<file>[^"]+)", line (?P<line>\d+), in (?P<where>.+)')
_MISSING = ("ModuleNotFoundError", "No module named", "can't open file")
"""What Python says of a program that another interpreter, or another folder, may have."""
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")
_LINE_LETTERS = 500
_LIBRARY = re.compile(r"/(site|dist)-packages/|/lib/python|^<")


def last_output(log: Path) -> str:
    """Return what a process printed last, in one printable line; empty where there is nothing.

    Of a Python traceback: its exception, and where in the program's own file.
    """
    try:
        with log.open("rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(max(0, size - _TAIL_BYTES))
            text = stream.read().decode("utf-8", "replace")
    except OSError:
        return ""
    plain = _COLOURS.sub("", text).expandtabs()
    lines = [printable_problem(line.rstrip()) for line in plain.splitlines() if line.strip()]
    end = [" ".join(line.split())[-_LINE_LETTERS:] for line in lines[-_TAIL_LINES:]]
    return _exception(lines) or "; ".join(end)


def output_with_interpreter(
    printed: str, argv: Sequence[str], *, environment: Mapping[str, str], folder: Path | None
) -> str:
    """Return what a program said; where Python missed a module or file, with what ran it.

    environment, folder: of the program: by its PATH, or its folder, the command is found. Links
    are not followed: a virtual environment's interpreter is one.
    """
    if not any(text in printed for text in _MISSING):
        return printed
    name = argv[0]
    if "/" in name:
        found = str((folder or Path.cwd()) / name)
    else:
        found = shutil.which(name, path=environment.get("PATH")) or name
    return f"{printed}; it was run by {found}"


def _exception(lines: list[str]) -> str:
    """Return the exception of a traceback at the end of a log; empty where there is none."""
    found = [index for index, line in enumerate(lines) if _FRAME.match(line)]
    if not found:
        return ""
    ends = (index for index in range(found[-1], len(lines)) if not lines[index].startswith(" "))
    end = next(ends, None)
    if end is None or len(lines) - end - 1 > _AFTER:
        return ""
    frames = []
    for line in reversed(lines[:end]):
        if not line.startswith(" "):
            break
        if frame := _FRAME.match(line):
            frames.append(frame)
    own = next((one for one in frames if not _LIBRARY.search(one["file"])), frames[0])
    where = f"{Path(own['file']).name} line {own['line']}, {own['where']}"
    return f"{lines[end][:_LINE_LETTERS]} ({where})"
