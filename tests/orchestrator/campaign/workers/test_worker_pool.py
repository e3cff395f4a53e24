"""The pool: real processes, real deaths."""

import asyncio
import contextlib
import faulthandler
import multiprocessing
import os
import resource
import signal
import stat
import subprocess
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.wil_campaign.foundation.processes.busy_core import one_busy_core
from wil_campaign.orchestrator.campaign.workers.local_workers import (
    LocalWorker,
    LocalWorkers,
    PipeInbox,
    await_message,
)
from wil_campaign.orchestrator.campaign.workers.run_order import (
    LoadingTimeoutError,
    limited_loading,
)
from wil_campaign.orchestrator.campaign.workers.run_workers import OrderDone, WorkerLost
from wil_campaign.orchestrator.campaign.workers.worker_pool import WorkerPool
from wil_campaign.orchestrator.operator.run_messages import (
    FlightPlace,
    News,
    OperatorInbox,
    Report,
    RunEventReport,
    RunProgressReport,
)
from wil_campaign.orchestrator.state.call_marker import CallMark
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.vehicle_server_process import vehicle_server

Outcomes = dict[str, "str | WorkerLost"]


def read_mark() -> CallMark:
    """Return the parent's end of a mark that no worker has."""
    mark = CallMark()
    os.close(mark.descriptor)
    return mark


def fly(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Stand in for a run; lives in the worker process."""
    report(RunProgressReport(order, "sim", 1, "takeoff", 0.0))
    match order:
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "stop":
            os.kill(os.getpid(), signal.SIGSTOP)
        case "exit":
            os._exit(7)
        case "raise":
            raise ValueError("bad luck")
        case "noise":
            os.write(1, b"a library prints to stdout")
        case "wait":
            while (command := inbox.poll()) is None:
                time.sleep(0.01)
            return f"aborted by {command.who}"
        case "hurry":
            for count in range(1000):
                report(RunProgressReport(order, "sim", 1, "goal", count / 2))
            report(RunEventReport("hurry/sim/1", 500.0, "stage", "landing", "", ""))
    return f"flown {order}"


def fly_all(orders: list[str], jobs: int = 2) -> tuple[Outcomes, list[News]]:
    outcomes: Outcomes = {}
    seen: list[News] = []
    pool = WorkerPool[str, str](
        jobs=jobs, workers=LocalWorkers(fly), report=seen.append, done=outcomes.__setitem__
    )
    asyncio.run(pool.fly(orders))
    return outcomes, seen


def test_every_order_has_an_outcome_whatever_happens_to_the_others() -> None:
    outcomes, seen = fly_all(["a", "die", "b", "raise", "exit", "c"])
    assert {name: out for name, out in outcomes.items() if isinstance(out, str)} == {
        "a": "flown a",
        "b": "flown b",
        "c": "flown c",
    }
    lost = {name: out.reason for name, out in outcomes.items() if isinstance(out, WorkerLost)}
    assert "SIGKILL" in lost["die"]
    assert "exit status 7" in lost["exit"]
    assert lost["raise"] == "ValueError: bad luck"
    assert {news.run.partition("/")[0] for news in seen} >= {"a", "b", "c", "raise"}


def test_a_run_that_is_faster_than_the_wall_tells_no_more_than_people_can_follow() -> None:
    _, seen = fly_all(["hurry"])
    assert 1 <= sum(isinstance(news, RunProgressReport) for news in seen) < 100
    assert [news.word for news in seen if isinstance(news, RunEventReport)] == ["landing"]


def test_prints_of_a_worker_go_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    fly_all(["noise"], jobs=1)
    out, err = capfd.readouterr()
    assert out == ""
    assert "a library prints" in err


def test_abort_reaches_the_run_in_flight_and_stops_those_that_wait() -> None:
    outcomes: Outcomes = {}

    async def main() -> None:
        flying = asyncio.Event()
        pool = WorkerPool[str, str](
            jobs=1,
            workers=LocalWorkers(fly),
            report=lambda _: flying.set(),
            done=outcomes.__setitem__,
        )
        async with asyncio.TaskGroup() as group:
            group.create_task(pool.fly(["wait", "never"]))
            await flying.wait()
            pool.abort(OperatorCommand("abort", "tester"))

    asyncio.run(main())
    assert outcomes == {"wait": "aborted by tester"}


class QuickWorker:
    """Does each order at once, or raises for one that is to be lost."""

    place = FlightPlace()

    def __init__(self, workers: "ScarceWorkers") -> None:
        self._workers = workers
        self._order = ""

    async def begin(self, order: str) -> None:
        self._order = order

    async def receive(self) -> object:
        if self._order == "lost":
            raise EOFError
        await asyncio.sleep(0.05)
        return OrderDone(f"flown {self._order}")

    def send(self, command: OperatorCommand) -> None: ...

    def kill(self) -> None: ...

    async def outcome_of_lost(self, reason: str) -> WorkerLost:
        return WorkerLost("lost")

    async def end(self) -> str:
        self._workers.free += self._order != "lost"
        return ""


class ScarceWorkers:
    """Has so many places; who finds none waits for a further one, which never comes."""

    def __init__(self, free: int) -> None:
        self.free = free
        self.given_up = 0

    async def start(self) -> QuickWorker:
        try:
            if not self.free:
                await asyncio.Event().wait()
        except asyncio.CancelledError:
            self.given_up += 1
            raise
        self.free -= 1
        return QuickWorker(self)

    async def close(self) -> None: ...


@pytest.mark.parametrize("orders", [["lost", "a", "b", "c"], ["a", "lost"], ["lost", "again"]])
def test_a_place_that_no_order_waits_for_is_not_waited_for(orders: list[str]) -> None:
    outcomes: Outcomes = {}
    workers = ScarceWorkers(2)
    again = ["a"] if "again" in orders else []

    def done(order: str, outcome: str | WorkerLost) -> str | None:
        outcomes[order] = outcome
        return again.pop() if again and order == "lost" else None

    pool = WorkerPool[str, str](jobs=2, workers=workers, report=lambda _: None, done=done)

    async def main() -> None:
        async with asyncio.timeout(10):
            await pool.fly(orders)

    asyncio.run(main())
    flown = {name: f"flown {name}" for name in {*orders, *outcomes} if name != "lost"}
    assert outcomes == flown | {"lost": WorkerLost("lost")}
    assert workers.given_up <= 1


def test_an_abort_ends_orders_that_wait_for_a_place() -> None:
    outcomes: Outcomes = {}
    workers = ScarceWorkers(0)

    async def main() -> None:
        pool = WorkerPool[str, str](
            jobs=2, workers=workers, report=lambda _: None, done=outcomes.__setitem__
        )
        async with asyncio.timeout(10), asyncio.TaskGroup() as group:
            group.create_task(pool.fly(["a", "b"]))
            await asyncio.sleep(0.05)
            pool.abort(OperatorCommand("abort", "tester"))

    asyncio.run(main())
    assert (outcomes, workers.given_up) == ({}, 2)


class BrokenWorkers(ScarceWorkers):
    """Has two workers, of which the first raises for each command."""

    def __init__(self) -> None:
        super().__init__(2)
        self.orders: list[str] = []
        self.all_fly, self.aborted = asyncio.Event(), asyncio.Event()

    async def start(self) -> QuickWorker:
        worker = BrokenWorker(self, raises=self.free == 2)
        self.free -= 1
        return worker


class BrokenWorker(QuickWorker):
    def __init__(self, workers: BrokenWorkers, *, raises: bool) -> None:
        super().__init__(workers)
        self._all = workers
        self._raises = raises

    async def receive(self) -> object:
        self._all.orders.append(self._order)
        if len(self._all.orders) == 2:
            self._all.all_fly.set()
        await self._all.aborted.wait()
        return OrderDone(f"flown {self._order}")

    def send(self, command: OperatorCommand) -> None:
        if self._raises:
            raise RuntimeError("a fault of ours")
        self._all.aborted.set()


def test_a_worker_that_raises_keeps_an_abort_from_no_other_and_is_no_secret() -> None:
    outcomes: Outcomes = {}
    workers = BrokenWorkers()

    async def main() -> None:
        pool = WorkerPool[str, str](
            jobs=2, workers=workers, report=lambda _: None, done=outcomes.__setitem__
        )
        async with asyncio.timeout(60), asyncio.TaskGroup() as group:
            group.create_task(pool.fly(["a", "b", "never"]))
            await workers.all_fly.wait()
            with pytest.raises(ExceptionGroup, match=r"abort was not passed to a$") as raised:
                pool.abort(OperatorCommand("abort", "tester"))
            assert raised.group_contains(RuntimeError, match="a fault of ours")

    asyncio.run(main())
    assert outcomes == {"a": "flown a", "b": "flown b"}


async def test_a_process_that_no_kill_ends_is_not_waited_for() -> None:
    waited: list[float | None] = []

    class StuckProcess(multiprocessing.Process):
        pid = 7

        def join(self, timeout: float | None = None) -> None:
            waited.append(timeout)

        def is_alive(self) -> bool:
            return True

        def kill(self) -> None: ...

    ours, _ = multiprocessing.Pipe()
    worker = LocalWorker[str, str](StuckProcess(), ours, lambda _: None, read_mark())
    words = "worker process 7 did not exit, nor when killed: it waits for a device, such as a disk"
    assert await worker.end() == words
    assert None not in waited


def test_no_order_is_begun_while_paused() -> None:
    outcomes: Outcomes = {}
    begun: list[str] = []

    async def main() -> None:
        flying, ended = asyncio.Event(), asyncio.Event()

        def report(news: News) -> None:
            begun.append(news.run)
            flying.set()

        def done(order: str, outcome: str | WorkerLost) -> None:
            outcomes[order] = outcome
            ended.set()

        pool = WorkerPool[str, str](jobs=1, workers=LocalWorkers(fly), report=report, done=done)
        async with asyncio.TaskGroup() as group:
            group.create_task(pool.fly(["wait", "next"]))
            await flying.wait()
            pool.pause()
            assert pool.pass_on(OperatorCommand("hold", "tester")) == 1
            await ended.wait()
            await asyncio.sleep(0.2)
            assert begun == ["wait/sim/1"]
            pool.go_on()

    asyncio.run(main())
    assert outcomes == {"wait": "aborted by tester", "next": "flown next"}


def test_a_worker_that_says_nothing_any_more_is_killed() -> None:
    outcomes: Outcomes = {}
    pool = WorkerPool[str, str](
        jobs=1,
        workers=LocalWorkers(fly),
        report=lambda _: None,
        done=outcomes.__setitem__,
        stall_s=4.0,
    )
    asyncio.run(pool.fly(["stop", "next"]))
    lost = outcomes["stop"]
    assert isinstance(lost, WorkerLost)
    assert lost.reason == "its process did not respond for 4 s; it was killed"
    assert outcomes["next"] == "flown next"


def test_the_death_of_the_parent_is_an_abort_that_says_so() -> None:
    parent, child = multiprocessing.Pipe()
    inbox = PipeInbox(child)
    assert inbox.poll() is None
    parent.close()
    command = inbox.poll()
    assert command is not None
    assert command.kind == "abort"
    assert "its parent process died" in command.who
    assert inbox.poll() is None


def fly_and_die(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Stand in for a run whose process dies once its result is on the disk."""
    del report, inbox
    Path(order).write_text("PASS")
    os.kill(os.getpid(), signal.SIGKILL)
    return ""


def test_a_result_that_a_lost_worker_had_completed_counts_and_its_end_is_reported(
    tmp_path: Path,
) -> None:
    outcomes: Outcomes = {}
    ends: list[str] = []

    def completed(order: str) -> str | None:
        return Path(order).read_text() if Path(order).exists() else None

    pool = WorkerPool[str, str](
        jobs=1,
        workers=LocalWorkers(fly_and_die, completed),
        report=lambda _: None,
        done=outcomes.__setitem__,
        ended_badly=ends.append,
    )
    order = str(tmp_path / "result")
    asyncio.run(pool.fly([order]))
    assert outcomes == {order: "PASS"}
    assert ends == [f"after {order}: its process was ended by SIGKILL"]


class PipedWorker(QuickWorker):
    """Reads its messages from a pipe, as those of this machine and of a cluster do."""

    def __init__(self, workers: "PipedWorkers") -> None:
        super().__init__(workers)
        self.ours, self.theirs = multiprocessing.Pipe()
        self.killed = False

    async def receive(self) -> object:
        await await_message(self.ours)
        message: object = self.ours.recv()
        return message

    def kill(self) -> None:
        self.killed = True


class PipedWorkers(ScarceWorkers):
    """Has one place."""

    def __init__(self) -> None:
        super().__init__(1)
        self.worker = PipedWorker(self)

    async def start(self) -> PipedWorker:
        return self.worker


def test_a_loop_that_stood_still_reads_what_its_workers_sent_meanwhile() -> None:
    """As after Ctrl-S or Ctrl-Z, or while a slow disk syncs: the healthy runs count."""
    outcomes: Outcomes = {}
    workers = PipedWorkers()
    worker = workers.worker

    def stand_still() -> None:
        worker.theirs.send(OrderDone("flown"))
        time.sleep(0.3)

    def report(news: News) -> None:
        asyncio.get_running_loop().call_later(0.01, stand_still)

    worker.theirs.send(RunProgressReport("a/sim/1", "sim", 1, "takeoff", 0.0))
    pool = WorkerPool[str, str](
        jobs=1, workers=workers, report=report, done=outcomes.__setitem__, stall_s=0.2
    )
    asyncio.run(pool.fly(["a"]))
    assert (outcomes, worker.killed) == ({"a": "flown"}, False)


def fly_mute(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Stand in for files that hang before the run has a word to say."""
    del order, report, inbox
    while True:
        time.sleep(0.05)


def test_a_worker_that_hangs_before_its_first_word_ends_on_the_first_signal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("wil_campaign.orchestrator.campaign.workers.worker_pool._ABORTED_S", 0.5)
    outcomes: Outcomes = {}

    async def main() -> None:
        flying = asyncio.Event()
        pool = WorkerPool[str, str](
            jobs=1,
            workers=LocalWorkers(fly_mute),
            report=lambda _: None,
            done=outcomes.__setitem__,
            begun=lambda *_: flying.set(),
        )
        async with asyncio.timeout(60.0), asyncio.TaskGroup() as group:
            group.create_task(pool.fly(["mute", "never"]))
            await flying.wait()
            await asyncio.sleep(0.1)
            pool.abort(OperatorCommand("abort", "SIGTERM"))

    asyncio.run(main())
    lost = outcomes["mute"]
    assert isinstance(lost, WorkerLost)
    assert lost.reason == "aborted before its process had prepared the run; it was killed"
    assert list(outcomes) == ["mute"]


def test_loading_that_hangs_is_cut_off_where_it_hangs() -> None:
    def load() -> None:
        with limited_loading(0.2):
            while True:
                time.sleep(0.01)

    with pytest.raises(LoadingTimeoutError, match="took more than 0"):
        load()
    with limited_loading(0.2):
        pass
    time.sleep(0.3)


def test_time_without_a_processor_is_not_that_of_loading() -> None:
    began_s, limit_s = time.monotonic(), 1.0
    with one_busy_core(4), limited_loading(limit_s):
        end_s = time.process_time() + 0.3
        while time.process_time() < end_s:
            pass
    assert time.monotonic() - began_s > limit_s


@pytest.mark.parametrize("waited_s", [100.0, -100.0], ids=["time left", "time up"])
def test_an_alarm_while_loading_ends_leaves_nothing_armed(
    waited_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the process would end seconds later: in flight, or in another test."""
    armed, is_ending = list[bool](), False
    before, set_timer = signal.getsignal(signal.SIGALRM), signal.setitimer

    def alarm() -> None:
        if is_ending:
            signal.raise_signal(signal.SIGALRM)

    def dump_later(_timeout_s: float, *, exit: bool) -> None:  # noqa: A002 - faulthandler's word
        armed.append(exit)

    def cancel() -> None:
        armed.append(False)
        alarm()

    def set_and_alarm(which: int, seconds: float) -> tuple[float, float]:
        earlier = set_timer(which, seconds)
        if not seconds:
            alarm()
        return earlier

    monkeypatch.setattr(faulthandler, "dump_traceback_later", dump_later)
    monkeypatch.setattr(faulthandler, "cancel_dump_traceback_later", cancel)
    monkeypatch.setattr(signal, "setitimer", set_and_alarm)
    wait = "wil_campaign.orchestrator.campaign.workers.run_order.processor_wait_s"
    monkeypatch.setattr(wait, lambda _pid: 0.0)
    with limited_loading(30.0):
        monkeypatch.setattr(wait, lambda _pid: waited_s)
        is_ending = True
    is_ending = False
    assert armed == [True, False]
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


_STATE: list[str] = []


def fly_counting(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Stand in for an autonomy whose modules keep state, and that starts a daemon."""
    del report, inbox
    _STATE.append(order)
    daemon = "import os, time; os.setsid(); time.sleep(60)"
    child = subprocess.Popen([sys.executable, "-c", daemon])  # noqa: S603 - our own
    return f"{len(_STATE)} {child.pid} {os.environ['ASKED']}"


def test_each_run_begins_anew_and_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    outcomes: Outcomes = {}
    monkeypatch.setenv("ASKED", "as the campaign's process has it")
    pool = WorkerPool[str, str](
        jobs=1,
        workers=LocalWorkers(fly_counting),
        report=lambda _: None,
        done=outcomes.__setitem__,
    )
    asyncio.run(pool.fly(["one", "two"]))
    for outcome in outcomes.values():
        assert isinstance(outcome, str)
        count, child, asked = outcome.split(" ", 2)
        assert (count, asked) == ("1", "as the campaign's process has it")
        assert not Path(f"/proc/{child}").exists()


def fly_with_thread(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Stand in for an autonomy that leaves a thread, as a ROS executor does."""
    del report, inbox
    threading.Thread(target=time.sleep, args=(600.0,), name=f"spin of {order}").start()
    return f"flown {order}"


def test_a_thread_that_a_run_leaves_does_not_keep_its_process(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """It was killed after 20 s, and the campaign ended with an internal error."""
    outcomes: Outcomes = {}
    ended_badly: list[str] = []
    pool = WorkerPool[str, str](
        jobs=1,
        workers=LocalWorkers(fly_with_thread),
        report=lambda _: None,
        done=outcomes.__setitem__,
        ended_badly=ended_badly.append,
    )
    asyncio.run(pool.fly(["one"]))
    assert (outcomes, ended_badly) == ({"one": "flown one"}, [])
    assert "left threads running, and ends without them: spin of one" in capfd.readouterr().err


def fly_without_server(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Kill the run server, the parent of this process."""
    os.kill(os.getppid(), signal.SIGKILL)
    return f"flown {order}"


def test_the_death_of_the_run_server_is_no_fault_of_a_run_that_was_done(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """A worker's exit status is lost with it; 255 stands in its place, which no worker said."""
    outcomes: Outcomes = {}
    complaints: list[str] = []
    pool = WorkerPool[str, str](
        jobs=1,
        workers=LocalWorkers(fly_without_server),
        report=lambda news: None,
        done=outcomes.__setitem__,
        ended_badly=complaints.append,
    )
    asyncio.run(pool.fly(["a", "b"]))
    assert outcomes == {"a": "flown a", "b": "flown b"}
    assert complaints == []
    assert "the run server was ended by another" in capfd.readouterr().err


def test_a_run_server_that_ends_before_it_forks_is_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its socket may stand while it ends: the connection is refused."""
    workers = LocalWorkers(fly)
    fork = workers._fork

    def refused(server: int) -> None:
        monkeypatch.setattr(workers, "_fork", fork)
        os.kill(server, signal.SIGKILL)
        raise ConnectionRefusedError

    monkeypatch.setattr(workers, "_fork", refused)
    outcomes: Outcomes = {}
    pool = WorkerPool[str, str](
        jobs=1, workers=workers, report=lambda _: None, done=outcomes.__setitem__
    )
    asyncio.run(pool.fly(["a"]))
    assert outcomes == {"a": "flown a"}


def fly_into_error(order: str, report: Report, inbox: OperatorInbox) -> str:
    """Stand in for a run that fails while its guard still lands; order: where that program is."""
    del report, inbox
    folder = Path(order)
    ours = [sys.executable, "-P", "-m", "wil_campaign.safety.lands", str(folder / "grandchild")]
    found = {**os.environ, "PYTHONPATH": order}
    guard = subprocess.Popen(ours, env=found)  # noqa: S603 - our own
    while not (folder / "grandchild").exists() and guard.poll() is None:
        time.sleep(0.01)
    grandchild = (folder / "grandchild").read_text()
    left = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    raise ValueError(f"{guard.pid} {grandchild} {left.pid}")


def test_a_guard_that_still_lands_outlives_a_run_that_failed(tmp_path: Path) -> None:
    safety = tmp_path / "wil_campaign" / "safety"
    safety.mkdir(parents=True)
    (safety / "lands.py").write_text(
        "import pathlib, subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "out = pathlib.Path(sys.argv[1])\n"
        "out.with_suffix('.new').write_text(str(child.pid))\n"
        "out.with_suffix('.new').rename(out)\n"
        "time.sleep(60)\n"
    )
    outcomes: Outcomes = {}
    pool = WorkerPool[str, str](
        jobs=1,
        workers=LocalWorkers(fly_into_error),
        report=lambda _: None,
        done=outcomes.__setitem__,
    )
    asyncio.run(pool.fly([str(tmp_path)]))
    lost = outcomes[str(tmp_path)]
    assert isinstance(lost, WorkerLost)
    guard, below_guard, left = (int(word) for word in lost.fault.message.split())
    try:
        assert Path(f"/proc/{guard}").exists()
        assert Path(f"/proc/{below_guard}").exists()
        assert not Path(f"/proc/{left}").exists()
    finally:
        for process in (guard, below_guard):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)


class PlacedWorker:
    """A worker on a node: an order of its own kind waits for a command, others are done at once."""

    def __init__(self, node: str) -> None:
        self.place = FlightPlace(node)
        self.killed = False
        self._order = ""
        self._command: asyncio.Future[OperatorCommand] = asyncio.get_running_loop().create_future()

    async def begin(self, order: str) -> None:
        self._order = order

    async def receive(self) -> object:
        if self._order == "wait":
            return OrderDone(f"aborted by {(await self._command).who} on {self.place}")
        return OrderDone(f"flown on {self.place}")

    def send(self, command: OperatorCommand) -> None:
        self._command.set_result(command)

    def kill(self) -> None:
        self.killed = True

    async def outcome_of_lost(self, reason: str) -> WorkerLost:
        return WorkerLost(reason)

    async def end(self) -> str:
        return ""


class PlacedWorkers:
    """Starts workers on two nodes in turn."""

    def __init__(self) -> None:
        self.started: list[PlacedWorker] = []

    async def start(self) -> PlacedWorker:
        self.started.append(PlacedWorker(("first", "second")[len(self.started) % 2]))
        return self.started[-1]

    async def close(self) -> None:
        pass


async def test_an_abort_of_a_node_lands_its_run_and_bars_it_for_the_rest() -> None:
    outcomes: dict[str, object] = {}
    places: dict[str, str] = {}
    workers = PlacedWorkers()
    pool = WorkerPool[str, str](
        jobs=2,
        workers=workers,
        report=lambda _: None,
        done=outcomes.__setitem__,
        begun=lambda order, place: places.__setitem__(order, str(place)),
    )

    async def abort_soon() -> None:
        while "wait" not in places:  # noqa: ASYNC110 - sets no event
            await asyncio.sleep(0)
        pool.abort(OperatorCommand("abort", "anna", node=places["wait"]))

    async with asyncio.timeout(10), asyncio.TaskGroup() as group:
        group.create_task(abort_soon())
        group.create_task(pool.fly(["wait", "b", "c", "d", "e"]))
    barred = places["wait"]
    assert outcomes["wait"] == f"aborted by anna on {barred}"
    began = list(places)
    after = began[began.index("wait") + 1 :]
    assert set(outcomes) == {"wait", "b", "c", "d", "e"} or any(
        one.killed for one in workers.started
    )
    late = [name for name in after if outcomes[name] == f"flown on {barred}"]
    assert not late


def test_an_abort_reaches_a_worker_by_any_descriptor_and_a_closed_one_is_no_error() -> None:
    """`select` refuses descriptors above 1023, and so would the abort of all further workers."""
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(limits[0], 2048), limits[1]))
    ours, theirs = multiprocessing.Pipe()
    with ours, theirs, Connection(os.dup2(ours.fileno(), 2000)) as high:
        process: Any = multiprocessing.Process()
        worker = LocalWorker[str, str](process, high, lambda _: None, read_mark())
        worker.send(OperatorCommand("abort", "anna"))
        assert theirs.poll(5.0)
        assert theirs.recv() == OperatorCommand("abort", "anna")
        high.close()
        worker.send(OperatorCommand("abort", "anna"))
    resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def fly_with_server(order: str, report: Report, inbox: OperatorInbox) -> str:
    descriptor = vehicle_server()
    return f"{order} {descriptor is not None and stat.S_ISSOCK(os.fstat(descriptor).st_mode)}"


@pytest.mark.parametrize("wanted", [True, False])
async def test_runs_have_a_server_of_vehicles_which_ends_with_the_campaign(*, wanted: bool) -> None:
    """It is started for runs that have such vehicles; one campaign has one."""
    outcomes: Outcomes = {}
    workers = LocalWorkers(fly_with_server, forks_vehicles=lambda _: wanted)
    pool = WorkerPool[str, str](
        jobs=1, workers=workers, report=lambda _: None, done=outcomes.__setitem__
    )
    await pool.fly(["a", "b"])
    children = psutil.Process().children()
    # A zombie, which another test may leave, has no command line.
    lines = [one.as_dict(["cmdline"], ad_value=())["cmdline"] for one in children]
    module = "wil_campaign.vehicles.vehicle_server"
    servers = [one for one, line in zip(children, lines, strict=True) if module in line]
    await workers.close()
    assert outcomes == {"a": "a True", "b": "b True"}
    assert len(servers) == wanted
    _, left = await asyncio.to_thread(psutil.wait_procs, servers, timeout=60.0)
    assert left == []
