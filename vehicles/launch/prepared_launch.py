"""A prepared launch of a simulator: its folder, instance and command, all reserved."""

import asyncio
from pathlib import Path
from typing import Self

from wil_campaign.vehicles.launch.instances import Instance, take_instance
from wil_campaign.vehicles.launch.launch_plan import Launch, LaunchError, LaunchPlan
from wil_campaign.vehicles.launch.launch_records import RECORD, LaunchRecord
from wil_campaign.vehicles.launch.simulator_output import Output
from wil_campaign.vehicles.processes.child import run_briefly
from wil_campaign.vehicles.processes.identity import ProcessId, boot_id
from wil_campaign.vehicles.processes.supervisor import supervised
from wil_campaign.vehicles.tasks import finish

_POLL_S = 0.05


class PreparedLaunch:
    """Reserves what a simulator's launch needs; a context manager that releases it.

    folder: its scratch folder, which is created; its output goes to `output.txt` there. Raises
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
                f"{launch.label}: cannot create its folder {folder}: {error.strerror}"
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

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def output(self) -> Path:
        """Return the file with the launched simulator's output."""
        return self.folder / "output.txt"

    def command(self, *, parent: int, grace_s: float) -> tuple[str, ...]:
        """Return the command that launches it under a supervisor; arguments: see there."""
        # The supervisor truncates it; until then readers find an empty file.
        self.output.touch()
        return supervised(self.plan.argv, parent=parent, grace_s=grace_s, folder=str(self.folder))

    def note(self, pid: int) -> None:
        """Record that it is launched, so that orphans are found; pid: of its supervisor."""
        LaunchRecord(
            label=self.plan.label,
            folder=str(self.folder),
            supervisor=ProcessId.of(pid) or ProcessId(pid, 0),
            owner=ProcessId.own(),
            boot_id=boot_id(),
            command=self.plan.argv,
            cleanup=self.plan.cleanup,
        ).write()

    async def until_ready(self, end: "asyncio.Future[int | None]", *, ready_s: float) -> None:
        """Wait until the simulator reports ready. Raises LaunchError with its output.

        end: done when its process has ended, with the exit code.
        """
        plan, output, complaints = self.plan, Output(self.output), list[str]()
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + ready_s
        while True:
            gone = end.done()
            for line in output.new_lines(ended=gone):
                if any(mark in line for mark in plan.fatal):
                    raise LaunchError(f"{plan.label} does not start: {line}{self.where()}")
                if any(mark in line for mark in plan.ready):
                    return
                if any(mark in line for mark in plan.complaints):
                    complaints.append(line)
            if gone:
                raise self.died(end.result(), output)
            if loop.time() >= deadline_s:
                printed = "; ".join(complaints) or output.last_output or "it printed nothing"
                raise LaunchError(
                    f"{plan.label} is not ready after {ready_s:g} s: {printed}{self.where()}"
                )
            # Until the next poll, or the simulator's end.
            await asyncio.wait({end}, timeout=_POLL_S)

    def died(self, exit_code: int | None, output: Output | None = None) -> LaunchError:
        """Return the error of a launched simulator that ended, with its last output."""
        if output is None:
            output = Output(self.output)
            output.new_lines(ended=True)
        last_output = output.last_output or "it printed nothing"
        how = f"exit code {exit_code}"
        if exit_code is not None and exit_code > 128:
            how = f"signal {exit_code - 128}"
        return LaunchError(
            f"{self.plan.label} ended with {how}; it last printed:\n{last_output}\n{self.where()}"
        )

    def where(self) -> str:
        """Return in words where the launched simulator's output is."""
        return f" (its whole output is in {self.output})"

    async def clean_up(self) -> None:
        """Remove what remains of an ended simulator."""
        if self.plan.cleanup:
            # Cut off, it would leave what it removes: a container that flies on.
            await finish(run_briefly(self.plan.cleanup), name="clean up")
        (self.folder / RECORD).unlink(missing_ok=True)

    def close(self) -> None:
        """Release the launch's instance."""
        self._instance.close()
