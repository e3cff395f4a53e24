"""A program of the user's starts with a run and ends with it, whatever it does."""

import asyncio
import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.foundation.processes import limited_log
from wil_campaign.plugins.programs.autonomy_program import (
    ExternalAutonomy,
    ExternalAutonomyError,
    ProgramExit,
    autonomy_environment,
)


def environment() -> dict[str, str]:
    return autonomy_environment(
        {"PATH": os.environ["PATH"]},
        mavlink_url="udpout://127.0.0.1:14540",
        video_url="rtp://127.0.0.1:5600",
        goal={"altitude_m": 1.2, "gates": ["gate"]},
    )


def program(code: str, tmp_path: Path, **more: Any) -> ExternalAutonomy:
    return ExternalAutonomy(
        command=[sys.executable, "-S", "-c", code],
        environment=environment(),
        log_path=tmp_path / "autonomy.log",
        **more,
    )


async def line_of(tmp_path: Path, count: int) -> list[str]:
    for _ in range(6000):
        lines = (tmp_path / "autonomy.log").read_text().splitlines()
        if len(lines) >= count:
            return lines
        await asyncio.sleep(0.01)
    pytest.fail("the program wrote nothing")


def runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


async def test_it_gets_where_to_fly_and_see_and_its_log_is_kept(tmp_path: Path) -> None:
    code = (
        "import os, sys\n"
        "for k in ('MAVLINK_URL', 'VIDEO_URL', 'GOAL'): print(os.environ['WIL_' + k])\n"
        "print('to stderr', file=sys.stderr)"
    )
    async with program(code, tmp_path) as running:
        ended = await running.ended()
    lines = (tmp_path / "autonomy.log").read_text().splitlines()
    assert lines[:2] == ["udpout://127.0.0.1:14540", "rtp://127.0.0.1:5600"]
    assert json.loads(lines[2]) == {"altitude_m": 1.2, "gates": ["gate"]}
    assert lines[3] == "to stderr"
    assert ended.code == 0
    assert not ended.crashed
    assert running.exit is not None
    assert "to stderr" in running.exit.tail


async def test_a_program_that_prints_much_fills_no_disk_and_its_end_is_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, size in (("MOST", 1000), ("HEAD", 300), ("TAIL", 200)):
        monkeypatch.setattr(limited_log, f"_{name}_BYTES", size)
    async with program("print('x\\n' * 5000 + 'the end')", tmp_path) as running:
        await running.ended()
    assert (tmp_path / "autonomy.log").stat().st_size < 600
    assert running.exit is not None
    assert running.exit.tail.endswith("the end")


async def test_a_missing_module_is_reported_with_the_interpreter_that_ran(tmp_path: Path) -> None:
    own = tmp_path / "bin" / "python3"
    own.parent.mkdir()
    own.symlink_to(sys.executable)
    for command in ("python3", "bin/python3"):
        async with ExternalAutonomy(
            command=[command, "-S", "-c", "import nothing_such"],
            environment={**environment(), "PATH": str(own.parent)},
            log_path=tmp_path / "autonomy.log",
            folder=tmp_path,
        ) as running:
            ended = await running.ended()
        assert "No module named 'nothing_such'" in ended.tail
        assert ended.tail.endswith(f"; it was run by {own}")


async def test_a_crash_is_reported_with_its_output(tmp_path: Path) -> None:
    async with program("raise RuntimeError('no gate in sight')", tmp_path) as running:
        ended = await running.ended()
    assert ended.crashed
    assert ended.code == 1
    assert "no gate in sight" in ended.tail
    assert str(running.exit) == "ended by itself, exit code 1"


async def test_it_ends_on_term_when_the_run_is_over(tmp_path: Path) -> None:
    code = "import time; print('up'); time.sleep(60)"
    async with program(code, tmp_path) as running:
        await line_of(tmp_path, 1)
        assert running.running
    assert running.exit == ProgramExit(None, "SIGTERM", ended_by_us=True, tail="up")
    assert not running.exit.crashed


async def test_a_program_that_ignores_term_is_killed_with_its_children(tmp_path: Path) -> None:
    code = (
        "import os, signal, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "child = os.fork()\n"
        "print(os.getpid(), flush=True)\n"
        "time.sleep(60)"
    )
    async with program(code, tmp_path, term_grace_s=0.2) as running:
        pids = [int(line) for line in await line_of(tmp_path, 2)]
        assert all(runs(pid) for pid in pids)
    assert running.exit is not None
    assert running.exit.signal == "SIGKILL"
    assert not any(runs(pid) for pid in pids)


async def test_children_end_also_when_the_program_ended_before(tmp_path: Path) -> None:
    code = "import os, time\nif os.fork() == 0:\n  print(os.getpid(), flush=True); time.sleep(60)"
    async with program(code, tmp_path) as running:
        ended = await running.ended()
        (pid,) = (int(line) for line in await line_of(tmp_path, 1))
        assert runs(pid)
    assert ended.code == 0
    assert not runs(pid)


async def test_it_ends_also_when_the_run_is_cancelled(tmp_path: Path) -> None:
    started = asyncio.Event()
    pids: list[int] = []

    async def run() -> None:
        code = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
        async with program(code, tmp_path):
            pids.extend(int(line) for line in await line_of(tmp_path, 1))
            started.set()
            await asyncio.sleep(60)

    task = asyncio.create_task(run(), name="run")
    await started.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not runs(pids[0])


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["./no_such_program"], "no_such_program"),
        (["{folder}/plain.txt"], "is executable"),
        ([], "empty"),
    ],
)
async def test_a_program_that_cannot_be_started_is_an_error_in_words(
    command: list[str], words: str, tmp_path: Path
) -> None:
    (tmp_path / "plain.txt").write_text("no program")
    filled = [part.format(folder=tmp_path) for part in command]
    with pytest.raises(ExternalAutonomyError, match=words):
        async with ExternalAutonomy(
            command=filled, environment=environment(), log_path=tmp_path / "log"
        ):
            pass


def test_a_goal_that_is_no_json_is_refused() -> None:
    with pytest.raises(ValueError, match="JSON"):
        autonomy_environment({}, mavlink_url="", video_url="", goal={"x": float("nan")})
