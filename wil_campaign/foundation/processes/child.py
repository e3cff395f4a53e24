"""A child process in its own group: started, watched, and ended with all its descendants."""

import asyncio
import contextlib
import io
import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from wil_campaign.foundation.clocks.paced_loop import call_wall_later, wall_timeout
from wil_campaign.foundation.clocks.virtual_loop import VirtualLoop
from wil_campaign.foundation.processes.fork_server import ForkedProcess, ForkServer
from wil_campaign.foundation.processes.identity import ProcessId, process_group_lives
from wil_campaign.foundation.processes.linux import exit_descriptor

_GRACE_S = 3.0
_KILL_GRACE_S = 2.0
_POLL_S = 0.02
_CODE_S = 5.0
"""How long the exit code of a forked process that has ended may take."""
_TAIL_LINES = 20
_TAIL_BYTES = 4000
_READ_BYTES = 1 << 16


class ChildProcess:
    """A child process in its own session and group, so that Ctrl-C does not reach it.

    environment: the whole environment; None for this process's own. folder: its working directory.
    stdin: a file descriptor; None for an empty one. output: the file descriptor for stdout and
    stderr; None to drop stdout and keep the end of stderr for `stderr_tail`. inherited:
    descriptors that it gets under their own numbers. grace_s: how long it and its descendants may
    take to end after SIGTERM, in wall time. It is not ended when this process ends: its program
    has to detect that (by the end of its stdin, or `linux.die_with_parent`).
    """

    def __init__(
        self,
        *,
        argv: Sequence[str],
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        stdin: int | None = None,
        output: int | None = None,
        inherited: Sequence[int] = (),
        grace_s: float = _GRACE_S,
    ) -> None:
        self._argv = tuple(argv)
        self._environment = environment
        self._folder = folder
        self._stdin = stdin
        self._output = output
        self._inherited = tuple(inherited)
        self._grace_s = grace_s
        self._process: subprocess.Popen[bytes] | ForkedProcess | None = None
        self._id: ProcessId | None = None
        self._on_end: Callable[[ChildProcess], None] | None = None
        self._ended = asyncio.Event()
        self._exit_end: int | None = None
        self._awaiting_code: asyncio.Handle | None = None
        self._stderr = b""
        self._group_ended = False

    @property
    def pid(self) -> int | None:
        """Return the child process's id; None before the start."""
        return None if self._process is None else self._process.pid

    @property
    def identity(self) -> ProcessId | None:
        """Return the child's id and start time; None before the start, or if it ended."""
        return self._id

    @property
    def running(self) -> bool:
        """Return whether the child process runs."""
        return self._process is not None and not self._ended.is_set()

    @property
    def exit_code(self) -> int | None:
        """Return the child's exit code, negative by a signal; None while it lives."""
        return None if self._process is None else self._process.returncode

    @property
    def stderr_tail(self) -> str:
        """Return the end of the child's stderr."""
        lines = self._stderr.decode(errors="replace").splitlines()[-_TAIL_LINES:]
        return "\n".join(line.rstrip() for line in lines)[-_TAIL_BYTES:]

    def start(self, on_end: Callable[["ChildProcess"], None] | None = None) -> None:
        """Start the child; `on_end` is called once at its end. Raises OSError.

        Call it in the main thread: Linux sends the parent-death signal when the thread that
        started the child ends.
        """
        own_output = subprocess.DEVNULL if self._output is None else self._output
        self._process = subprocess.Popen(  # noqa: S603 - the program that was asked for
            self._argv,
            bufsize=0,
            stdin=subprocess.DEVNULL if self._stdin is None else self._stdin,
            stdout=own_output,
            stderr=subprocess.PIPE if self._output is None else self._output,
            env=self._environment,
            cwd=self._folder,
            pass_fds=self._inherited,
            start_new_session=True,
        )
        self._watch(self._process, on_end)

    async def start_by(
        self, server: ForkServer | None, on_end: Callable[["ChildProcess"], None] | None = None
    ) -> None:
        """Start the child by a fork server if that forks its program, else as `start` does.

        Its parent is that server, which a parent-death signal would be about. Raises OSError.
        """
        process = None
        if server is not None and server.forks(self._argv):
            process = await self._fork(server)
        if process is None:
            self.start(on_end)
            return
        self._process = process
        self._watch(process, on_end)
        try:
            process.go()
        except OSError:
            self._signal(signal.SIGKILL)
            self._forget()
            raise

    async def _fork(self, server: ForkServer) -> ForkedProcess | None:
        """Return the child forked by a server; None where that cannot."""
        with contextlib.ExitStack() as stack:
            empty = os.open(os.devnull, os.O_RDWR)
            stack.callback(os.close, empty)
            stderr: io.FileIO | None = None
            output = self._output
            if output is None:
                reading, output = os.pipe()
                stack.callback(os.close, output)
                stderr = io.FileIO(reading, "rb")  # `release` closes it
            process = await server.fork(
                self._argv,
                environment=os.environ if self._environment is None else self._environment,
                streams=(
                    empty if self._stdin is None else self._stdin,
                    empty if self._output is None else self._output,
                    output,
                ),
                inherited=self._inherited,
                stderr=stderr,
            )
            if process is None and stderr is not None:
                stderr.close()
        return process

    def _watch(
        self,
        process: subprocess.Popen[bytes] | ForkedProcess,
        on_end: Callable[["ChildProcess"], None] | None,
    ) -> None:
        loop = asyncio.get_running_loop()
        self._on_end = on_end
        self._id = ProcessId.of(process.pid)
        if process.stderr is not None:
            os.set_blocking(process.stderr.fileno(), False)
            loop.add_reader(process.stderr.fileno(), self._read_stderr)
        try:
            self._exit_end = exit_descriptor(process.pid)
        except OSError:
            process.kill()
            process.wait()
            self._forget()
            raise
        loop.add_reader(self._exit_end, self._on_exit)

    async def wait(self, timeout_s: float | None = None) -> int | None:
        """Wait for the child's end; return its exit code, None after `timeout_s`."""
        with contextlib.suppress(TimeoutError):
            async with wall_timeout(timeout_s):
                await self._ended.wait()
        return self.exit_code

    async def end(self) -> None:
        """End the child and its descendants: SIGTERM, and after the grace period SIGKILL."""
        if self._process is None or self._group_ended:
            return
        try:
            self._signal(signal.SIGTERM)
            if not await self._all_gone(self._grace_s):
                self._signal(signal.SIGKILL)
                await self._all_gone(_KILL_GRACE_S)
            await self._ended.wait()
        except asyncio.CancelledError:
            # No process may survive a cancellation of this wait.
            self.kill()
            raise
        self._group_ended = True
        self.release()

    def kill(self) -> None:
        """Kill the child and its descendants now; `end` still has to be called."""
        self._signal(signal.SIGKILL)

    def release(self) -> None:
        """Stop watching the child; a running one is not ended."""
        loop = asyncio.get_running_loop()
        if isinstance(self._process, ForkedProcess):
            self._await_no_code(self._process)
        if self._exit_end is not None:
            loop.remove_reader(self._exit_end)
            os.close(self._exit_end)
            self._exit_end = None
        if self._process is not None and self._process.stderr is not None:
            loop.remove_reader(self._process.stderr.fileno())
            self._process.stderr.close()
            self._process.stderr = None

    def _forget(self) -> None:
        """Count a child that was started and cannot be watched as ended: nobody may wait for it."""
        self.release()
        self._ended.set()
        self._group_ended = True

    def _signal(self, number: signal.Signals) -> None:
        if self._process is not None and not self._group_ended:
            # The group, and its number, outlive their leader while a process of the group lives.
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)

    async def _all_gone(self, within_s: float) -> bool:
        """Return whether every process of the child's group ends within a time.

        A virtual clock holds meanwhile: how fast a process ends is a matter of the machine.
        """
        loop = asyncio.get_running_loop()
        if isinstance(loop, VirtualLoop):
            return await loop.run_in_executor(None, self._await_gone, within_s)
        with contextlib.suppress(TimeoutError):
            async with wall_timeout(within_s):
                await self._ended.wait()
                while self.pid is not None and process_group_lives(self.pid):  # noqa: ASYNC110 - theirs
                    await asyncio.sleep(_POLL_S)
                return True
        return False

    def _await_gone(self, within_s: float) -> bool:
        """Wait in a thread for the end of the child's group, which the loop reaps."""
        until_s = time.monotonic() + within_s
        while self.running or (self.pid is not None and process_group_lives(self.pid)):
            if time.monotonic() >= until_s:
                return False
            time.sleep(_POLL_S)
        return True

    def _on_exit(self) -> None:
        """Reap the child, or await its exit code (called by the loop when it has ended)."""
        process = self._process
        if process is None or self._exit_end is None:
            return
        if process.poll() is None:
            if not isinstance(process, ForkedProcess):
                return
            loop = asyncio.get_running_loop()
            loop.remove_reader(self._exit_end)
            loop.add_reader(process.fileno(), self._reap_forked)
            self._awaiting_code = call_wall_later(_CODE_S, self._reap_forked)
            return
        self._reap()

    def _reap_forked(self) -> None:
        """Reap a forked child: its exit code has come, or its server is too slow."""
        process = self._process
        if isinstance(process, ForkedProcess):
            self._await_no_code(process)
            if process.poll() is None:
                process.give_up()
        self._reap()

    def _await_no_code(self, process: ForkedProcess) -> None:
        """Stop waiting for the exit code of a forked child."""
        if self._awaiting_code is not None:
            asyncio.get_running_loop().remove_reader(process.fileno())
            self._awaiting_code.cancel()
            self._awaiting_code = None

    def _reap(self) -> None:
        """Take note of the child's end."""
        if self._exit_end is None:
            return
        asyncio.get_running_loop().remove_reader(self._exit_end)
        os.close(self._exit_end)
        self._exit_end = None
        self._read_stderr()
        self._ended.set()
        if self._on_end is not None:
            self._on_end(self)

    def _read_stderr(self) -> None:
        """Read the child's stderr, so that its pipe stays empty; keep the end."""
        stderr = None if self._process is None else self._process.stderr
        while self._process is not None and stderr is not None:
            try:
                data = os.read(stderr.fileno(), _READ_BYTES)
            except BlockingIOError:
                return
            if not data:
                asyncio.get_running_loop().remove_reader(stderr.fileno())
                stderr.close()
                self._process.stderr = None
                return
            self._stderr = (self._stderr + data)[-2 * _TAIL_BYTES :]


async def run_briefly(argv: Sequence[str], *, timeout_s: float = 10.0) -> None:
    """Run a child command for its effect, for a limited time. Raises OSError."""
    child = ChildProcess(argv=argv)
    child.start()
    try:
        await child.wait(timeout_s)
    finally:
        await child.end()


def exit_status_text(code: int | None) -> str:
    """Return in words how a child process ended; code: negative by a signal."""
    if code is None:
        return "ended"
    if code >= 0:
        return f"ended with exit code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"
