"""Programs of tests, forked from one process that has imported them: seconds of CPU less each.

What the start of an interpreter does differently from a fork is the matter of few tests; those say
`sys.executable` themselves.
"""

import asyncio
import atexit
import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from io import FileIO
from pathlib import Path
from typing import IO, Any, Self
from unittest import mock

from wil_campaign.vehicles.processes import child, fork_server
from wil_campaign.vehicles.processes.fork_server import ForkedProcess

ROOT = Path(__file__).parents[1]
_PROGRAM = (sys.executable, "-P", "-m", "tests.preloaded")
_ROOM = " " * 16_000
"""For command line and environment of what is forked, which /proc shows."""
_STARTED_WITHIN_S = 120.0
_STARTING = threading.Lock()
END = 900
"""The descriptor of the preloaded process's clients' end, here and in all that it forks."""
FORKED = frozenset(
    {
        "tests.faults.exceptions.guard_program",
        "tests.safety.guard.fake_vehicle_program",
        "wil_campaign.safety.guard.process",
        "wil_campaign.vehicles.vehicle_server",
    }
)
"""Programs that are forked where a forked one, or `children_forked`, starts them."""
_server: list[Mapping[str, str]] = []


_Stream = tuple[asyncio.StreamReader, asyncio.ReadTransport]


class Forked:
    """A forked program, as `asyncio.subprocess.Process` is a started one."""

    def __init__(self, process: ForkedProcess, streams: Sequence[_Stream]) -> None:
        self.pid = process.pid
        self.stdout, self.stderr = (*(reader for reader, _ in streams), None, None)[:2]
        self._transports = [transport for _, transport in streams]
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
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(1.0):  # what it has started may hold them
                while not all(one.is_closing() for one in self._transports):  # noqa: ASYNC110
                    await asyncio.sleep(0.01)
        for one in self._transports:
            one.close()
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
    with contextlib.ExitStack() as stack:
        ends = [os.pipe() for _ in range(2 if piped else 0)]
        for _, writing in ends:
            stack.callback(os.close, writing)
        streams = (None, ends[0][1], ends[1][1]) if piped else (None, 1, 2)
        readers = [await _read(reading) for reading, _ in ends]
        process = await asyncio.to_thread(fork, words, streams, environment, cwd)
    return Forked(process, readers)


class ForkedPopen:
    """A forked program, as `subprocess.Popen` is a started one, in a session of its own."""

    def __init__(
        self,
        argv: Sequence[str],
        *,
        stdin: int | None = None,
        stdout: int | None = None,
        stderr: int | None = None,
        env: Mapping[str, str] | None = None,
        cwd: Path | None = None,
        **_: object,
    ) -> None:
        self.args, self.returncode = argv, None
        self.stdin: IO[bytes] | None = None
        self.stdout: IO[bytes] | None = None
        self.stderr: IO[bytes] | None = None
        with contextlib.ExitStack() as stack:
            if stdin == subprocess.PIPE:
                stdin, writing = os.pipe()
                stack.callback(os.close, stdin)
                self.stdin = os.fdopen(writing, "wb")
            if stdout == subprocess.PIPE:
                reading, stdout = os.pipe()
                stack.callback(os.close, stdout)
                self.stdout = os.fdopen(reading, "rb")
            of_ours = ((stdin, None), (stdout, 1), (stderr, 2))
            first, second, third = (
                None if one == subprocess.DEVNULL else ours if one is None else one
                for one, ours in of_ours
            )
            environment = os.environ if env is None else env
            self._process = fork(argv[1:], (first, second, third), environment, cwd or Path.cwd())
        self.pid = self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for stream in (self.stdin, self.stdout):
            if stream is not None:
                stream.close()
        self.wait()

    def poll(self) -> int | None:
        return self._process.poll()

    def detach(self) -> None:
        """Wait for its end no more."""
        self._process.give_up()

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; return its exit code. Raises TimeoutExpired."""
        while (code := self._process.poll()) is None:
            if not select.select([self._process], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return code

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)


class ForkedSubprocess:
    """`subprocess`, for a module that starts one of our programs."""

    PIPE = subprocess.PIPE
    Popen = ForkedPopen


def fork(
    words: Sequence[str],
    streams: tuple[int | None, int | None, int | None],
    environment: Mapping[str, str],
    cwd: Path,
    inherited: Sequence[int] = (),
) -> ForkedProcess:
    """Fork what `python WORDS` would start, with `ForkedProcess.stderr` None.

    streams: descriptors of its stdin, stdout and stderr; None: an empty one. inherited:
    descriptors that it gets under their own numbers.
    """
    start_environment = _preloaded()
    argv = [sys.executable, *words]
    given = {
        "argv": argv,
        "environment": dict(environment),
        "cwd": str(cwd),
        "parent": os.getpid(),
        "policy": os.sched_getscheduler(0),
        "nice": os.nice(0),
    }
    numbers = (0, 1, 2, END, *inherited)
    request = fork_server._Request(
        (*_PROGRAM, json.dumps(given)), dict(start_environment), "/", fork_server._umask(), numbers
    )
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with (
        Path(os.devnull).open("r+b", 0) as empty,
        theirs,
        socket.socket(fileno=os.dup(END)) as asks,
    ):
        of_streams = [empty.fileno() if one is None else one for one in streams]
        passed = [theirs.fileno(), *of_streams, END, *inherited]
        socket.send_fds(asks, [fork_server._request.encode(request)], passed)
    ours.settimeout(_STARTED_WITHIN_S)
    pid = fork_server._read_reply(ours, fork_server._STARTED)
    assert pid is not None, "the preloaded process has refused, or ended"
    ours.setblocking(False)
    process = ForkedProcess(pid, ours, None)
    process.go()
    return process


async def _read(descriptor: int) -> _Stream:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    file = os.fdopen(descriptor, "rb", 0)
    transport, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), file)
    return reader, transport


def _preloaded() -> Mapping[str, str]:
    """Return the environment of the process that forks, which is started once."""
    with _STARTING:
        if not _server:
            _server.append(_start_preloaded())
        return _server[0]


def adopt(start_environment: Mapping[str, str]) -> None:
    """Fork by the preloaded process of which this one was forked: END is there."""
    _server[:] = [start_environment]


def _start_preloaded() -> Mapping[str, str]:
    """Start the process that forks, with its clients' end at END; return its environment."""
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
    os.dup2(ours.fileno(), END, inheritable=False)
    ours.close()

    def stop() -> None:
        process.kill()  # what it has forked goes on
        process.wait()

    atexit.register(stop)
    return environment


class _Subprocess:
    """`subprocess` for children of ours that run one of our programs: they are forked."""

    PIPE = subprocess.PIPE
    DEVNULL = subprocess.DEVNULL

    @staticmethod
    def Popen(argv: Sequence[str], **given: Any) -> subprocess.Popen[bytes] | ForkedProcess:  # noqa: N802 - in place of that
        module = argv[argv.index("-m") + 1] if "-m" in argv[:3] else ""
        if argv[0] != sys.executable or module not in FORKED:
            return subprocess.Popen(argv, **given)  # noqa: S603 - as it was asked for
        with contextlib.ExitStack() as stack:
            stdin, stdout, stderr = (
                None if given[name] == subprocess.DEVNULL else given[name]
                for name in ("stdin", "stdout", "stderr")
            )
            reading = None
            if stderr == subprocess.PIPE:
                reading, stderr = os.pipe()
                stack.callback(os.close, stderr)
            environment = os.environ if given["env"] is None else given["env"]
            cwd = Path.cwd() if given["cwd"] is None else given["cwd"]
            streams = (stdin, stdout, stderr)
            process = fork(argv[1:], streams, environment, cwd, given["pass_fds"])
        if reading is not None:
            process.stderr = FileIO(reading, "rb")
        return process


@contextlib.contextmanager
def children_forked() -> Iterator[None]:
    """Have children that run one of our programs forked; their parent is the preloaded process."""
    with mock.patch.multiple(child, subprocess=_Subprocess, _CODE_S=_STARTED_WITHIN_S):
        yield
