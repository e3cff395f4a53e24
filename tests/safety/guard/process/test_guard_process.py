import asyncio
import fcntl
import json
import logging
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink import mavutil

from tests.safety.guard.remote_rigs import (
    LOST_S,
    ROOT,
    SILENT_S,
    RemoteFlight,
    guard_config,
    log_lines,
    start_orchestrator,
    until,
    words,
)
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.processes.identity import ProcessId
from wil_campaign.plugins.doctor.machine import granted_to_guard
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import AnchorAt, BringDown, NewFences, OperatorAction
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import GuardEvent, decisive_guard_event
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.operator.operator_socket import POINTER
from wil_campaign.safety.guard.process import guard_process, guard_stderr
from wil_campaign.safety.guard.process.guard_process import GuardProcess
from wil_campaign.safety.guard.process.guard_stderr import logging_in_thread
from wil_campaign.safety.guard.process.orphaned_processes import guard_records, reap_orphans
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.safety.guard.process.runtime_folder import open_runtime_folder
from wil_campaign.vehicles.links.link import LinkError

RR = os.SCHED_RR
TOKEN = "of the test"  # noqa: S105 - opens nothing
LOGS_TO_ITS_END = """
import logging, sys
from wil_campaign.safety.guard.process.guard_stderr import logging_in_thread
with logging_in_thread():
    for _ in range(100):
        logging.getLogger("of a link").warning("." * 10_000)
sys.exit(7)
"""


@pytest.fixture(autouse=True)
def runtime(short_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Keep records and sockets of tests apart from those of whoever flies on this machine."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    return short_folder / "wil-campaign"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "run"
    made.mkdir()
    return made


def gone(pid: int) -> bool:
    return ProcessId.of(pid) is None


def locked_kb(pid: int) -> int:
    """Return how much of a process's memory is kept in RAM, by proc(5)."""
    return int(Path(f"/proc/{pid}/status").read_text().partition("VmLck:")[2].split()[0])


async def ask(folder: Path, *commands: dict[str, Any] | bytes) -> list[dict[str, Any]]:
    path = json.loads((folder / POINTER).read_text())["socket"]
    reader, writer = await asyncio.open_unix_connection(path)
    answers = []
    for command in commands:
        line = command if isinstance(command, bytes) else json.dumps(command).encode()
        writer.write(line + b"\n")
        async with asyncio.timeout(30.0):
            answers.append(json.loads(await reader.readline()))
    writer.close()
    await writer.wait_closed()
    return answers


async def test_frames_pass_both_ways_and_are_logged(folder: Path) -> None:
    began_s = asyncio.get_running_loop().time()
    async with RemoteFlight(folder) as flight:
        assert os.getsid(flight.guard.pid) == flight.guard.pid != os.getsid(0)
        await until(lambda: len(flight.wire) >= 2)
        name, t_s, _ = flight.wire[-1]
        assert name in {"real", "twin"}
        assert began_s <= t_s <= asyncio.get_running_loop().time()
        (opened,) = [log_line for log_line in log_lines(folder) if log_line["event"] == "opened"]
        assert (opened["scheduling"], opened["in_memory"]) == granted_to_guard()
        is_first = os.sched_getscheduler(flight.guard.pid) & 7 == RR
        assert is_first == (opened["scheduling"] == "real-time")
        assert (locked_kb(flight.guard.pid) > 10_000) == opened["in_memory"]
        assert all(locked_kb(pid) == 0 for pid in flight.pids.values())
        flight.guard.send(BringDown("done"))
        assert await flight.guard.all_down(60.0)
        assert flight.guard.phases == {"real": ContingencyPhase.DOWN, "twin": ContingencyPhase.DOWN}
    assert gone(flight.guard.pid)
    assert all(map(gone, flight.pids.values()))
    log: Any = mavutil.mavlink_connection(str(folder / "real.tlog"))
    kinds = set()
    while (message := log.recv_match()) is not None:
        kinds.add((message.get_type(), message.get_srcSystem(), message.get_srcComponent()))
    log.close()
    assert {
        ("HEARTBEAT", 1, 1),
        ("COMMAND_LONG", 245, 190),
        ("COMMAND_LONG", 245, 191),
    } <= kinds
    assert not (folder / POINTER).exists()
    assert not (folder / "guard.stderr").exists()


async def test_a_position_outside_of_the_fence_brings_both_down(folder: Path) -> None:
    async with RemoteFlight(folder) as flight:
        flight.place("real", 0.0)
        flight.place("real", 7.0)
        assert await flight.guard.all_down(60.0)
        assert flight.kinds() == ["fence"]
    assert [word for _, word in words(folder, "twin")][-1] == "END armed=False up_m=0.00"


def _last_is(flight: RemoteFlight, kind: str) -> bool:
    return flight.kinds()[-1:] == [kind]


async def test_fences_are_changed_in_flight_all_or_none(folder: Path) -> None:
    wide = Fence.box(north_m=(-9, 9), east_m=(-9, 9), up_m=(-1, 6))
    away = Fence.box(north_m=(20, 30), east_m=(-9, 9), up_m=(-1, 6))
    async with RemoteFlight(folder) as flight:
        for fences, kind in (
            ({"real": wide, "twin": away}, "refused"),
            ({"real": wide}, "geofence"),
        ):
            for name in ("real", "twin"):
                flight.place(name, 0.0)
            flight.guard.send(NewFences("anna", fences))
            await until(partial(_last_is, flight, kind))
        flight.place("real", 4.0)
        flight.place("real", 8.0)
        flight.place("twin", 5.5)
        assert await flight.guard.all_down(60.0)
        assert flight.kinds() == ["refused", "geofence", "fence"]
        (breach,) = [event for event in flight.guard.events if event.kind == "fence"]
        assert breach.vehicle == "twin"


async def test_the_guard_lands_both_after_a_kill_of_the_orchestrator(
    folder: Path, runtime: Path
) -> None:
    program, pids = await start_orchestrator(folder)
    loop = asyncio.get_running_loop()
    killed_s = loop.time()
    program.kill()
    await program.wait()
    await until(lambda: all(gone(pid) for pid in pids.values()))
    for name in ("real", "twin"):
        heard = words(folder, name)
        first_s = min(t_s for t_s, word in heard if word in {"HOLD", "ZERO"} and t_s > killed_s)
        # It was told by the channel's end, not by the silence.
        assert first_s - killed_s < 3.0 < SILENT_S
        assert heard[-1][1] == "END armed=False up_m=0.00"
        assert "FAILSAFE" not in [word for _, word in heard]
    lines = log_lines(folder)
    assert [line["event"] for line in lines].count("ended") == 2
    assert ("guard", "silence") in [(line["event"], line.get("kind")) for line in lines]
    assert lines[-1]["event"] == "end"
    assert guard_records(runtime) == ()


async def test_the_guard_lands_both_after_a_stop_of_the_orchestrator(folder: Path) -> None:
    program, pids = await start_orchestrator(folder, patience_s=1.0)
    loop = asyncio.get_running_loop()
    stopped_s = loop.time()
    program.send_signal(signal.SIGSTOP)
    await until(lambda: "LAND" in [word for _, word in words(folder, "twin")])
    first_s = min(t_s for t_s, word in words(folder, "twin") if word == "HOLD")
    assert first_s - stopped_s < 7.0 < LOST_S
    # It may be so for ever: guard and vehicles do not stay for it.
    await until(lambda: all(gone(pid) for pid in pids.values()))
    assert ProcessId.of(program.pid) is not None
    assert "orphaned" in [log_line["event"] for log_line in log_lines(folder)]
    program.kill()
    await program.wait()


async def test_a_killed_guard_leaves_the_landing_to_the_autopilots(folder: Path) -> None:
    async with RemoteFlight(folder) as flight:
        os.kill(flight.guard.pid, signal.SIGKILL)
        await until(lambda: flight.kinds() == ["guard"], 30.0)
        heard = dict(flight.heard)
        assert not await flight.guard.at_rest(0.05)
        assert await flight.guard.all_down(60.0)
        assert await flight.guard.at_rest(30.0)
        assert not any(map(gone, flight.pids.values()))
        assert all(flight.heard[name] > heard[name] for name in heard)
        flight.guard.send(OperatorAction(OperatorCommand("abort", "nobody hears this")))
    assert all(map(gone, flight.pids.values()))
    for name in ("real", "twin"):
        assert "FAILSAFE" in [word for _, word in words(folder, name)]


async def test_a_guard_that_is_silent_is_taken_for_dead(folder: Path) -> None:
    async with RemoteFlight(folder) as flight:
        os.kill(flight.guard.pid, signal.SIGSTOP)
        await until(lambda: flight.kinds() == ["guard"], 30.0)
        assert await flight.guard.all_down(60.0)
    assert gone(flight.guard.pid)
    assert all(map(gone, flight.pids.values()))


async def test_a_killed_vehicle_brings_the_other_down(folder: Path) -> None:
    async with RemoteFlight(folder) as flight:
        os.kill(flight.pids["real"], signal.SIGKILL)
        assert await flight.guard.all_down(60.0)
        assert flight.kinds() == ["lost"]
        assert flight.guard.events[-1].vehicle == "twin"
        ended = flight.guard.ended("real")
        assert ended is not None
        assert ended.exit_code == -signal.SIGKILL
    assert words(folder, "twin")[-1][1] == "END armed=False up_m=0.00"


async def test_nothing_is_left_after_a_kill_of_orchestrator_and_guard(
    folder: Path, runtime: Path
) -> None:
    program, pids = await start_orchestrator(folder)
    os.kill(pids["guard"], signal.SIGSTOP)
    program.kill()
    await program.wait()
    os.kill(pids["guard"], signal.SIGKILL)
    await until(lambda: all(gone(pid) for pid in pids.values()))
    assert len(guard_records(runtime)) == 1
    assert reap_orphans(runtime) == ()
    assert guard_records(runtime) == ()


async def test_the_operators_socket(folder: Path) -> None:
    async with RemoteFlight(folder) as flight:
        hold, status, resume, again, no = await ask(
            folder,
            {"command": "hold", "who": "anna"},
            {"command": "status", "who": "anna"},
            {"command": "resume", "who": "anna"},
            {"command": "resume", "who": "anna"},
            b"not json",
        )
        assert (hold["ok"], status["held"], resume["ok"]) == (True, True, True)
        assert (again["ok"], no["ok"]) == (False, False)
        sent_s = asyncio.get_running_loop().time()
        (abort,) = await ask(folder, {"command": "abort", "who": "anna"})
        assert abort["latched"] == "abort"
        assert await flight.guard.all_down(60.0)
        assert flight.kinds() == ["hold", "resume", "abort"]
        assert flight.guard.events[-1].t_s > sent_s
    refused = [line["text"] for line in log_lines(folder) if line["event"] == "refused"]
    assert refused == ["anna: resume: no vehicle holds", "the line is not JSON"]


async def test_a_signal_to_the_guard_is_an_abort_and_no_end_of_the_orchestrator(
    folder: Path,
) -> None:
    """`wil-campaign abort` signals a guard whose socket does not answer."""
    async with RemoteFlight(folder) as flight:
        os.kill(flight.guard.pid, signal.SIGTERM)
        assert await flight.guard.all_down(60.0)
        told = [event for event in flight.guard.events if decisive_guard_event(event) is not None]
    assert (told[0].kind, told[0].text) == ("abort", "aborted by SIGTERM")


async def test_the_socket_works_without_an_orchestrator(folder: Path) -> None:
    program, pids = await start_orchestrator(folder)
    program.send_signal(signal.SIGSTOP)
    (answer,) = await ask(folder, {"command": "abort", "who": "anna"})
    assert answer["ok"]
    program.kill()
    await program.wait()
    await until(lambda: all(gone(pid) for pid in pids.values()))
    said = [line["text"] for line in log_lines(folder) if line.get("kind") == "abort"]
    assert said == ["aborted by anna"]


async def test_socket_wants_its_token(folder: Path) -> None:
    async with RemoteFlight(folder, token=TOKEN) as flight:
        without, wrong = await ask(
            folder,
            {"command": "abort", "who": "eve"},
            {"command": "abort", "who": "eve", "token": "guess"},
        )
        assert not without["ok"]
        assert not wrong["ok"]
        assert flight.kinds() == []
        (right,) = await ask(folder, {"command": "abort", "who": "anna", "token": TOKEN})
        assert right["ok"]


async def test_a_guard_that_cannot_begin_says_why(folder: Path) -> None:
    (folder / "real.tlog").write_text("in the way")
    with pytest.raises(LinkError, match=r"real\.tlog"):
        async with RemoteGuard(guard_config=guard_config(folder)):
            pass


async def test_a_log_that_cannot_be_written_is_an_error_and_the_guard_goes_on(folder: Path) -> None:
    async with RemoteFlight(folder) as flight:
        resource.prlimit(flight.guard.pid, resource.RLIMIT_FSIZE, (64, 64))
        await until(lambda: set(flight.kinds()) == {"record"} and len(flight.kinds()) == 2)
        assert flight.guard.phases == {"real": ContingencyPhase.IDLE, "twin": ContingencyPhase.IDLE}
        decided = [
            decisive_guard_event(event) for event in flight.guard.events if event.kind == "record"
        ]
        assert {(one.kind, one.source) for one in decided if one is not None} == {
            ("ERROR", "guard.record/real"),
            ("ERROR", "guard.record/twin"),
        }
        flight.guard.send(BringDown("done"))
        assert await flight.guard.all_down(60.0)
    assert flight.kinds().count("record") == 2


def read_to_end(end: int) -> bytes:
    with os.fdopen(end, "rb") as file:
        return file.read()


async def test_a_disk_that_stands_still_delays_no_abort(folder: Path) -> None:
    os.mkfifo(folder / "guard.jsonl")
    end = os.open(folder / "guard.jsonl", os.O_RDONLY | os.O_NONBLOCK)
    fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, 4096)
    async with RemoteFlight(folder, lost_s=60.0) as flight:
        # What the guard notes of unknown vehicles is more than fits.
        for _ in range(100):
            flight.guard._channel.send(AnchorAt("nobody", (0.0, 0.0, 0.0), 0.0))
        (abort,) = await ask(folder, {"command": "abort", "who": "anna"})
        assert abort["latched"] == "abort"
        assert await flight.guard.all_down(60.0)
        os.set_blocking(end, True)
        written = asyncio.create_task(asyncio.to_thread(read_to_end, end))
    events = [json.loads(line) for line in (await written).splitlines()]
    assert len([event for event in events if event["event"] == "refused"]) == 100
    assert "aborted by anna" in [event["text"] for event in events if event.get("kind") == "abort"]
    assert events[-1]["event"] == "end"


class FullLog:
    """A tlog whose last bytes cannot be written."""

    def __exit__(self, *_: object) -> None:
        raise OSError(28, "No space left on device")


async def test_an_exception_in_the_guard_brings_down_before_anything_is_read_or_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The lines of a traceback are read from a disk that may stand still."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process: Any = GuardProcess(end=theirs, lifeline=-1)
    done: list[object] = []
    process._guarding = True
    process._guard = SimpleNamespace(send=done.append)
    monkeypatch.setattr(process, "_event", lambda event: done.append(event.kind))

    def read(_: BaseException) -> list[str]:
        done.append("read")
        return ["trace"]

    monkeypatch.setattr(guard_process, "format_exception", read)
    process._fault(KeyError("of ours"), "a task")
    assert done == ["guard", BringDown("in the guard: KeyError: 'of ours'"), "read"]

    def broken(_: BringDown) -> None:
        raise ValueError("of its core")

    process._guard = SimpleNamespace(send=broken)
    with pytest.raises(ValueError, match="of its core"):
        process._fault(KeyError("once more"), "a task")
    assert done[3:] == ["guard", "read"]
    ours.close()
    theirs.close()


def test_logging_does_not_wait_for_stderr_and_its_thread_has_the_guards_priority(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A full pipe is the disk that stands still, until it is read."""
    risen: list[int] = []
    monkeypatch.setattr(guard_stderr, "raise_process_priority", lambda: risen.append(get_ident()))
    monkeypatch.setattr(guard_stderr, "_MOST_POLLS", 1200)
    read_end, write_end = os.pipe()
    full = b"." * fcntl.fcntl(write_end, fcntl.F_SETPIPE_SZ, 4096)
    os.write(write_end, full)
    with os.fdopen(read_end, "rb") as printed:
        with os.fdopen(write_end, "w") as stderr:
            monkeypatch.setattr(sys, "stderr", stderr)
            with logging_in_thread():
                for number in range(100):
                    logging.getLogger("of a link").warning("lost %d", number)
                assert printed.read(len(full)) == full
        lines = printed.read().decode().splitlines()
    assert lines == [f"lost {number}" for number in range(100)]
    assert len(risen) == 1
    assert risen[0] != get_ident()


def test_a_stderr_that_takes_nothing_keeps_no_guard_from_its_end() -> None:
    program = [sys.executable, "-c", LOGS_TO_ITS_END]
    with subprocess.Popen(program, stderr=subprocess.PIPE) as process:  # noqa: S603 - ours
        try:
            assert process.wait(30.0) == 7
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("at_rest", "text"),
    [
        (True, "nothing is armed, but the guard's process does not end"),
        (False, "the guard continues by itself: a vehicle is still in the air"),
    ],
)
async def test_a_guard_that_does_not_end_has_a_vehicle_in_the_air_or_a_slow_disk(
    folder: Path, text: str, *, at_rest: bool
) -> None:
    guard: Any = RemoteGuard(guard_config=guard_config(folder))

    async def wait(_: float) -> None:
        return None

    rest = asyncio.Event()
    if at_rest:
        rest.set()
    end = SimpleNamespace(close=lambda: None)
    guard._process = SimpleNamespace(wait=wait, release=lambda: None, running=True)
    guard._rest, guard._channel, guard._stderr = rest, end, end
    guard._clock = SimpleNamespace(continue_alone=lambda: None)
    guard._hold = os.open(folder, os.O_RDONLY)
    await guard._end_process()
    (event,) = guard.events
    assert (event.kind, event.text.partition(":")[0]) == ("guard", text.partition(":")[0])


@pytest.mark.parametrize("known", [False, True])
async def test_a_log_whose_end_cannot_be_written_is_reported_once(
    monkeypatch: pytest.MonkeyPatch, *, known: bool
) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    process: Any = GuardProcess(end=theirs, lifeline=-1)
    before = GuardEvent(1.0, "record", "real" if known else "twin", "the recording ended early")
    process._guard = SimpleNamespace(events=[before])
    reported: list[GuardEvent] = []
    monkeypatch.setattr(process, "_event", reported.append)
    process._close_tlog("real", FullLog())
    assert [(one.kind, one.vehicle) for one in reported] == ([] if known else [("record", "real")])
    ours.close()
    theirs.close()


async def test_a_guard_whose_start_is_cancelled_ends_at_once(folder: Path) -> None:
    """Else it keeps the ports of its links for two minutes, and the next run cannot open them."""
    guard = RemoteGuard(guard_config=guard_config(folder))
    starting = asyncio.create_task(guard.__aenter__())
    await asyncio.sleep(0.0)  # until it waits for the guard
    pid = guard.pid
    os.kill(pid, signal.SIGSTOP)  # it neither opens its links nor ends by itself
    starting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await starting
    is_gone = gone(pid)
    if not is_gone:
        os.kill(pid, signal.SIGKILL)  # it would be stopped for ever
    assert is_gone


async def test_a_program_that_cannot_start(folder: Path) -> None:
    async with RemoteGuard(guard_config=guard_config(folder)) as guard:
        with pytest.raises(LinkError, match="could not be started"):
            await guard.start("real", [str(folder / "no such program")])


@pytest.fixture
def open_runtime(runtime: Path) -> None:
    runtime.mkdir()
    runtime.chmod(0o777)


@pytest.mark.usefixtures("open_runtime")
async def test_a_folder_of_sockets_that_others_may_write_to_is_passed_over(
    folder: Path, runtime: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(short_folder / "home"))
    async with RemoteFlight(folder):
        (status,) = await ask(folder, {"command": "status", "who": "anna"})
    assert status["ok"]
    assert os.listdir(runtime) == []  # noqa: PTH208
    (said,) = [line["text"] for line in log_lines(folder) if line["event"] == "runtime folder"]
    assert said.startswith(f"{runtime} is open to other users (mode 0777); ")


def test_a_runtime_folder_too_deep_for_sockets_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deep = tmp_path / ("d" * 100)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    folder = open_runtime_folder().path
    assert folder.name == f"wil-campaign-{os.getuid()}"
    assert len(str(folder)) < 72


def test_the_last_ticks_do_not_wait_for_a_clock_that_stands_still() -> None:
    async def ends_s(within_s: float) -> float:
        began_s = time.monotonic()
        await guard_process.await_last_ticks(within_s)
        return time.monotonic() - began_s

    for speed, within_s, at_least_s in ((1e-9, 0.05, 0.05), (1.0, 60.0, 0.1)):
        with asyncio.Runner(loop_factory=partial(PacedLoop, speed)) as runner:
            assert at_least_s <= runner.run(ends_s(within_s)) < 30.0
