"""A simulated autopilot that runs: started, awaited, watched, and ended for certain."""

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from vehicles.launch.instances import Instance, take_instance
from vehicles.launch.output import Output
from vehicles.launch.plan import Launch, LaunchError, LaunchPlan
from vehicles.launch.records import RECORD, LaunchRecord, boot_id, key_of, own_key
from vehicles.links.parse import LinkAddress

_KEEPER = Path(__file__).with_name("keeper.py")
_LOOK_S = 0.05
_GRACE_S = 3.0
"""How long it may take to write its logs after SIGTERM."""
_KEEPER_GRACE_S = 3.0
_CLEANUP_S = 10.0


class LaunchedVehicle:
    """A simulator of its own, as an async context manager; wall clock only.

    folder: becomes its scratch folder, made new; its output goes to `output.txt` there. ready_s:
    how long it may take to start. It runs in a session of its own under a keeper, so that it ends
    when this process does, however. on_end: called when it ends while it should run.
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
        self._instance: Instance | None = None
        self._plan: LaunchPlan | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._watch: asyncio.Task[None] | None = None

    @property
    def link(self) -> LinkAddress:
        """Return the address of the link to it. Raises LaunchError before it runs."""
        if self._plan is None:
            raise LaunchError(f"{self._launch.label}: it was not started yet")
        return self._plan.link

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
        self._launch.check()
        try:
            self._folder.mkdir(parents=True)
        except OSError as error:
            raise LaunchError(
                f"{self._launch.label}: scratch folder {self._folder}: {error.strerror}"
            ) from error
        self._instance = take_instance(self._launch, locks=self._locks)
        try:
            plan = self._launch.plan(
                instance=self._instance.number, system_id=self._system_id, folder=self._folder
            )
            self._plan = plan
            self._process = process = await self._start(plan)
            await self._until_ready(plan, process)
        except BaseException:
            await self._end()
            raise
        self._watch = asyncio.create_task(self._wait(plan, process), name=f"end of {plan.label}")
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End it and all that it started: SIGTERM, then SIGKILL."""
        if self._watch is not None:
            self._watch.cancel()
            await asyncio.wait({self._watch})
            self._watch = None
        await self._end()

    async def _start(self, plan: LaunchPlan) -> asyncio.subprocess.Process:
        with self.output.open("wb") as output:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-S",
                str(_KEEPER),
                str(os.getpid()),
                f"{_GRACE_S:g}",
                *plan.argv,
                cwd=self._folder,
                stdin=asyncio.subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env={**os.environ, **plan.environment},
                start_new_session=True,
            )
        record = LaunchRecord(
            label=plan.label,
            folder=str(self._folder),
            keeper=key_of(process.pid),
            owner=own_key(),
            boot_id=boot_id(),
            command=plan.argv,
            cleanup=plan.cleanup,
        )
        record.write()
        return process

    async def _until_ready(self, plan: LaunchPlan, process: asyncio.subprocess.Process) -> None:
        output, complaints = Output(self.output), list[str]()
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._ready_s
        while True:
            ended = process.returncode is not None
            for line in output.new_lines(ended=ended):
                if any(mark in line for mark in plan.fatal):
                    raise LaunchError(f"{plan.label} does not start: {line}{self._where()}")
                if any(mark in line for mark in plan.ready):
                    return
                if any(mark in line for mark in plan.complaints):
                    complaints.append(line)
            if ended:
                raise LaunchError(_died(plan, process.returncode, output) + self._where())
            if loop.time() >= deadline_s:
                said = "; ".join(complaints) or output.last_words or "it printed nothing"
                raise LaunchError(
                    f"{plan.label} is not ready after {self._ready_s:g} s: {said}{self._where()}"
                )
            # Whichever comes first: the next look, or its end.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_S):
                    await process.wait()

    async def _wait(self, plan: LaunchPlan, process: asyncio.subprocess.Process) -> None:
        await process.wait()
        output = Output(self.output)
        output.new_lines(ended=True)
        if self._on_end is not None:
            self._on_end(LaunchError(_died(plan, process.returncode, output) + self._where()))

    async def _end(self) -> None:
        process, plan = self._process, self._plan
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
        if plan is not None and process is not None and plan.cleanup:
            await _run(plan.cleanup)
        (self._folder / RECORD).unlink(missing_ok=True)
        if self._instance is not None:
            self._instance.close()
            self._instance = None

    def _where(self) -> str:
        return f" (all that it printed is in {self.output})"


def _died(plan: LaunchPlan, code: int | None, output: Output) -> str:
    words = output.last_words or "it printed nothing"
    how = f"signal {code - 128}" if code is not None and code > 128 else f"exit code {code}"
    return f"{plan.label} ended with {how}; it last printed:\n{words}\n"


async def _run(argv: tuple[str, ...]) -> None:
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
