"""Flights on the scaled clock: real processes, several times as fast as the wall's clock."""

import asyncio
import json
import os
import signal
import time
from pathlib import Path

import pytest

from tests.orchestrator.sitl_programs import make_arducopter
from tests.orchestrator.wall_runs import SHORT, STAYING, Program, lines, stages
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.orchestrator.cli import main

PACE = ("--mode", "sim", "--set", "clock.speed=4", "--json")


async def test_a_flight_at_four_times_real_time(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", *PACE, clock="scaled") as program:
        landed = await program.end()
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert landed.code == 0, landed.why
    summary = json.loads(landed.out)
    (run,) = summary["runs"]
    assert (summary["clock"], run["verdict"]) == ("scaled", "PASS")
    folder = program.run_folder("sim")
    assert stages(folder)[-2:] == ["landed", "end"]
    (pace,) = [line for line in lines(folder / "guard.jsonl") if line["event"] == "paced"]
    # A loaded machine attains less, and a starved one not even real time; the flight is as long by
    # its own clock. Who ignores the speed comes to real time, where the machine does.
    assert 0.0 < pace["times_real_time"] <= 4.1
    assert pace["times_real_time"] not in {0.99, 1.0}
    assert 10.0 < run["duration_s"] < 40.0


async def test_a_launched_simulator_leads_at_the_pace_that_it_attains(tmp_path: Path) -> None:
    launch = f"{{launch: ardupilot, binary: {make_arducopter(tmp_path)}, speedup: 5}}"
    sets = ("--set", "vehicles.twin.autopilot=ardupilot", "--set", f"vehicles.twin.link={launch}")
    async with Program(
        tmp_path / "out", "--mode", "sim", "--json", *sets, *SHORT, clock=None
    ) as program:
        landed = await program.end()
    assert landed.code == 0, landed.why
    summary = json.loads(landed.out)
    assert (summary["clock"], summary["runs"][0]["verdict"]) == ("scaled", "PASS")
    folder = program.run_folder("sim")
    asked = (folder / "twin-sitl" / "output.txt").read_text().splitlines()
    assert "asked for 5 times real time" in asked
    journal = lines(folder / "guard.jsonl")
    (pace,) = [one["times_real_time"] for one in journal if one["event"] == "paced"]
    assert 0.0 < pace < 4.7  # it reaches nine tenths of what it is asked for, if the machine does


@pytest.mark.no_turn("lockstep")
async def test_a_simulation_that_stands_still_ends_the_run(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", *PACE, *STAYING, clock="scaled") as program:
        await program.stage("goal", mode="sim")
        journal = lines(program.run_folder("sim") / "guard.jsonl")
        (pid,) = [one["pid"] for one in journal if one["event"] == "started"]
        os.kill(pid, signal.SIGSTOP)
        began_s = time.monotonic()
        landed = await program.end()
        took_s = time.monotonic() - began_s
    assert landed.code == 3, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "ERROR"
    assert run["reason"].startswith("the simulation of twin hangs: its time has not advanced")
    assert 5.0 <= took_s < 100.0
    assert ProcessId.of(pid) is None


@pytest.mark.no_turn("lockstep")
async def test_an_orchestrator_that_is_killed_leaves_vehicles_that_land(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", *PACE, *STAYING, clock="scaled") as program:
        await program.stage("goal", mode="sim")
        folder = program.run_folder("sim")
        guard = next(line["pid"] for line in lines(folder / "guard.jsonl") if "pid" in line)
        os.killpg(program.process.pid, signal.SIGKILL)
        async with asyncio.timeout(200.0):
            while ProcessId.of(guard) is not None:  # noqa: ASYNC110 - another's process
                await asyncio.sleep(0.05)
    told = [line.get("text", "") for line in lines(folder / "guard.jsonl")]
    assert "twin: down: it is disarmed" in told


@pytest.mark.no_turn("flies nothing")
@pytest.mark.parametrize(
    ("options", "said"),
    [
        ((), "--clock scaled needs a pace: `clock: {speed: 4}`"),
        (
            (
                *("--set", "clock.speed=4", "--set", "vehicles.real.pose_source=mavlink"),
                *("--set", "vehicles.real.link=udpin://127.0.0.1:14540"),
            ),
            "real is attached and flies in real time",
        ),
        (
            ("--set", "clock.speed=4", "--set", "autonomy={program: [/bin/cat]}"),
            "the program /bin/cat runs in real time: use --clock wall",
        ),
        (("--set", "clock.speed=0"), "must be greater than 0"),
    ],
)
def test_a_campaign_that_cannot_follow_the_scaled_clock_is_refused(
    options: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    words = ["run", "campaigns/gate.yaml", "--clock", "scaled", "--out", str(tmp_path), *options]
    assert main(words) == 2
    assert said in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
