"""Starts a guard's process, with what it inherits."""

import os
import socket
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO

from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.safety.guard.process.channel import guard_channel_pair
from wil_campaign.safety.guard.process.guard_stderr import open_stderr
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.vehicle_server_process import vehicle_server

SCALED = "scaled"
"""A further argument of a guard whose clock may be led."""
SERVER = "server="
"""Begins a further argument, the descriptor at which the guard asks for processes of vehicles."""


@dataclass(frozen=True, slots=True)
class LaunchedGuard:
    """A launched guard process. end: our channel end. hold: its children's stdin stays open.

    stderr: the file that it writes to.
    """

    process: ChildProcess
    end: socket.socket
    hold: int
    stderr: IO[bytes]


def spawn_guard(folder: str, *, scaled: bool, passed: Sequence[int] = ()) -> LaunchedGuard:
    """Launch the guard process in its own session. Raises LinkError when it fails.

    passed: descriptors that it inherits for the vehicles that it will start.
    """
    ours, theirs = guard_channel_pair()
    lifeline, hold = os.pipe()
    try:
        stderr = open_stderr(folder)
        descriptors = (theirs.fileno(), lifeline, hold)
        words = [*map(str, descriptors), *([SCALED] if scaled else [])]
        if (server := vehicle_server()) is not None:
            words.append(f"{SERVER}{server}")
            passed = (*passed, server)
        process = ChildProcess(
            argv=(sys.executable, "-P", "-m", "wil_campaign.safety.guard.process", *words),
            environment=dict(os.environ),  # what its vehicles are to have, and no more
            output=stderr.fileno(),
            inherited=(*descriptors, *passed),
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
