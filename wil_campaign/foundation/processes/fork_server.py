"""Starts processes of one program by forking one that has imported it: in milliseconds.

A fork server is a process without threads. A client sends it a command with its environment and
descriptors in one packet, and gets the id of the forked process, and when that has ended its exit
code. Nobody has to have it: where it is not there, not ready or refuses, a program is started as
any other.
"""

import asyncio
import contextlib
import errno
import fcntl
import os
import select
import signal
import socket
import struct
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from io import FileIO
from pathlib import Path

from wil_campaign.foundation.clocks.paced_loop import wall_timeout
from wil_campaign.foundation.processes.codec import (
    MessageCodec,
    ProcessMessage,
    ProcessMessageError,
)
from wil_campaign.foundation.processes.linux import show_process_command

OWN_VARIABLES = "WIL_CAMPAIGN_"
"""Variables of one process, as of the sockets that it inherits, begin so."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""What a fork server is started with: of its threads, a fork has the first alone."""
UNKNOWN_EXIT = 255
"""The exit code of a process whose fork server had ended before it."""
READY_S = 5.0
"""How long a client waits for a process, in wall time: a fork server imports for a second."""
_PACKET_BYTES = 1 << 20
_DESCRIPTORS = 32
_REPLY = struct.Struct("ci")
_STARTED, _ENDED = b"s", b"e"
"""Kinds of replies: with the process's id, which it sends itself, and with its exit code."""
_GO = b"go"


class _Request(ProcessMessage, frozen=True):
    """Asks a fork server for a process. argv: its whole command line. numbers: of descriptors.

    The packet brings a socket for replies, and the descriptors that get these numbers.
    """

    argv: tuple[str, ...]
    environment: dict[str, str]
    folder: str
    umask: int
    numbers: tuple[int, ...]


_request: MessageCodec[_Request] = MessageCodec(_Request)


class ForkedProcess:
    """A process that a fork server has forked, as `subprocess.Popen` is of one started here.

    It waits, and ends with its client, until `go`.
    """

    def __init__(self, pid: int, reply: socket.socket, stderr: FileIO | None) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self.stderr = stderr
        self._reply = reply

    def go(self) -> None:
        """Have the forked process run its program. Raises OSError."""
        self._reply.send(_GO)

    def fileno(self) -> int:
        """Return the descriptor that is readable once `poll` knows the exit code."""
        return self._reply.fileno()

    def poll(self) -> int | None:
        """Return the exit code if the fork server has sent it, else None; once it has ended."""
        if self.returncode is None:
            try:
                code = _read_reply(self._reply, _ENDED)
            except BlockingIOError:
                return None
            self._close(UNKNOWN_EXIT if code is None else code)
        return self.returncode

    def give_up(self) -> None:
        """Do without the exit code of the forked process, which has ended."""
        if self.returncode is None:
            self._close(UNKNOWN_EXIT)

    def kill(self) -> None:
        """Kill the forked process."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> None:
        """Stop waiting for the forked process: its fork server reaps it."""
        self.give_up()

    def _close(self, code: int) -> None:
        self.returncode = code
        self._reply.close()


class ForkServer:
    """A client's end of a fork server. program: the words before a process's own arguments."""

    def __init__(self, end: int, program: Sequence[str]) -> None:
        self._end = socket.socket(fileno=end)
        self._end.set_inheritable(False)
        self._program = tuple(program)

    def close(self) -> None:
        """Close this end."""
        self._end.close()

    def forks(self, argv: Sequence[str]) -> bool:
        """Return whether a command is one of the fork server's program."""
        return tuple(argv[: len(self._program)]) == self._program

    async def fork(
        self,
        argv: Sequence[str],
        *,
        environment: Mapping[str, str],
        streams: tuple[int, int, int],
        inherited: Sequence[int],
        stderr: FileIO | None,
    ) -> ForkedProcess | None:
        """Return a new process of the program, in its own session; None where none can be had.

        streams: descriptors of its stdin, stdout and stderr; inherited: those that it gets under
        their own numbers. stderr: the end of a pipe that the process is going to be read by.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            try:
                request = _Request(
                    tuple(argv), dict(environment), str(Path.cwd()), _umask(), (0, 1, 2, *inherited)
                )
                passed = [theirs.fileno(), *streams, *inherited]
                packet = [_request.encode(request)]
                socket.send_fds(self._end, packet, passed, socket.MSG_DONTWAIT)
            except (OSError, ValueError):
                ours.close()
                return None
        try:
            pid = await _receive_pid(ours)
        except BaseException:
            ours.close()  # a process that is forked none the less ends by it
            raise
        if pid is None:
            ours.close()
            return None
        return ForkedProcess(pid, ours, stderr)


async def _receive_pid(reply: socket.socket) -> int | None:
    """Return the id of a forked process; None where there is none, and after READY_S."""
    reply.setblocking(False)
    loop = asyncio.get_running_loop()
    readable = asyncio.Event()
    loop.add_reader(reply, readable.set)
    try:
        with contextlib.suppress(TimeoutError, BlockingIOError):
            async with wall_timeout(READY_S):
                await readable.wait()
            return _read_reply(reply, _STARTED)
        return None
    finally:
        loop.remove_reader(reply)


def _read_reply(reply: socket.socket, wanted: bytes) -> int | None:
    """Return the number of the next reply, of one kind; None at the end. Raises BlockingIOError."""
    try:
        packet = reply.recv(_REPLY.size)
    except ConnectionError:
        return None
    if len(packet) != _REPLY.size:
        return None
    kind, number = _REPLY.unpack(packet)
    return int(number) if kind == wanted else None


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


class _Child:
    """Tells a forked process from its fork server. request, reply, descriptors: what it gets."""

    def __init__(self, request: _Request, reply: socket.socket, descriptors: list[int]) -> None:
        self.request = request
        self.reply = reply
        self.descriptors = descriptors


def serve_forks(end: socket.socket, run: Callable[[list[str]], int], *, words: int) -> int:
    """Fork a process for each request until no client is left; return the exit code.

    run: the program, of its arguments; words: how many of a command's words stand before those.
    Signals end no fork server, but its processes: they are in sessions of their own. A request with
    another environment than this process was started with is refused: imports may depend on it.
    """
    environment = _common(_environment_at_start())
    wakeups = _catch_signals()
    replies: dict[int, socket.socket] = {}
    poll = select.poll()
    for descriptor in (end.fileno(), wakeups):
        poll.register(descriptor, select.POLLIN)
    while True:
        ready = {descriptor for descriptor, _ in poll.poll()}
        if wakeups in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(wakeups, 4096)
            _report_ended(replies)
        if end.fileno() not in ready:
            continue
        data, descriptors, _, _ = socket.recv_fds(end, _PACKET_BYTES, _DESCRIPTORS)
        if not data:
            return 0
        child = _fork(data, descriptors, environment, replies)
        if child is not None:
            end.detach()
            for reply in replies.values():
                reply.detach()
            _run(child, run, words)


def _environment_at_start() -> dict[str, str]:
    """Return the environment that this process was started with, whatever it has set since."""
    entries = Path("/proc/self/environ").read_bytes().split(b"\0")
    pairs = (os.fsdecode(entry).partition("=") for entry in entries if entry)
    return {name: value for name, _, value in pairs}


def _common(environment: Mapping[str, str]) -> dict[str, str]:
    return {
        name: value
        for name, value in environment.items()
        if not (name.startswith(OWN_VARIABLES) or name in ONE_THREAD)
    }


def _catch_signals() -> int:
    """Return a descriptor that is readable when a child of the fork server has ended."""
    wakeups, waker = os.pipe()
    for descriptor in (wakeups, waker):
        os.set_blocking(descriptor, False)
    for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: None)
    signal.set_wakeup_fd(waker, warn_on_full_buffer=False)
    return wakeups


def _fork(
    data: bytes,
    descriptors: list[int],
    environment: Mapping[str, str],
    replies: dict[int, socket.socket],
) -> _Child | None:
    """Fork a process as a request says; return what it gets, in that process, and None here."""
    reply = socket.socket(fileno=descriptors[0])
    try:
        request = _request.decode(data)
    except ProcessMessageError:
        request = None
    if (
        request is None
        or len(descriptors) != 1 + len(request.numbers)
        or _common(request.environment) != environment
    ):
        pid = None
    else:
        pid = os.fork()
        if pid == 0:
            return _Child(request, reply, descriptors[1:])
    for descriptor in descriptors[1:]:
        os.close(descriptor)
    if pid is None:
        reply.close()
        return None
    replies[pid] = reply
    return None


def _report_ended(replies: dict[int, socket.socket]) -> None:
    """Reap the processes of a fork server that have ended, and tell their clients."""
    while replies:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            return
        reply = replies.pop(pid)
        with reply, contextlib.suppress(OSError):
            reply.send(_REPLY.pack(_ENDED, os.waitstatus_to_exitcode(status)))


def _run(child: _Child, run: Callable[[list[str]], int], words: int) -> None:
    """Run the program in a forked process, which ends here."""
    code = 1
    try:
        _become(child)
        code = run(list(child.request.argv[words:]))
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:  # noqa: BLE001 - as the interpreter reports it
        traceback.print_exc()
    finally:
        with contextlib.suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code & 0xFF)


def _become(child: _Child) -> None:
    """Make a forked process what a started one is: session, signals, descriptors, environment."""
    signal.set_wakeup_fd(-1)
    for number in (signal.SIGCHLD, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.setsid()
    request = child.request
    show_process_command(request.argv)
    if not _is_wanted(child.reply):
        os._exit(0)
    child.reply.detach()
    _place(child.descriptors, request.numbers)
    os.chdir(request.folder)
    os.umask(request.umask)
    os.environ.clear()
    os.environ.update(request.environment)
    sys.argv = list(request.argv)


def _is_wanted(reply: socket.socket) -> bool:
    """Tell a forked process's id; return whether its client lives and has not given up."""
    try:
        reply.send(_REPLY.pack(_STARTED, os.getpid()))
        return reply.recv(len(_GO)) == _GO
    except OSError:
        return False


def _place(descriptors: Sequence[int], numbers: Sequence[int]) -> None:
    above = max(numbers) + 1
    apart = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, above) for descriptor in descriptors]
    for one, number in zip(apart, numbers, strict=True):
        os.dup2(one, number)
    for entry in tuple(Path("/proc/self/fd").iterdir()):
        number = int(entry.name)
        if number not in numbers:
            try:
                os.close(number)
            except OSError as error:
                if error.errno != errno.EBADF:  # that of the folder's own reading
                    raise
