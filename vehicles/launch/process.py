"""A simulated autopilot that runs: started, awaited, watched, and ended for certain."""

import asyncio
import contextlib
import os
import signal
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from vehicles.launch.plan import Launch, LaunchError
from vehicles.launch.prepared import Ended, PreparedLaunch, environment_of
from vehicles.links.parse import LinkAddress

_GRACE_S = 3.0
"""How long it may take to write its logs after SIGTERM."""
_KEEPER_GRACE_S = 3.0
_CLEANUP_S = 10.0


class LaunchedVehicle:
    """A simulator of its own, as an async context manager; wall clock only.

    folder: see PreparedLaunch. ready_s: how long it may take to start. It runs in a session of
    its own under a keeper, so that it ends when this process does, however. on_end: called when it
    ends while it should run.
    """

    def __init__(
        self,
        *,
        launch: Launch,
        folder: Path,
        system_id: int,
        ready_s: float = 30.0,
        locks: Path | None = None,
        on_end: Callable[[LaunchError], None] | None = None,
    ) -> None:
        self._launch = launch
        self._folder = folder
        self._system_id = system_id
        self._ready_s = ready_s
        self._locks = locks
        self._on_end = on_end
        self._prepared: PreparedLaunch | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._watch: asyncio.Task[None] | None = None
        self._running = False

    @property
    def link(self) -> LinkAddress:
        """Return the address of the link to it. Raises LaunchError before it runs."""
        if self._prepared is None:
            raise LaunchError(f"{self._launch.label}: it was not started yet")
        return self._prepared.plan.link

    @property
    def pid(self) -> int | None:
        """Return the process id of its keeper; None before the start."""
        return None if self._process is None else self._process.pid

    @property
    def output(self) -> Path:
        """Return the file that holds what it printed."""
        return self._folder / "output.txt"

    async def __aenter__(self) -> Self:
        """Start it and wait until it is ready.

        Raises LaunchError when something is missing, it dies, prints a fatal error, or is not
        ready in time: with its last lines.
        """
        self._prepared = prepared = PreparedLaunch(
            launch=self._launch, folder=self._folder, system_id=self._system_id, locks=self._locks
        )
        try:
            process, ended = await self._start(prepared), Ended()
            name = f"end of {prepared.plan.label}"
            self._watch = asyncio.create_task(self._wait(prepared, process, ended), name=name)
            await prepared.until_ready(ended, ready_s=self._ready_s)
        except BaseException:
            await self._end(prepared)
            raise
        self._running = True
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End it and all that it started: SIGTERM, then SIGKILL."""
        self._running = False
        if self._prepared is not None:
            await self._end(self._prepared)

    async def _start(self, prepared: PreparedLaunch) -> asyncio.subprocess.Process:
        self._process = process = await asyncio.create_subprocess_exec(
            *prepared.kept(parent=os.getpid(), grace_s=_GRACE_S),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
            env=environment_of(prepared.plan),
            start_new_session=True,
        )
        prepared.note(process.pid)
        return process

    async def _wait(
        self, prepared: PreparedLaunch, process: asyncio.subprocess.Process, ended: Ended
    ) -> None:
        await process.wait()
        ended.tell(process.returncode)
        if self._running and self._on_end is not None:
            self._on_end(prepared.died(process.returncode))

    async def _end(self, prepared: PreparedLaunch) -> None:
        if self._watch is not None:
            self._watch.cancel()
            await asyncio.wait({self._watch})
            self._watch = None
        process = self._process
        if process is not None and process.returncode is None:
            process.send_signal(signal.SIGTERM)
            try:
                async with asyncio.timeout(_GRACE_S + _KEEPER_GRACE_S):
                    await process.wait()
            except TimeoutError:
                # The keeper itself hangs: its session goes as a whole.
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                await process.wait()
        if process is not None:
            await prepared.clean_up(run_briefly)
        prepared.close()


async def run_briefly(argv: tuple[str, ...]) -> None:
    """Run a command for its effect, for a limited time."""
    process = await asyncio.create_subprocess_exec(
        *argv,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        async with asyncio.timeout(_CLEANUP_S):
            await process.wait()
    except TimeoutError:
        process.kill()
        await process.wait()
