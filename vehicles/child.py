"""A process that is started for a vehicle, and ended for certain."""

import asyncio
import contextlib
import os
import signal
from collections import deque
from collections.abc import Callable, Mapping, Sequence

_END_S = 3.0
_TAIL_LINES = 20
_TAIL_BYTES = 4000


class ChildProcess:
    """A program in a session of its own, so that Ctrl-C does not reach it.

    lifeline: a file descriptor that becomes its stdin: its end of file says that all who could
    need the program are gone. environment is added to this process's own.
    """

    def __init__(
        self, *, argv: Sequence[str], lifeline: int, environment: Mapping[str, str] | None = None
    ) -> None:
        self._argv = tuple(argv)
        self._lifeline = lifeline
        self._environment = dict(environment or {})
        self._process: asyncio.subprocess.Process | None = None
        self._watch: asyncio.Task[None] | None = None
        self._tail: deque[str] = deque(maxlen=_TAIL_LINES)

    @property
    def pid(self) -> int | None:
        """Return the process id; None before the start."""
        return None if self._process is None else self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Return how it ended, negative by a signal; None while it lives."""
        return None if self._process is None else self._process.returncode

    @property
    def last_words(self) -> str:
        """Return the end of what it wrote to stderr."""
        return "\n".join(self._tail)[-_TAIL_BYTES:]

    async def start(self, on_end: Callable[["ChildProcess"], None]) -> None:
        """Start it; `on_end` is called once when it has ended. Raises OSError."""
        self._process = await asyncio.create_subprocess_exec(
            *self._argv,
            stdin=self._lifeline,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, **self._environment},
            start_new_session=True,
        )
        name = f"child {self._process.pid}"
        self._watch = asyncio.create_task(self._until_end(self._process, on_end), name=name)

    async def end(self) -> None:
        """End it and all that it started: SIGTERM, then SIGKILL."""
        if self._process is None or self._watch is None:
            return
        if self._process.returncode is None:
            self._signal(signal.SIGTERM)
            await asyncio.wait([self._watch], timeout=_END_S)
        # What it started has its process group; a group that is gone is no trouble.
        self._signal(signal.SIGKILL)
        await asyncio.wait([self._watch])

    def kill(self) -> None:
        """Kill it and all that it started, now; it is still to be ended."""
        self._signal(signal.SIGKILL)

    def _signal(self, number: signal.Signals) -> None:
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)

    async def _until_end(
        self, process: asyncio.subprocess.Process, on_end: Callable[["ChildProcess"], None]
    ) -> None:
        if process.stderr is not None:
            async for line in process.stderr:
                self._tail.append(line.decode(errors="replace").rstrip())
        await process.wait()
        on_end(self)
