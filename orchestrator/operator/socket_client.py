"""Client of operator sockets: sends a JSON line and reads the JSON line of the reply."""

import contextlib
import json
import os
import socket
import stat
import time
from pathlib import Path
from typing import Any

from wil_campaign.foundation.processes.linux import UnsupportedSystemError, socket_peer_uid

_ANSWER_S = 2.0
_LONGEST_ANSWER_BYTES = 1 << 20
_TELL_S = 0.2
_RETRY_S = 0.001
_OF_THE_MOMENT = frozenset({"hold", "resume", "geofence"})


class NoAnswerError(Exception):
    """An operator socket that is missing or does not reply."""


def ask_operator_socket(path: Path, command: str, *, who: str, **more: str) -> dict[str, Any]:
    """Return an operator socket's reply to a command. Raises NoAnswerError."""
    try:
        with socket.socket(socket.AF_UNIX) as end:
            _connect(end, path, within_s=_ANSWER_S)
            end.sendall(_line(command, who, **more))
            with end.makefile("rb") as stream:
                answer = json.loads(stream.readline(_LONGEST_ANSWER_BYTES))
    except (OSError, ValueError) as error:
        raise NoAnswerError(f"{path} does not answer: {error}") from error
    if not isinstance(answer, dict):
        raise NoAnswerError(f"{path} does not answer by the protocol")
    return answer


def tell_operator_socket(path: Path, command: str, *, who: str) -> None:
    """Send a command to an operator socket without waiting; a missing one is ignored."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as end:
        _connect(end, path, within_s=_TELL_S)
        end.sendall(_line(command, who))


def _connect(end: socket.socket, path: Path, *, within_s: float) -> None:
    """Connect to a socket that belongs to this user. Raises OSError.

    Retries while the listener's backlog is full: unix(7) reports that at once, as EAGAIN.
    """
    if not stat.S_ISSOCK(path.lstat().st_mode):
        raise OSError("it is not a socket")
    end.settimeout(within_s)
    deadline_s = time.monotonic() + within_s
    while True:
        try:
            end.connect(str(path))
            break
        except BlockingIOError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(_RETRY_S)
    with contextlib.suppress(UnsupportedSystemError):
        if socket_peer_uid(end) not in {os.getuid(), 0}:
            raise OSError("it belongs to another user")


def _line(command: str, who: str, **more: str) -> bytes:
    """Return the line of a command; one that may come too late says when it was sent."""
    at_s = {"at_s": time.monotonic()} if command in _OF_THE_MOMENT else {}
    return json.dumps({"command": command, "who": who, **at_s, **more}).encode() + b"\n"
