"""Speaks to operators' sockets: one line asked, one line answered."""

import contextlib
import json
import socket
from pathlib import Path
from typing import Any

_ANSWER_S = 2.0
_LONGEST_ANSWER_BYTES = 1 << 20
_TELL_S = 0.2


class NoAnswerError(Exception):
    """An operator socket that is missing or does not reply."""


def ask(path: Path, command: str, *, who: str, **more: str) -> dict[str, Any]:
    """Return an operator socket's reply to a command. Raises NoAnswerError."""
    try:
        with socket.socket(socket.AF_UNIX) as end:
            end.settimeout(_ANSWER_S)
            end.connect(str(path))
            end.sendall(_line(command, who, **more))
            with end.makefile("rb") as stream:
                answer = json.loads(stream.readline(_LONGEST_ANSWER_BYTES))
    except (OSError, ValueError) as error:
        raise NoAnswerError(f"{path} does not answer: {error}") from error
    if not isinstance(answer, dict):
        raise NoAnswerError(f"{path} does not answer by the protocol")
    return answer


def tell(path: Path, command: str, *, who: str) -> None:
    """Send a command to an operator socket without waiting; a missing one is ignored."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as end:
        end.settimeout(_TELL_S)
        end.connect(str(path))
        end.sendall(_line(command, who))


def _line(command: str, who: str, **more: str) -> bytes:
    """Return a command's line for the operator socket."""
    return json.dumps({"command": command, "who": who, **more}).encode() + b"\n"
