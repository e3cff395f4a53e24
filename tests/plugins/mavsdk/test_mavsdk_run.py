"""A pair flown by mavsdk under the wall clock: one process of it dies."""

import json
import os
import signal
from pathlib import Path

from tests.orchestrator.wall_runs import STAYING, Program, lines, stages, until

BY_MAVSDK = ("--set", "vehicles.real.driver=mavsdk", "--set", "vehicles.twin.driver=mavsdk")


def processes(program: Program) -> list[int]:
    """Return the mavsdk processes of a program that flies, by the folder that only it has."""
    mark = f"XDG_RUNTIME_DIR={program.runtime}".encode()
    found = []
    for folder in Path("/proc").iterdir():
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
            ours = mark in (folder / "environ").read_bytes().split(b"\0")
        except OSError:
            continue
        if ours and b"wil_campaign.plugins.mavsdk" in words:
            found.append(int(folder.name))
    return sorted(found)


async def test_mavsdk_dies_in_flight_and_the_guard_lands_both(tmp_path: Path) -> None:
    async with Program(
        tmp_path / "out", "--mode", "wil", "--json", *BY_MAVSDK, *STAYING
    ) as program:
        await program.stage("goal")
        pids = processes(program)
        assert len(pids) == 2, "one instance for each vehicle"
        os.kill(pids[0], signal.SIGKILL)
        landed = await program.end()
        await until(lambda: not processes(program))
    assert landed.code == 3, landed.why
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "ERROR"
    assert "the mavsdk process was ended by SIGKILL; nothing more is sent to it" in run["reason"]
    assert stages(program.run_folder())[-3:] == ["land", "landed", "end"]
    told = [line for line in lines(program.run_folder() / "guard.jsonl") if "kind" in line]
    down = {line["vehicle"] for line in told if line["text"].endswith("down: it is disarmed")}
    assert down == {"real", "twin"}
