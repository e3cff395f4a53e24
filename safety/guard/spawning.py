"""Starts a guard's process, with what it inherits."""

import asyncio
import os
import socket
import subprocess
import sys
from dataclasses import dataclass
from typing import IO

from safety.guard.channel import channel_pair
from safety.guard.last_words import open_stderr
from vehicles.links.base import LinkError

SCALED = "scaled"
"""The fourth argument of a guard whose clock may be led."""


@dataclass(frozen=True, slots=True)
class Spawned:
    """A guard's process. end: our end of the packet socket. hold: keeps its children's stdin open.

    stderr: the file that it writes to.
    """

    process: "subprocess.Popen[bytes]"
    end: socket.socket
    hold: int
    stderr: IO[bytes]


async def spawn_guard(folder: str, *, scaled: bool) -> Spawned:
    """Start it in a session of its own. Raises LinkError when it cannot be started."""
    ours, theirs = channel_pair()
    lifeline, hold = os.pipe()
    try:
        stderr = open_stderr(folder)
        descriptors = (theirs.fileno(), lifeline, hold)
        words = [*map(str, descriptors), *([SCALED] if scaled else [])]
        # Not asyncio's: its transport kills a process that outlives it, and a guard may.
        process = await asyncio.to_thread(
            subprocess.Popen,
            [sys.executable, "-m", "safety.guard.process", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            pass_fds=descriptors,
            start_new_session=True,
        )
    except OSError as error:
        ours.close()
        os.close(hold)
        raise LinkError(f"the guard's process cannot be started: {error}") from error
    finally:
        theirs.close()
        os.close(lifeline)
    return Spawned(process, ours, hold, stderr)
