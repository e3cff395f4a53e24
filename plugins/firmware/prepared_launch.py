"""A prepared launch of a simulator: its folder, instance and command, all reserved.

Reserves instance numbers of simulators, so that runs on one machine share no port.

Reads a simulator's output from its file, line by line as the file grows.
"""

import asyncio
import errno
import fcntl
import os
import re
import socket
import tempfile
from collections import deque
from pathlib import Path
from typing import Self

from wil_campaign.foundation.processes.child import run_briefly
from wil_campaign.foundation.processes.identity import ProcessId, boot_id
from wil_campaign.foundation.processes.supervisor import supervised_command
from wil_campaign.foundation.tasks import finish_in_task
from wil_campaign.plugins.firmware.launch_plan import LaunchPlan, LaunchPort, PlannedLaunch
from wil_campaign.plugins.firmware.launch_records import RECORD, LaunchRecord
from wil_campaign.vehicles.launch import LaunchError, StartProcess
from wil_campaign.vehicles.links.link_strings import LinkAddress

_TAIL_LINES = 15
_COLOURS = re.compile(rb"\x1b\[[0-9;]*[A-Za-z]")


class SimulatorOutput:
    """A simulator's output: the complete lines of a growing file, without colours."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._offset = 0
        self._rest = b""
        self._tail: deque[str] = deque(maxlen=_TAIL_LINES)

    def new_lines(self, *, ended: bool = False) -> list[str]:
        """Return the simulator's output lines since the last call.

        ended: the simulator has ended, so that an unterminated last line is complete.
        """
        with self._path.open("rb") as file:
            file.seek(self._offset)
            data = file.read()
        self._offset += len(data)
        *whole, self._rest = (self._rest + data).split(b"\n")
        if ended and self._rest:
            whole.append(self._rest)
            self._rest = b""
        lines = [_COLOURS.sub(b"", line).decode(errors="replace").strip() for line in whole]
        lines = [line for line in lines if line]
        self._tail.extend(lines)
        return lines

    @property
    def last_output(self) -> str:
        """Return the last lines of a simulator's output."""
        return "\n".join(self._tail)


class SimulatorInstance:
    """An instance number of one kind of simulator, reserved until it is closed.

    A file lock, which the kernel frees when its holder dies, excludes this user's other runs;
    other programs are detected by their ports.
    """

    def __init__(self, *, number: int, lock: int) -> None:
        self.number = number
        self._lock: int | None = lock

    def close(self) -> None:
        """Release the instance number."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def instance_lock_folder() -> Path:
    """Return the folder of this user's instance locks."""
    return Path(tempfile.gettempdir()) / f"wil-campaign-{os.getuid()}"


def receive_instance(launch: PlannedLaunch, *, locks: Path | None = None) -> SimulatorInstance:
    """Return a free instance of a kind of simulator. Raises LaunchError when there is none."""
    folder = instance_lock_folder() if locks is None else locks
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    stem = "".join(character if character.isalnum() else "-" for character in launch.label.lower())
    taken: list[LaunchPort] = []
    for number in range(launch.instances):
        lock = _lock_instance(folder / f"{stem}-{number}.lock")
        if lock is None:
            continue
        busy = next((port for port in launch.ports(number) if not is_port_free(port)), None)
        if busy is None:
            return SimulatorInstance(number=number, lock=lock)
        os.close(lock)
        taken.append(busy)
    used = ", ".join(f"{port.kind} {port.number}" for port in taken)
    raise LaunchError(
        f"{launch.label}: all {launch.instances} instances are in use"
        + (f" (ports in use by other programs: {used})" if used else "")
        + "; end orphaned simulators"
    )


def is_port_free(port: LaunchPort) -> bool:
    """Return whether an instance's port is not bound; no listener notices."""
    kind = socket.SOCK_STREAM if port.kind == "tcp" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as probe:
        if port.kind == "tcp":
            # As the simulators do: the last run's connections may still linger.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port.number))
        except OSError as error:
            if error.errno in {errno.EADDRINUSE, errno.EACCES}:
                return False
            raise
    return True


def _lock_instance(file: Path) -> int | None:
    handle = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        return None
    return handle


_POLL_S = 0.05
_READY_S = 60.0
"""Start time limit: a loaded machine, or a container image that starts cold."""
_GRACE_S = 2.0
"""How long a simulator may take to end; less than the guard allows its children."""


class PreparedLaunch:
    """Reserves what a simulator's launch needs; a context manager that releases it.

    folder: its scratch folder, which is created; its output goes to `output.txt` there. Raises
    LaunchError when something is missing, before anything is started.
    """

    def __init__(
        self, *, launch: PlannedLaunch, folder: Path, system_id: int, locks: Path | None = None
    ) -> None:
        launch.check()
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise LaunchError(
                f"{launch.label}: cannot create its folder {folder}: {error.strerror}"
            ) from error
        self.folder = folder
        self._instance: SimulatorInstance = receive_instance(launch, locks=locks)
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

    @property
    def link(self) -> LinkAddress:
        """Return the link to the launched simulator."""
        return self.plan.link

    async def start(self, process: StartProcess, end: "asyncio.Future[int | None]") -> None:
        """Start the simulator, and wait until it is ready. Raises LaunchError.

        It lives on the lifeline of guard and orchestrator, not on one of them alone.
        """
        command = self.command(parent=0, grace_s=_GRACE_S)
        self.note(await process(command, dict(self.plan.environment)))
        await self.until_ready(end, ready_s=_READY_S)

    def command(self, *, parent: int, grace_s: float) -> tuple[str, ...]:
        """Return the command that launches it under a supervisor; arguments: see there."""
        # The supervisor truncates it; until then readers find an empty file.
        self.output.touch()
        return supervised_command(
            self.plan.argv, parent=parent, grace_s=grace_s, folder=str(self.folder)
        )

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
        plan, output, complaints = self.plan, SimulatorOutput(self.output), list[str]()
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

    def died(self, exit_code: int | None, output: SimulatorOutput | None = None) -> LaunchError:
        """Return the error of a launched simulator that ended, with its last output."""
        if output is None:
            output = SimulatorOutput(self.output)
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
            await finish_in_task(run_briefly(self.plan.cleanup), name="clean up")
        (self.folder / RECORD).unlink(missing_ok=True)

    def close(self) -> None:
        """Release the launch's instance."""
        self._instance.close()
