"""A simulator that can be started: its folder, its instance and what to start, all taken."""

import asyncio
import contextlib
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from vehicles.launch.instances import Instance, take_instance
from vehicles.launch.output import Output
from vehicles.launch.plan import Launch, LaunchError, LaunchPlan
from vehicles.launch.records import RECORD, LaunchRecord, boot_id, key_of, own_key

_KEEPER = Path(__file__).with_name("keeper.py")
_LOOK_S = 0.05


class PreparedLaunch:
    """Takes what a simulator needs, as a context manager; closing gives it back.

    folder: becomes its scratch folder, made new; its output goes to `output.txt` there. Raises
    LaunchError when something is missing, before anything is started.
    """

    def __init__(
        self, *, launch: Launch, folder: Path, system_id: int, locks: Path | None = None
    ) -> None:
        launch.check()
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise LaunchError(
                f"{launch.label}: scratch folder {folder}: {error.strerror}"
            ) from error
        self.folder = folder
        self._instance: Instance = take_instance(launch, locks=locks)
        try:
            self.plan: LaunchPlan = launch.plan(
                instance=self._instance.number, system_id=system_id, folder=folder
            )
            for name, content in self.plan.files.items():
                (folder / name).write_text(content, encoding="utf-8")
        except BaseException:
            self._instance.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def output(self) -> Path:
        """Return the file that holds what it printed."""
        return self.folder / "output.txt"

    def kept(self, *, parent: int, grace_s: float) -> tuple[str, ...]:
        """Return the command that starts it under a keeper.

        parent: the process id of who runs the command, whose death ends it; 0 for the end of its
        stdin instead. grace_s: how long it may take to end.
        """
        # The keeper opens it anew; who looks for it before that finds it empty.
        self.output.touch()
        keeper = (sys.executable, "-S", str(_KEEPER), str(parent), f"{grace_s:g}")
        return (*keeper, str(self.folder), *self.plan.argv)

    def note(self, pid: int) -> None:
        """Write down that it runs, for who finds it left over."""
        LaunchRecord(
            label=self.plan.label,
            folder=str(self.folder),
            keeper=key_of(pid),
            owner=own_key(),
            boot_id=boot_id(),
            command=self.plan.argv,
            cleanup=self.plan.cleanup,
        ).write()

    async def until_ready(self, ended: "Ended", *, ready_s: float) -> None:
        """Wait until it says that it runs. Raises LaunchError with its last lines."""
        plan, output, complaints = self.plan, Output(self.output), list[str]()
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + ready_s
        while True:
            gone = ended.ended
            for line in output.new_lines(ended=gone):
                if any(mark in line for mark in plan.fatal):
                    raise LaunchError(f"{plan.label} does not start: {line}{self.where()}")
                if any(mark in line for mark in plan.ready):
                    return
                if any(mark in line for mark in plan.complaints):
                    complaints.append(line)
            if gone:
                raise self.died(ended.exit_code, output)
            if loop.time() >= deadline_s:
                said = "; ".join(complaints) or output.last_words or "it printed nothing"
                raise LaunchError(
                    f"{plan.label} is not ready after {ready_s:g} s: {said}{self.where()}"
                )
            # Whichever comes first: the next look, or its end.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_S):
                    await ended.wait()

    def died(self, exit_code: int | None, output: Output | None = None) -> LaunchError:
        """Return the error of one that ended, with what it printed last."""
        if output is None:
            output = Output(self.output)
            output.new_lines(ended=True)
        words = output.last_words or "it printed nothing"
        code = exit_code
        how = f"signal {code - 128}" if code is not None and code > 128 else f"exit code {code}"
        return LaunchError(
            f"{self.plan.label} ended with {how}; it last printed:\n{words}\n{self.where()}"
        )

    def where(self) -> str:
        """Return in words where all is that it printed."""
        return f" (all that it printed is in {self.output})"

    async def clean_up(self, run: Callable[[tuple[str, ...]], Awaitable[None]]) -> None:
        """Remove what remains of one that has ended."""
        if self.plan.cleanup:
            await run(self.plan.cleanup)
        (self.folder / RECORD).unlink(missing_ok=True)

    def close(self) -> None:
        """Give the instance back."""
        self._instance.close()


class Ended:
    """Whether a process has ended, and how; its owner tells."""

    def __init__(self) -> None:
        self.exit_code: int | None = None
        self._event = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Return whether it has."""
        return self._event.is_set()

    def tell(self, exit_code: int | None) -> None:
        """Take that it has."""
        self.exit_code = exit_code
        self._event.set()

    async def wait(self) -> None:
        """Wait for its end."""
        await self._event.wait()


def environment_of(plan: LaunchPlan) -> dict[str, str]:
    """Return the environment that a program is started with."""
    return {**os.environ, **plan.environment}
