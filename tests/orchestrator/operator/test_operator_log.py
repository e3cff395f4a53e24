"""operator.jsonl on a disk that stands still: a pipe that nobody reads."""

import fcntl
import json
import os
import threading
from pathlib import Path

import pytest

from wil_campaign.orchestrator.operator import operator_log
from wil_campaign.orchestrator.operator.operator_log import OperatorLog


def test_a_disk_that_stands_still_delays_one_line_and_gets_all_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "operator.jsonl"
    os.mkfifo(path)
    end = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    # The kernel takes no less than 4096 bytes.
    fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, 4096)
    monkeypatch.setattr(operator_log, "_WRITTEN_WITHIN_S", 0.01)
    waits: list[float | None] = []
    join = threading.Thread.join

    def count(thread: threading.Thread, timeout: float | None = None) -> None:
        waits.append(timeout)
        join(thread, timeout)

    monkeypatch.setattr(threading.Thread, "join", count)
    log = OperatorLog(path=path)
    log.refused("x" * 5000)
    for number in range(50):
        log.note(f"line {number}")
    assert waits == [0.01]
    monkeypatch.setattr(operator_log, "_CLOSED_WITHIN_S", 0.01)
    assert log.close() == 51
    monkeypatch.undo()
    assert log._writer is not None
    os.set_blocking(end, True)
    data = b""
    while data.count(b"\n") < 51:
        data += os.read(end, 65536)
    os.close(end)
    assert log.close() == 0
    texts = [json.loads(line)["text"] for line in data.splitlines()]
    assert texts[1:] == [f"line {k}" for k in range(50)]


def test_a_line_is_written_before_the_command_goes_on(tmp_path: Path) -> None:
    log = OperatorLog(path=tmp_path / "operator.jsonl")
    for number in range(20):
        log.note(f"\ud800 {number}")
        lines = (tmp_path / "operator.jsonl").read_text("utf-8").splitlines()
        assert len(lines) == number + 1
    log.note("still here")
    (tmp_path / "operator.jsonl").unlink()
    gone = OperatorLog(path=tmp_path / "gone" / "operator.jsonl")
    gone.note("lost, and no error")
    assert (log.close(), gone.close()) == (0, 1)
