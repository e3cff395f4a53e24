"""Programs of tests, forked from one process that has imported them: seconds of CPU less each.

What the start of an interpreter does differently from a fork is the matter of few tests; those say
`sys.executable` themselves.
"""

import asyncio
import atexit
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from wil_campaign.vehicles.processes.fork_server import ForkedProcess, ForkServer

ROOT = Path(__file__).parents[1]
_PROGRAM = (sys.executable, "-P", "-m", "tests.preloaded")
_ROOM = " " * 16_000
"""For command line and environment of what is forked, which /proc shows."""
_STARTED_WITHIN_S = 120.0
_STARTING = threading.Lock()


class Forked:
    """A forked program, as `asyncio.subprocess.Process` is a started one."""

    def __init__(self, process: ForkedProcess, streams: Sequence[asyncio.StreamReader]) -> None:
        self.pid = process.pid
        self.stdout, self.stderr = (*streams, None, None)[:2]
        self.returncode: int | None = None
        self._process = process
        self._ended = asyncio.Event()
        self._descriptor = process.fileno()
        asyncio.get_running_loop().add_reader(self._descriptor, self._poll)

    def _poll(self) -> None:
        self.returncode = self._process.poll()
        if self.returncode is not None:
            asyncio.get_running_loop().remove_reader(self._descriptor)
            self._ended.set()

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    async def wait(self) -> int:
        """Wait for its end; return its exit code."""
        await self._ended.wait()
        assert self.returncode is not None
        return self.returncode

    async def communicate(self) -> tuple[bytes, bytes]:
        """Wait for its end, and return what it wrote."""
        readers = [one for one in (self.stdout, self.stderr) if one is not None]
        out, err = (*await asyncio.gather(*(one.read() for one in readers)), b"", b"")[:2]
        await self.wait()
        return out, err


async def fork_program(
    *words: str, environment: Mapping[str, str], cwd: Path = ROOT, piped: bool = True
) -> Forked:
    """Fork what `python WORDS` would start: `-m MODULE ...`, in a session of its own.

    piped: its stdout and stderr are read by `communicate`; else it has those of this process.
    """
    server, start_environment = await asyncio.to_thread(_preloaded)
    given = {"argv": [sys.executable, *words], "environment": dict(environment), "cwd": str(cwd)}
    with contextlib.ExitStack() as stack:
        empty = os.open(os.devnull, os.O_RDONLY)
        stack.callback(os.close, empty)
        ends = [os.pipe() for _ in range(2 if piped else 0)]
        for _, writing in ends:
            stack.callback(os.close, writing)
        streams = (empty, *((writing for _, writing in ends) if piped else (1, 2)))
        readers = [await _read(reading) for reading, _ in ends]
        async with asyncio.timeout(_STARTED_WITHIN_S):
            while True:
                process = await server.fork(
                    (*_PROGRAM, json.dumps(given)),
                    environment=start_environment,
                    streams=streams,
                    inherited=(),
                    stderr=None,
                )
                if process is not None:
                    break
        process.go()
    return Forked(process, readers)


async def _read(descriptor: int) -> asyncio.StreamReader:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    file = os.fdopen(descriptor, "rb", 0)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), file)
    return reader


def _preloaded() -> tuple[ForkServer, Mapping[str, str]]:
    with _STARTING:
        return _start_preloaded()


@cache
def _start_preloaded() -> tuple[ForkServer, Mapping[str, str]]:
    """Start the process that forks; return its client's end, and its environment."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    environment.pop("XDG_RUNTIME_DIR", None)  # else it were one of a flight's processes
    with theirs:
        process = subprocess.Popen(  # noqa: S603 - our own interpreter
            [*_PROGRAM, str(theirs.fileno()), _ROOM],
            cwd=ROOT,
            env={**environment, "WIL_CAMPAIGN_ROOM": _ROOM},
            stdout=subprocess.PIPE,
            pass_fds=(theirs.fileno(),),
            start_new_session=True,
        )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    server = ForkServer(ours.detach(), _PROGRAM)

    def end() -> None:
        server.close()
        process.wait()

    atexit.register(end)
    return server, environment
