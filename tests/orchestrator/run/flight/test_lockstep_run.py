"""Flights on the scaled clock whose processes are late, hang, or whose vehicles say what is wrong.

Time waits for whoever is late, so that a starved machine makes no flight red; what is wrong with a
flight shows all the same.
"""

import asyncio
import contextlib
import json
import os
import signal
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.relay import Position
from tests.orchestrator.conftest import STEP, NoCommands
from tests.orchestrator.wall_runs import (
    PATIENT,
    ROOT,
    SHORT,
    STAYING,
    Landed,
    Program,
    lines,
    until,
)
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.clocks.sim_clock_controller import STALL_S
from wil_campaign.orchestrator.run.flight.run import fly_one_run
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.safety.guard.process.channel_link import ChannelLink
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

PACE = ("--set", "clock.speed=4", "--json")
pytestmark = pytest.mark.no_turn("lockstep")
LOCAL_POSITION_NED: int = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED


def guard_of(folder: Path) -> list[dict[str, object]]:
    path = folder / "guard.jsonl"
    return lines(path) if path.exists() else []


def pid_of(folder: Path, event: str) -> int:
    return next(int(str(one["pid"])) for one in guard_of(folder) if one["event"] == event)


def parent_of(pid: int) -> int:
    """Return the process that started another: of the guard, the one that flies the run."""
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


@contextlib.asynccontextmanager
async def stopped_at_random(pids: list[int], seed: int) -> AsyncIterator[list[int]]:
    """Stop one process after the other for 50 to 500 ms, as a scheduler with others to serve."""
    rng, stopped = np.random.default_rng(seed), list[int]()

    async def stop() -> None:
        while True:
            await asyncio.sleep(rng.uniform(0.1, 0.6))
            pid = int(rng.choice(pids))
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGSTOP)
                try:
                    await asyncio.sleep(rng.uniform(0.05, 0.5))
                finally:
                    os.kill(pid, signal.SIGCONT)
                stopped.append(pid)

    task = asyncio.create_task(stop())
    try:
        yield stopped
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def landed_of(program: Program, mode: str, seed: int) -> tuple[Landed, int]:
    """Stop the processes of a run at random from its arming on; return how often, and its end."""
    await program.stage("arm", mode=mode)
    folder = program.run_folder(mode)
    guard = pid_of(folder, "opened")
    vehicles = [int(str(one["pid"])) for one in guard_of(folder) if one["event"] == "started"]
    async with stopped_at_random([parent_of(guard), guard, *vehicles], seed) as stopped:
        landed = await program.end()
    return landed, len(stopped)


@pytest.mark.parametrize(("mode", "options"), [("sim", ()), ("wil", SHORT)])
async def test_processes_that_are_late_make_a_flight_slow_and_not_red(
    tmp_path: Path, mode: str, options: tuple[str, ...]
) -> None:
    arguments = ("--mode", mode, *PACE, *options)
    async with Program(tmp_path / "out", *arguments, clock="scaled") as program:
        landed, stops = await landed_of(program, mode, seed=1)
        journal = guard_of(program.run_folder(mode))
    assert landed.code == 0, landed.why
    assert stops > 4
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "PASS"
    (pace,) = [one["times_real_time"] for one in journal if one["event"] == "paced"]
    assert float(str(pace)) < 3.9


async def hanging(program: Program) -> tuple[Path, int]:
    """Have the process that flies a run hang; return the run's folder and the process."""
    await program.stage("goal", mode="sim")
    folder = program.run_folder("sim")
    flight = parent_of(pid_of(folder, "opened"))
    os.kill(flight, signal.SIGSTOP)
    return folder, flight


def kinds_of(folder: Path) -> list[object]:
    return [one.get("kind") for one in guard_of(folder) if one["event"] == "guard"]


def is_down(folder: Path) -> Callable[[], bool]:
    return lambda: "twin: down: it is disarmed" in [one.get("text") for one in guard_of(folder)]


async def test_an_orchestrator_that_hangs_has_its_vehicles_landed(tmp_path: Path) -> None:
    arguments = ("--mode", "sim", *PACE, *STAYING)
    async with Program(tmp_path / "out", *arguments, clock="scaled") as program:
        folder, flight = await hanging(program)
        began_s = time.monotonic()
        await until(is_down(folder), 120.0)
        took_s = time.monotonic() - began_s
        os.kill(flight, signal.SIGCONT)
        landed = await program.end()
    assert took_s >= STALL_S
    assert "silence" in kinds_of(folder)
    assert landed.code != 0, landed.why


async def test_an_abort_needs_no_orchestrator_and_does_not_wait_for_one(tmp_path: Path) -> None:
    arguments = ("--mode", "sim", *PACE, *STAYING)
    async with Program(tmp_path / "out", *arguments, clock="scaled") as program:
        folder, flight = await hanging(program)
        try:
            aborted = await program.operate("abort", str(program.folder), "--who", "anna")
            kinds = kinds_of(folder)
            await until(is_down(folder), 120.0)
        finally:
            os.kill(flight, signal.SIGCONT)
        landed = await program.end()
    # The guard obeys before it gives up who hangs; that the run does not answer is said.
    assert "action" in kinds
    assert aborted.code == 3, aborted.err
    assert "not acknowledged within 5 s by large/sim/1" in aborted.err
    latches = [kind for kind in kinds_of(folder) if kind in {"abort", "silence"}]
    assert latches[0] == "abort"
    assert landed.code == 4, landed.why


Alter = Callable[[Position], tuple[float, ...]]


def jumping(position: Position) -> tuple[float, ...]:
    north_m, *others = position.values
    return north_m + 0.4, *others


def frozen() -> Alter:
    first: list[Position] = []

    def alter(position: Position) -> tuple[float, ...]:
        first.append(position)
        return first[0].values

    return alter


def fly_altered(
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    alter: Alter = lambda position: position.values,
) -> RunResult:
    """Fly a short flight; from two seconds after its liftoff on, positions come altered."""
    splitter, high = FrameSplitter(), list[int]()
    arrive = ChannelLink.arrive

    def altered(self: ChannelLink, data: bytes, t_s: float) -> None:
        out: list[bytes] = []
        for frame in splitter.feed(data):
            raw = frame.raw
            if frame.message_id == LOCAL_POSITION_NED:
                position = Position.of(frame)
                if position.values[2] < -0.3:
                    high.append(position.boot_ms)
                if high and position.boot_ms > high[0] + 2000:
                    raw = Position(position.boot_ms, alter(position)).in_place_of(frame)
            out.append(raw)
        arrive(self, b"".join(out), t_s)

    monkeypatch.setattr(ChannelLink, "arrive", altered)
    sets = (*PATIENT, *STEP, "controls={}", "clock.speed=4")
    options = ExpansionOptions(cases=("large",), modes=("sim",), sets=sets)
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    folder.mkdir()
    setup = RunSetup.of(RunOrder(plan=plan, folder=folder, clock="scaled"))
    return fly_one_run(setup, lambda _: None, NoCommands())


def test_an_estimate_that_jumps_proves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = fly_altered(monkeypatch, tmp_path / "run", jumping)
    assert result.verdict == "INVALID", result.reason
    assert result.reason.startswith("pose of twin from mavlink: it moved "), result.reason


def test_an_estimate_that_freezes_proves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = fly_altered(monkeypatch, tmp_path / "run", frozen())
    assert result.verdict == "INVALID", result.reason
    assert result.reason.startswith("pose of twin from mavlink: it "), result.reason


def test_an_unaltered_flight_passes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = fly_altered(monkeypatch, tmp_path / "run")
    assert result.verdict == "PASS", result.reason
