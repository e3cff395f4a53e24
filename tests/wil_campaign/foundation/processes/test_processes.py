"""Processes are known by id and start time, watched, and ended with all that they started."""

import asyncio
import ctypes
import math
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.processes import linux
from wil_campaign.foundation.processes.child import ChildProcess, exit_status_text, run_briefly
from wil_campaign.foundation.processes.identity import ProcessId, process_group_lives

LEAVES_A_CHILD = (
    "import os, sys, time\n"
    "if os.fork() == 0: time.sleep(60)\n"
    "print('no gate in sight', file=sys.stderr, flush=True)\n"
    "sys.exit(3)"
)


def child(code: str, *, grace_s: float = 3.0) -> ChildProcess:
    return ChildProcess(argv=(sys.executable, "-S", "-c", code), grace_s=grace_s)


async def test_a_child_that_cannot_be_watched_is_killed_and_nothing_waits_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(_: int) -> int:
        raise OSError("no such descriptor on this system")

    monkeypatch.setattr("wil_campaign.foundation.processes.child.exit_descriptor", refuse)
    one = child("import time; time.sleep(600)")
    with pytest.raises(OSError, match="no such descriptor"):
        one.start()
    assert not one.running
    async with asyncio.timeout(60):
        await one.wait(30)
        await one.end()
    assert one.pid is not None
    assert not psutil.pid_exists(one.pid)


def test_an_identity_outlives_a_change_of_the_system_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = ProcessId.own()
    booted_s = psutil.boot_time()
    for module in (psutil, psutil._pslinux):
        monkeypatch.setattr(module, "boot_time", lambda: booted_s - 3600.0)
    assert ProcessId.own() == before
    assert before.lives
    assert not ProcessId(before.pid, before.started + 1).lives


async def test_an_end_is_seen_while_a_grandchild_holds_stderr_open() -> None:
    ended = asyncio.Event()
    process = child(LEAVES_A_CHILD)
    process.start(lambda _: ended.set())
    async with asyncio.timeout(20.0):
        await ended.wait()
    assert process.exit_code == 3
    assert process.stderr_tail == "no gate in sight"
    assert exit_status_text(process.exit_code) == "ended with exit code 3"
    pid = process.pid
    assert pid is not None
    assert process_group_lives(pid)
    await process.end()
    assert not process_group_lives(pid)


async def test_a_process_that_ignores_sigterm_is_killed(tmp_path: Path) -> None:
    ready = tmp_path / "ready"
    process = child(
        "import signal, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        f"open({str(ready)!r}, 'w').close()\n"
        "time.sleep(60)",
        grace_s=0.3,
    )
    process.start()
    async with asyncio.timeout(20.0):
        while not ready.exists():  # noqa: ASYNC110 - another process has no event
            await asyncio.sleep(0.02)
    await process.end()
    assert exit_status_text(process.exit_code) == "was ended by SIGKILL"


async def test_a_released_process_goes_on() -> None:
    process = child("import time; time.sleep(60)")
    process.start()
    assert await process.wait(0.05) is None
    known = process.identity
    assert known is not None
    process.release()
    assert known.lives
    process.kill()
    assert process._process is not None
    await asyncio.to_thread(process._process.wait)
    assert not known.lives


def test_functions_of_linux_alone_are_refused_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    for refused in (
        lambda: linux.die_with_parent(signal.SIGTERM),
        linux.adopt_orphans,
        lambda: linux.exit_descriptor(os.getpid()),
    ):
        with pytest.raises(linux.UnsupportedSystemError, match=r"darwin lacks .*--clock virtual"):
            refused()


@pytest.mark.parametrize("granted", ["real-time", "nice -10", "normal"])
def test_a_process_rises_as_far_as_it_may(granted: str, monkeypatch: pytest.MonkeyPatch) -> None:
    policies: list[int] = []

    def schedule(_: int, policy: int, _parameters: os.sched_param) -> None:
        policies.append(policy)
        if granted != "real-time" and policy & os.SCHED_RR:
            raise PermissionError

    def nice(_which: int, _who: int, value: int) -> None:
        if granted == "normal":
            raise PermissionError
        assert value == -10

    monkeypatch.setattr(os, "sched_setscheduler", schedule)
    monkeypatch.setattr(os, "setpriority", nice)
    assert linux.raise_process_priority() == granted
    assert all(policy & os.SCHED_RESET_ON_FORK for policy in policies)


def test_a_child_of_a_risen_process_is_scheduled_normally() -> None:
    show = "import os; print(os.sched_getscheduler(0) & 7, os.nice(0))"
    program = (
        "import os, subprocess, sys\n"
        "from wil_campaign.foundation.processes.linux import raise_process_priority\n"
        "print(raise_process_priority(), os.sched_getscheduler(0) & 7, os.nice(0), flush=True)\n"
        f"subprocess.run([sys.executable, '-c', {show!r}])"
    )
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    mine, its = done.stdout.splitlines()
    ours = os.nice(0)
    assert mine in {
        f"real-time {os.SCHED_RR} {ours}",
        f"nice -10 {os.SCHED_OTHER} -10",
        f"normal {os.SCHED_OTHER} {ours}",
    }
    assert its == f"{os.SCHED_OTHER} {ours if mine.startswith('normal') else 0}"


@pytest.mark.parametrize("may", [False, True])
def test_a_process_that_may_lock_only_some_memory_locks_none(
    may: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a limit that is less than what it needs later, its allocations would fail."""
    limit = resource.RLIM_INFINITY if may else 8 << 20
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    monkeypatch.setattr(linux, "_has_capability", lambda _: False)
    asked: list[int] = []

    def lock(flags: int) -> int:
        asked.append(flags)
        return 0

    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: SimpleNamespace(mlockall=lock))
    assert linux.lock_process_memory() == may
    assert asked == ([7] if may else [])


async def test_a_brief_command_ends_when_its_wait_is_cancelled(tmp_path: Path) -> None:
    written = tmp_path / "pid"
    code = f"import os, time\nopen({str(written)!r}, 'w').write(str(os.getpid()))\ntime.sleep(60)"
    task = asyncio.create_task(run_briefly((sys.executable, "-S", "-c", code)), name="brief")
    async with asyncio.timeout(20.0):
        while not (written.exists() and written.read_text()):  # noqa: ASYNC110 - a file
            await asyncio.sleep(0.02)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert not process_group_lives(int(written.read_text()))


@pytest.mark.parametrize(
    ("own", "files", "cpus"),
    [
        ("0::/\n", {"cpu.max": "150000 100000\n"}, 1.5),
        ("0::/\n", {"cpu.max": "max 100000\n"}, math.inf),
        ("0::/a/b\n", {"a/cpu.max": "200000 100000", "a/b/cpu.max": "max 100000"}, 2.0),
        ("0::/a/b\n", {"a/cpu.max": "max 100000", "a/b/cpu.max": "50000 100000"}, 0.5),
        ("0::/../b\n", {"cpu.max": "300000 100000"}, 3.0),
        (
            "5:memory:/x\n4:cpu,cpuacct:/docker/x\n0::/x\n",
            {
                "cpu,cpuacct/cpu.cfs_quota_us": "400000\n",
                "cpu,cpuacct/cpu.cfs_period_us": "100000\n",
            },
            4.0,
        ),
        ("4:cpu:/x\n", {"cpu/x/cpu.cfs_quota_us": "-1", "cpu/x/cpu.cfs_period_us": "1"}, math.inf),
        ("4:cpu:/x\n", {"cpu/x/cpu.cfs_quota_us": "what", "cpu.max": "1 2"}, math.inf),
        ("nothing of the kind", {}, math.inf),
    ],
)
def test_the_quota_of_a_container_is_read(
    tmp_path: Path, own: str, files: dict[str, str], cpus: float
) -> None:
    for name, text in files.items():
        (tmp_path / "mounted" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "mounted" / name).write_text(text)
    assert linux.cpu_quota(tmp_path / "own", tmp_path / "mounted") == math.inf
    (tmp_path / "own").write_text(own)
    assert linux.cpu_quota(tmp_path / "own", tmp_path / "mounted") == cpus


@pytest.mark.parametrize(("quota", "cores"), [(math.inf, 64), (3.9, 3), (0.2, 1), (99.0, 64)])
def test_cores_that_a_quota_does_not_grant_are_not_used(
    monkeypatch: pytest.MonkeyPatch, quota: float, cores: int
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)))
    monkeypatch.setattr(linux, "cpu_quota", lambda: quota)
    assert linux.usable_cores() == cores


def test_a_virtual_clock_holds_while_a_child_ends_in_its_time() -> None:
    program = (
        "import signal, sys, time\n"
        "def end(*_):\n"
        "    time.sleep(0.3)\n"
        "    sys.exit(7)\n"
        "signal.signal(signal.SIGTERM, end)\n"
        "print('ready', file=sys.stderr, flush=True)\n"
        "time.sleep(60)\n"
    )

    async def run() -> tuple[float, int | None]:
        loop = asyncio.get_running_loop()
        process = child(program)
        process.start()
        while "ready" not in process.stderr_tail:  # noqa: ASYNC110 - it sets no event
            await asyncio.sleep(0.01)
        ticking = asyncio.create_task(_tick())
        began_s = loop.time()
        await process.end()
        ticking.cancel()
        return loop.time() - began_s, process.exit_code

    assert run_virtual(run()) == (0.0, 7)


async def _tick() -> None:
    for _ in range(10**9):
        await asyncio.sleep(0.01)
