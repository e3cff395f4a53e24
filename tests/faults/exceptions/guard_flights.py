"""Two fake vehicles under a guard in its own process, with an exception on either side of it."""

import asyncio
import json
import os
import pickle
import shutil
import tempfile
import time
from base64 import b64encode
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from unittest import mock

from tests.faults.exceptions.injection import (
    InjectingWallLoop,
    Injection,
    Point,
    Probe,
    protocols_pass_by,
)
from tests.safety.guard.remote_rigs import ROOT, SYSTEMS, RemoteFlight, until, words
from wil_campaign.foundation.processes.child import ChildProcess
from wil_campaign.foundation.tasks import TaskAccount
from wil_campaign.orchestrator.state.faults import InternalFaults, fault_log
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import AnchorAt, BringDown, NewFences, OperatorAction
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_socket import POINTER
from wil_campaign.safety.guard.process import guard_launch
from wil_campaign.vehicles.errors import VehicleError

Side = Literal["guard", "orchestrator"]
_WIDE = Fence.box(north_m=(-9, 9), east_m=(-9, 9), up_m=(-1, 6))
_DOWN_S = 20.0
_STDERR = "guard.stderr"


@dataclass(slots=True)
class GuardOutcome:
    """What came of a flight. logged: the errors in log.jsonl and guard.jsonl, and what the guard
    wrote to stderr; last: of each vehicle that was started, its last line.
    """

    counts: dict[Point, int] = field(default_factory=dict)
    happened: bool = False
    reported: list[str] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    logged: list[str] = field(default_factory=list)
    last: dict[str, str] = field(default_factory=dict)

    @property
    def faults(self) -> list[str]:
        """Return what must not be after an exception of ours."""
        if not self.happened:
            return []
        found = [f"{name}: {line}" for name, line in self.last.items() if not _is_down(line)]
        if not any("injected at" in text for text in self.reported):
            found.append(f"the run is not told: {self.reported}")
        if not any("injected at" in text and "Traceback" in text for text in self.logged):
            found.append("no type, message and traceback in a log")
        return found


class GuardFlights:
    """Flies again and again in folders beneath `folder`; `side`: in which process is raised."""

    def __init__(self, folder: Path, side: Side) -> None:
        self._folder = folder
        self._side = side

    def fly(self, injection: Injection | None = None) -> GuardOutcome:
        """Fly, with an exception or undisturbed."""
        folder = Path(tempfile.mkdtemp(dir=self._folder))
        (run := folder / "run").mkdir()
        here = Probe(injection if self._side == "orchestrator" else None)
        there = injection if self._side == "guard" else None
        asked = {
            "injection": b64encode(pickle.dumps(there)).decode(),
            "counts": str(folder / "counts"),
        }
        outcome = GuardOutcome()
        with ExitStack() as stack:
            stack.enter_context(
                mock.patch.dict(
                    os.environ,
                    {
                        "XDG_RUNTIME_DIR": str(folder),
                        "PYTHONPATH": str(ROOT),
                        "WIL_PROBE": json.dumps(asked),
                    },
                )
            )
            stack.enter_context(mock.patch.object(guard_launch, "ChildProcess", _instrumented))
            if self._side == "orchestrator":
                stack.enter_context(protocols_pass_by(here))
            with asyncio.Runner(loop_factory=lambda: InjectingWallLoop(here)) as runner:
                runner.run(_fly(run, outcome, here))
        outcome.counts, outcome.happened = here.counts, here.raised
        if self._side == "guard":
            counts = folder / "counts"
            # One that was killed wrote none.
            known = pickle.loads(counts.read_bytes()) if counts.exists() else ({}, False)  # noqa: S301
            outcome.counts, outcome.happened = known
        outcome.last = {name: _last_line(run, name) for name in SYSTEMS}
        outcome.logged = _logged(run)
        shutil.rmtree(folder)
        return outcome


def _instrumented(*, argv: tuple[str, ...], **more: Any) -> ChildProcess:
    """Make the guard's process that of `guard_program`."""
    program = "tests.faults.exceptions.guard_program"
    return ChildProcess(
        argv=tuple(
            program if word == "wil_campaign.safety.guard.process" else word for word in argv
        ),
        **more,
    )


async def _fly(folder: Path, outcome: GuardOutcome, probe: Probe) -> None:
    """Be the run: whatever is raised or reported is kept, and nothing else."""
    loop = asyncio.get_running_loop()
    faults = InternalFaults(
        time=time.monotonic,
        log=fault_log(folder / "log.jsonl"),
        take=lambda fault: outcome.reported.append(f"{fault.text}\n{fault.trace}"),
    )

    def unhandled(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        faults.record(
            error if isinstance(error, BaseException) else RuntimeError(str(context)), "?"
        )

    loop.set_exception_handler(unhandled)
    account = TaskAccount(fault=faults.record, expected=(VehicleError, OSError))
    flight = RemoteFlight(folder, lost_s=1.0)

    def event(happened: Any) -> None:
        outcome.events.append(happened.kind)
        if happened.kind == "guard":
            outcome.reported.append(happened.text)

    flight.guard.on_event(event)
    with account.of(loop):
        try:
            async with flight:
                await _in_the_air(folder, flight)
        except BaseException as error:  # noqa: BLE001 - whatever it is, the run is told
            faults.record(error, "the flight")
    probe.injection = None
    await _landed(folder)


async def _in_the_air(folder: Path, flight: RemoteFlight) -> None:
    """Use each way into the guard once."""
    for name in SYSTEMS:
        flight.place(name, 0.0)
        flight.guard.send(AnchorAt(name, (0.0, 0.0, 0.0), 0.0))
    flight.guard.follow()
    flight.guard.send(NewFences("anna", dict.fromkeys(SYSTEMS, _WIDE)))
    path = json.loads((folder / POINTER).read_text())["socket"]
    reader, writer = await asyncio.open_unix_connection(path)
    try:
        for command in ("status", "watch"):
            writer.write(json.dumps({"command": command, "who": "anna"}).encode() + b"\n")
            async with asyncio.timeout(5.0):
                await reader.readline()
    finally:
        writer.close()
    flight.guard.send(OperatorAction(OperatorCommand("hold", "anna")))
    await until(lambda: "operator" in flight.kinds() or bool(flight.kinds()))
    flight.guard.send(BringDown("done"))
    await flight.guard.all_down(10.0)


async def _landed(folder: Path) -> None:
    """Wait until the vehicles have ended: the guard may have gone on by itself."""
    deadline_s = time.monotonic() + _DOWN_S
    while time.monotonic() < deadline_s:
        if all(_is_down(_last_line(folder, name)) for name in SYSTEMS):
            return
        await asyncio.sleep(0.1)


def _is_down(line: str) -> bool:
    """Return whether a vehicle that was ended, or killed once it was down, wrote this last."""
    return "armed=False" in line or line == "DISARM"


def _last_line(folder: Path, name: str) -> str:
    if not (folder / f"{name}.words").exists():
        return "none was started: armed=False"
    # Our heartbeats go on to a vehicle that is down.
    lines = [word for _, word in words(folder, name) if word != "HEARTBEAT"]
    return lines[-1] if lines else "no line yet"


def _logged(folder: Path) -> list[str]:
    found = []
    for name in ("log.jsonl", "guard.jsonl"):
        path = folder / name
        for line in path.read_text().splitlines() if path.exists() else ():
            entry = json.loads(line)
            if entry["event"] == "error":
                found.append(f"{entry['type']}: {entry['message']}\n{entry['trace']}")
    if (folder / _STDERR).exists():
        found.append((folder / _STDERR).read_text())
    return found
