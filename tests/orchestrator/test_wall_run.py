"""A whole flight under the wall clock: the guard and each vehicle are processes of their own."""

import json
import signal
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


async def test_the_operator_holds_and_then_aborts(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", "--json") as program:
        await program.stage("goal", mode="sim")
        held = await program.operate("hold", "--who", "anna")
        assert (held.code, held.out) == (0, "gate: held: 1 run in flight; none is begun\n")
        aborted = await program.operate("abort", str(program.folder), "--who", "anna")
        assert aborted.code == 0
        assert aborted.out.splitlines() == [
            "large/sim/1: all are brought down",
            "gate: what flies lands, and nothing more is flown",
        ]
        landed = await program.end()
        assert list((program.runtime / "wil-campaign").iterdir()) == []
    assert landed.code == 4
    (run,) = json.loads(landed.out)["runs"]
    assert run["verdict"] == "INVALID"
    assert run["reason"].startswith("held by cli:anna after the goal was given")
    assert [(other["verdict"], other["reason"]) for other in run["also"]][:1] == [
        ("ABORTED", "aborted by cli:anna")
    ]
    assert "landed" in stages(program.run_folder("sim"))
    asked = lines(program.folder / "operator.jsonl")
    assert [(line["command"], line["who"]) for line in asked] == [
        ("hold", "cli:anna"),
        ("abort", "cli:anna"),
    ]


async def test_ctrl_c_lands_first(tmp_path: Path) -> None:
    async with Program(tmp_path / "out", "--mode", "wil", "--json") as program:
        await program.stage("takeoff")
        program.process.send_signal(signal.SIGINT)
        landed = await program.end()
    assert landed.code == 130
    (run,) = json.loads(landed.out)["runs"]
    assert (run["verdict"], run["reason"]) == ("ABORTED", "aborted by Ctrl-C")
    assert "landed" in stages(program.run_folder())
