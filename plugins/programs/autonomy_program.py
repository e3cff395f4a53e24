"""The process of an autonomy that is a user's program: started with a run, and ended with it.

The program flies by MAVLink and receives video, as on the vehicle; its environment has the
addresses. It runs in its own process group, so that all processes it starts end with it. Wall clock
only.
"""

import json
import signal
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import psutil

from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.foundation.processes.last_output import last_output, output_with_interpreter
from wil_campaign.foundation.processes.limited_log import limited_log
from wil_campaign.foundation.processes.process_memory import resident_mb
from wil_campaign.vehicles.errors import VehicleError

_TERM_GRACE_S = 3.0


class ExternalAutonomyError(VehicleError):
    """The autonomy program cannot be started; says which, and the remedy."""


@dataclass(frozen=True, slots=True)
class ProgramExit:
    """The autonomy program's exit. code: None when a signal ended it. signal: its name.

    ended_by_us: it still ran when the run was over. tail: what it printed last, in a line.
    """

    code: int | None
    signal: str | None
    ended_by_us: bool
    tail: str

    @property
    def crashed(self) -> bool:
        """Return whether the autonomy program failed by itself: a verdict of FAIL."""
        return not self.ended_by_us and self.code != 0

    def __str__(self) -> str:
        how = f"exit code {self.code}" if self.signal is None else f"signal {self.signal}"
        return f"ended with the run ({how})" if self.ended_by_us else f"ended by itself, {how}"


def autonomy_environment(
    base: Mapping[str, str],
    *,
    mavlink_url: str,
    video_url: str,
    goal: Mapping[str, object],
    parameters: Mapping[str, object] | None = None,
    vehicle: str = "real",
    system_id: int = 1,
    seed: int = 0,
) -> dict[str, str]:
    """Return the environment variables of the autonomy program.

    WIL_MAVLINK_URL: link string of the vehicle. WIL_VIDEO_URL: stream, or SDP file, of what it
    perceives. WIL_GOAL, WIL_PARAMETERS: the campaign's goal, and the values under `with`, as
    JSON. WIL_VEHICLE: real or twin. WIL_SYSTEM_ID: its MAVLink system. WIL_SEED: of the run.
    PYTHONUNBUFFERED, so that the log of a Python program that is killed is not lost.
    """
    return {
        "PYTHONUNBUFFERED": "1",
        **base,
        "WIL_MAVLINK_URL": mavlink_url,
        "WIL_VIDEO_URL": video_url,
        "WIL_GOAL": json.dumps(dict(goal), allow_nan=False),
        "WIL_PARAMETERS": json.dumps(dict(parameters or {}), allow_nan=False),
        "WIL_VEHICLE": vehicle,
        "WIL_SYSTEM_ID": str(system_id),
        "WIL_SEED": str(seed),
    }


class ExternalAutonomy:
    """Runs an autonomy program while its context is open; an async context manager.

    command: program and arguments; the program is looked up in PATH, or relative to `folder`.
    environment: all of it (see `autonomy_environment`). log_path: receives its stdout and stderr.
    After the context `exit` tells how it ended.
    """

    def __init__(
        self,
        *,
        command: Sequence[str],
        environment: Mapping[str, str],
        log_path: Path,
        folder: Path | None = None,
        term_grace_s: float = _TERM_GRACE_S,
    ) -> None:
        if not command:
            raise ExternalAutonomyError("the command of the autonomy is empty")
        self._command = tuple(command)
        self._environment = dict(environment)
        self._log_path = log_path
        self._folder = folder
        self._term_grace_s = term_grace_s
        self._child: ChildProcess | None = None
        self._log = ExitStack()
        self.exit: ProgramExit | None = None

    async def __aenter__(self) -> Self:
        """Start the autonomy program. Raises ExternalAutonomyError."""
        try:
            with ExitStack() as stack:
                child = ChildProcess(
                    argv=self._command,
                    environment=self._environment,
                    folder=self._folder,
                    output=stack.enter_context(limited_log(self._log_path)),
                    grace_s=self._term_grace_s,
                )
                child.start()
                self._child, self._log = child, stack.pop_all()
        except OSError as error:
            at_fault = error.filename or self._command[0]
            raise ExternalAutonomyError(
                f"the autonomy cannot be started: {at_fault}: {error.strerror}; check the path, "
                "and that the file is executable"
            ) from error
        return self

    async def __aexit__(self, *_: object) -> None:
        """End the autonomy program's process group: SIGTERM, then SIGKILL."""
        child = self._child
        if child is None:
            return
        ended_by_us = child.running
        await child.end()
        self._log.close()
        self.exit = self._make_exit(child.exit_code, ended_by_us=ended_by_us)

    @property
    def running(self) -> bool:
        """Return whether the autonomy program still runs."""
        return self._child is not None and self._child.running

    @property
    def resident_mb(self) -> float:
        """Return the memory of the autonomy program and its descendants, in 10^6 bytes."""
        return sum(map(resident_mb, self._processes()))

    def kill(self) -> None:
        """Kill the autonomy program and its descendants now; leaving the context reaps it."""
        for process in self._processes():
            with suppress(psutil.Error):
                process.kill()

    def _processes(self) -> list[psutil.Process]:
        if self._child is None or self._child.pid is None:
            return []
        try:
            first = psutil.Process(self._child.pid)
            return [first, *first.children(recursive=True)]
        except psutil.Error:
            return []

    async def ended(self) -> ProgramExit:
        """Wait for the autonomy program's own end; a crash fails the run."""
        if self._child is None:
            raise ExternalAutonomyError("the autonomy was not started")
        return self._make_exit(await self._child.wait(), ended_by_us=False)

    def _make_exit(self, returncode: int | None, *, ended_by_us: bool) -> ProgramExit:
        tail = output_with_interpreter(
            last_output(self._log_path),
            self._command,
            environment=self._environment,
            folder=self._folder,
        )
        if returncode is None or returncode >= 0:
            return ProgramExit(returncode, None, ended_by_us, tail)
        try:
            name = signal.Signals(-returncode).name
        except ValueError:
            name = str(-returncode)
        return ProgramExit(None, name, ended_by_us, tail)
