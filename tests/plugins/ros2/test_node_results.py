"""The result of a node has its topics; that of a program has the fields that it always had."""

import asyncio
import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.reading.flown_campaign import Flight
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.foundation.processes import limited_log
from wil_campaign.orchestrator.run_results.result_parts import (
    ExternalResult,
    ProgramResult,
    TopicResult,
)
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.plugins.ros2.node_process import started_node


def test_results_of_nodes_and_of_programs_are_read_as_they_were_written(tmp_path: Path) -> None:
    ended = "ended with exit code 0 by itself"
    program = ProgramResult("twin", ended, 0)
    topic = TopicResult("/odom", "nav_msgs/msg/Odometry", "out", 9, 8)
    outside = ExternalResult(programs=(replace(program, topics=(topic,)), program))
    result = replace(Flight(case="default", mode="sim", rep=1).result(), outside=outside)
    path = tmp_path / "result.json"
    path.write_text(to_json(result))
    assert read_result(path) == result
    written = json.loads(path.read_text())["outside"]["programs"]
    assert written[0]["topics"][0]["delivered"] == 8
    assert [*written[1]] == ["vehicle", "exit", "refused", "trouble", "video"]


async def test_a_node_without_a_module_names_the_interpreter_that_ran(tmp_path: Path) -> None:
    own = tmp_path / "python3"
    own.symlink_to(sys.executable)
    ended = asyncio.Event()
    async with started_node(
        ["python3", "-S", "-c", "import nothing_such"],
        environment={**os.environ, "PATH": str(tmp_path)},
        folder=tmp_path,
        log=tmp_path / "node.log",
        on_end=ended.set,
    ) as node:
        await ended.wait()
        assert node.last_lines().endswith(f"; it was run by {own}")


async def test_a_node_that_prints_much_fills_no_disk_and_its_last_lines_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, size in (("MOST", 1000), ("HEAD", 300), ("TAIL", 200)):
        monkeypatch.setattr(limited_log, f"_{name}_BYTES", size)
    ended, log = asyncio.Event(), tmp_path / "node.log"
    async with started_node(
        [sys.executable, "-S", "-c", "print('x\\n' * 5000 + 'the end')"],
        environment=os.environ,
        folder=tmp_path,
        log=log,
        on_end=ended.set,
    ) as node:
        await ended.wait()
    assert log.stat().st_size < 600
    assert node.last_lines().endswith("the end")
