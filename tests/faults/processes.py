"""Seeded kill -9 and SIGSTOP of real processes of a flight under the wall clock.

`python -m tests.faults.processes FIRST COUNT FOLDER` prints one JSON object for each.
"""

import asyncio
import csv
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from safety.guard.leftovers import ProcessId
from tests.faults.virtual import unreadable
from tests.orchestrator.operating.mosquitto import MOSQUITTO, free_port
from tests.orchestrator.outside.test_outside_flights import FLY, drawn_by, sets, simulator
from tests.orchestrator.wall_runs import ROOT, Program, lines, until

VICTIMS = ("orchestrator", "flight", "guard", "real", "twin", "broker", "autonomy", "source")
"""orchestrator: the program itself; flight: its process that flies the run."""
STAGES = ("ready", "takeoff", "at_height", "goal", "land")
_STOPPED_S = 12.0
_STAGE_WITHIN_S = 90.0
_GONE_WITHIN_S = 200.0
_BROKER = """
import asyncio, sys
from campaigns.broker_address import BrokerAddress
from orchestrator.operating.embedded_broker import embedded_broker
async def main():
    async with embedded_broker(BrokerAddress("127.0.0.1", int(sys.argv[1]), embedded=True)):
        await asyncio.Event().wait()
asyncio.run(main())
"""
_VERDICTS = {"PASS", "FAIL", "INVALID", "ERROR", "ABORTED"}


@dataclass(frozen=True, slots=True)
class RealFault:
    """A signal to a process, some time after a stage was entered."""

    seed: int
    victim: str
    signal: str
    stage: str
    after_s: float


@dataclass(frozen=True, slots=True)
class RealAftermath:
    """What came of it; verdict: None where nobody was left to write one."""

    fault: RealFault
    verdict: str | None
    reason: str
    exit_code: int | None
    lost: tuple[str, ...]


def draw(seed: int) -> RealFault:
    """Return the fault of a seed."""
    rng = np.random.default_rng([seed, 22])
    return RealFault(
        seed=seed,
        victim=VICTIMS[seed % len(VICTIMS)],
        signal="SIGSTOP" if seed // len(VICTIMS) % 2 else "SIGKILL",
        stage=STAGES[int(rng.integers(len(STAGES)))],
        after_s=round(float(rng.uniform(0.0, 3.0)), 2),
    )


async def inject(fault: RealFault, folder: Path) -> RealAftermath:
    """Fly a run, hit a process of it, and return what came of it; the folder is there."""
    async with surroundings(fault, folder) as around:
        arguments = ("--mode", "wil", "--json", *around.arguments)
        async with Program(folder / "out", *arguments) as program:
            await program.stage(fault.stage, timeout_s=_STAGE_WITHIN_S)
            await asyncio.sleep(fault.after_s)
            pids = {**_pids(program), **around.pids}
            victim = pids.get(fault.victim)
            if victim is not None:
                os.kill(victim.pid, getattr(signal, fault.signal))
            if victim is not None and fault.signal == "SIGSTOP":
                await asyncio.sleep(_STOPPED_S)
                if victim.lives:
                    os.kill(victim.pid, signal.SIGCONT)
            lost = await _all_gone(pids, fault)
            code = program.process.returncode
            if code is None and "the program" not in " ".join(lost):
                code = (await program.end(30.0)).code
            return _aftermath(fault, program, code, lost)


@dataclass(frozen=True, slots=True)
class Around:
    """What a campaign has outside. arguments: that make it use it; pids: that are not its own."""

    arguments: tuple[str, ...] = ()
    pids: Mapping[str, ProcessId] = field(default_factory=dict)


@asynccontextmanager
async def surroundings(fault: RealFault, folder: Path) -> AsyncIterator[Around]:
    """Start what a victim outside of the campaign is."""
    if fault.victim == "broker":
        port = free_port()
        with broker_process(port) as process:
            yield Around(("--broker", f"mqtt://127.0.0.1:{port}"), _named("broker", process.pid))
    elif fault.victim == "source":
        async with simulator() as (address, process):
            yield Around(sets(drawn_by(address, 700)), _named("source", process.pid))
    elif fault.victim == "autonomy":
        script = folder / "pilot_program.py"
        script.write_text(textwrap.dedent(FLY))
        command = json.dumps([sys.executable, str(script)])
        yield Around(sets(f"autonomy={{program: {command}}}"))
    else:
        yield Around()


@contextmanager
def broker_process(port: int) -> Iterator["subprocess.Popen[bytes]"]:
    """Run a broker that lets everybody in: mosquitto, or what we embed where there is none."""
    if MOSQUITTO is not None:
        words = [MOSQUITTO, "-p", str(port)]
    else:
        words = [sys.executable, "-c", _BROKER, str(port)]
    with subprocess.Popen(words, cwd=ROOT, stderr=subprocess.DEVNULL) as process:  # noqa: S603
        try:
            for _ in range(500):
                with socket.socket() as one:
                    if one.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.02)
            yield process
        finally:
            process.kill()


def _named(name: str, pid: int) -> dict[str, ProcessId]:
    known = ProcessId.of(pid)
    return {} if known is None else {name: known}


def _pids(program: Program) -> dict[str, ProcessId]:
    """Return the processes of a flight by what they are."""
    found = {"orchestrator": program.process.pid}
    journal = lines(program.run_folder() / "guard.jsonl")
    for line in journal:
        if line["event"] == "opened":
            found["guard"] = line["pid"]
        elif line["event"] == "started":
            found[line["vehicle"]] = line["pid"]
    for pid in _all_pids():
        known = _parent_and_words(pid)
        if known is None:
            continue
        parent, words = known
        if parent == program.process.pid and "spawn_main" in words:
            found["flight"] = pid
    flight = found.get("flight")
    for pid in _all_pids():
        known = _parent_and_words(pid)
        if known is not None and known[0] == flight and "pilot_program" in known[1]:
            found.setdefault("autonomy", pid)
    return {name: one for name, pid in found.items() if (one := ProcessId.of(pid)) is not None}


def _all_pids() -> list[int]:
    return [int(one.name) for one in Path("/proc").iterdir() if one.name.isdecimal()]


def _parent_and_words(pid: int) -> tuple[int, str] | None:
    try:
        fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
        words = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except (OSError, UnicodeDecodeError):
        return None
    return int(fields[1]), words


async def _all_gone(pids: dict[str, ProcessId], fault: RealFault) -> list[str]:
    """Wait until no process of the flight is left; return who is."""
    ours = {name: one for name, one in pids.items() if name not in {"broker", "source"}}
    try:
        await until(lambda: not any(one.lives for one in ours.values()), _GONE_WITHIN_S)
    except TimeoutError:
        return [f"{name} lives still" for name, one in ours.items() if one.lives]
    return []


def _aftermath(
    fault: RealFault, program: Program, code: int | None, lost: list[str]
) -> RealAftermath:
    folder = program.run_folder()
    lost += unreadable(folder)
    try:
        json.loads((program.folder / "summary.json").read_text("utf-8"))
    except (OSError, ValueError) as error:
        lost.append(f"summary.json: {error}")
    verdict, reason = None, ""
    if (folder / "result.json").exists():
        result = json.loads((folder / "result.json").read_text("utf-8"))
        verdict, reason = result["verdict"], result["reason"]
    elif fault.victim not in {"orchestrator", "flight"}:
        lost.append("no result.json")
    harmless = fault.victim == "broker" or (
        fault.victim == "orchestrator" and fault.signal == "SIGSTOP"
    )
    stages = [line["stage"] for line in lines(folder / "log.jsonl") if line["event"] == "stage"]
    if verdict == "PASS" and not (harmless or "done" in stages):
        lost.append("PASS of a flight that was not completed")
    if verdict is not None and verdict not in _VERDICTS:
        lost.append(f"verdict {verdict}")
    lost += _not_down(folder, fault)
    return RealAftermath(fault, verdict, reason, code, tuple(lost))


def _not_down(folder: Path, fault: RealFault) -> list[str]:
    """Return which vehicles were last seen armed by whoever was left to see them."""
    seen: dict[str, bool] = {}
    for row in csv.DictReader((folder / "trajectory.csv").read_text("utf-8").splitlines()):
        if row["armed"] in {"0", "1"}:
            seen[row["vehicle"]] = row["armed"] == "1"
    down = {
        line["vehicle"]
        for line in lines(folder / "guard.jsonl")
        if line["event"] == "guard" and line.get("kind") == "action" and ": down:" in line["text"]
    }
    return [
        f"{name} was last seen armed"
        for name, armed in seen.items()
        if armed and name not in down and name != fault.victim
    ]


def main(arguments: list[str]) -> None:
    first, count = int(arguments[0]), int(arguments[1])
    folder = Path(arguments[2])
    for seed in range(first, first + count):
        own = folder / f"real-{seed}"
        own.mkdir(parents=True)
        aftermath = asyncio.run(inject(draw(seed), own))
        sys.stdout.write(json.dumps(asdict(aftermath)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
