"""A whole flight under the wall clock: the guard and each vehicle are processes of their own."""

import json
from pathlib import Path
from typing import Any

from pymavlink import mavutil

from safety.guard.leftovers import ProcessId
from tests.orchestrator.wall_runs import Program, lines, stages


def kinds(log: Path) -> set[tuple[str, int]]:
    """Return which messages of whom a .tlog holds."""
    link: Any = mavutil.mavlink_connection(str(log))
    found = set()
    while (message := link.recv_match()) is not None:
        found.add((message.get_type(), message.get_srcSystem()))
    link.close()
    return found


async def test_the_pair_flies_through_the_guards_process(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", "--mode", "wil", "--json") as program:
        landed = await program.end()
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert (landed.code, landed.err) == (0, "")
    summary = json.loads(landed.out)
    assert [(run["verdict"], run["reason"]) for run in summary["runs"]] == [("PASS", "")]
    assert summary["clock"] == "wall"
    folder = program.run_folder()
    assert stages(folder)[-2:] == ["landed", "end"]
    journal = lines(folder / "guard.jsonl")
    assert journal[-1]["event"] == "end"
    assert [line["vehicle"] for line in journal if line["event"] == "started"] == ["real", "twin"]
    pids = [line["pid"] for line in journal if line["event"] in {"opened", "started"}]
    assert [ProcessId.of(pid) for pid in pids] == [None] * 3
    for name, system in (("real", 1), ("twin", 2)):
        assert {("HEARTBEAT", system), ("COMMAND_LONG", 245)} <= kinds(folder / f"{name}.tlog")
