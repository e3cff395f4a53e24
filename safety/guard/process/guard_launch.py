"""Starts a guard's process, with what it inherits."""

import os
import socket
import sys
from dataclasses import dataclass
from typing import IO

from safety.guard.process.channel import channel_pair
from safety.guard.process.guard_stderr import open_stderr
from vehicles.links.link import LinkError
from vehicles.processes.child import ChildProcess

SCALED = "scaled"
"""The fourth argument of a guard whose clock may be led."""


@dataclass(frozen=True, slots=True)
class LaunchedGuard:
    """A launched guard process. end: our channel end. hold: its children's stdin stays open.

    stderr: the file that it writes to.
    """

    process: ChildProcess
    end: socket.socket
    hold: int
    stderr: IO[bytes]


def spawn_guard(folder: str, *, scaled: bool) -> LaunchedGuard:
    """Launch the guard process in its own session. Raises LinkError when it fails."""
    ours, theirs = channel_pair()
    lifeline, hold = os.pipe()
    try:
        stderr = open_stderr(folder)
        descriptors = (theirs.fileno(), lifeline, hold)
        words = [*map(str, descriptors), *([SCALED] if scaled else [])]
        process = ChildProcess(
            argv=(sys.executable, "-P", "-m", "safety.guard.process", *words),
            output=stderr.fileno(),
            inherited=descriptors,
        )
        process.start()
    except OSError as error:
        ours.close()
        os.close(hold)
        raise LinkError(f"the guard's process cannot be started: {error}") from error
    finally:
        theirs.close()
        os.close(lifeline)
    return LaunchedGuard(process, ours, hold, stderr)
