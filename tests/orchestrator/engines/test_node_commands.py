"""Commands on a node: to its run, and an abort past the run to its guard."""

import asyncio
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import pytest

from orchestrator.engines import node_process
from orchestrator.engines.node_messages import CommandSent, encode_to_node
from orchestrator.engines.node_process import NodeRuns
from orchestrator.operator import local_commands
from orchestrator.operator.campaign_records import Place, Places
from safety.guard.core.operator_command import OperatorCommand


class SilentWorker:
    """A worker whose run hangs: it takes commands and does nothing about them."""

    def __init__(self) -> None:
        self.commands: list[OperatorCommand] = []
        self.is_killed = False

    def kill(self) -> None:
        self.is_killed = True

    def send(self, command: OperatorCommand) -> None:
        self.commands.append(command)


async def test_an_abort_goes_past_a_run_that_hangs_to_its_guard_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, other = tmp_path / "hover/1/default/sim/1", tmp_path / "hover/1/default/sim/2"
    guards = tuple(Place("guard", folder, folder / "socket") for folder in (run, other))
    told: list[tuple[Path, str, str]] = []
    monkeypatch.setattr(local_commands, "places", lambda: Places((), guards))
    monkeypatch.setattr(
        local_commands, "tell", lambda path, command, *, who: told.append((path, command, who))
    )
    commands, sender = Pipe()
    reports, _ = Pipe()
    worker: Any = SilentWorker()
    passing = asyncio.create_task(NodeRuns(commands, reports, tmp_path)._pass_commands(worker, run))
    sender.send_bytes(encode_to_node(CommandSent(OperatorCommand("hold", "anna"))))
    sender.send_bytes(encode_to_node(CommandSent(OperatorCommand("abort", "ben"))))
    async with asyncio.timeout(10):
        while not told:  # noqa: ASYNC110 - sets no event
            await asyncio.sleep(0.01)
    assert told == [(run / "socket", "abort", "ben")]
    assert not worker.is_killed
    monkeypatch.setattr(node_process, "_LANDED_S", 0.05)
    sender.close()  # the cluster is gone
    await passing
    assert worker.is_killed  # so that nothing is left on the node; its guard has the vehicles
    assert [(one.kind, one.who) for one in worker.commands] == [
        ("hold", "anna"),
        ("abort", "ben"),
        ("abort", "the node: its cluster is gone"),
    ]
