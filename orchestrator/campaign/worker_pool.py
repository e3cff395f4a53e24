"""Worker processes: each run has one of its own, forked from the run server.

The parent owns Ctrl-C and the terminal. A worker that dies takes one run with it, never more:
the caller is told and a new worker takes the next run. A worker whose parent has died treats
that as an operator's abort: it lands, writes its result, and ends.
"""

import asyncio
import contextlib
import os
import select
import signal
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from multiprocessing import reduction
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

from orchestrator.campaign.left_processes import adopt_descendants, end_descendants
from orchestrator.campaign.run_server import run_context
from orchestrator.model.faults import Fault
from orchestrator.model.operator_command import Inbox
from orchestrator.model.progress import News, Report
from safety.guard.core.operator_command import OperatorCommand
from vehicles.tasks import finish

_FIRST_WORD_S = 600.0
"""Until its first word a worker loads the campaign's files and compiles."""
_ABORTED_S = 5.0
"""What is left of that once an abort has come: nothing flies yet that would have to land."""
Order = TypeVar("Order")
Outcome = TypeVar("Outcome")
Fly = Callable[[Order, Report, Inbox], Outcome]


@dataclass(frozen=True, slots=True)
class WorkerLost:
    """A worker's order without an outcome: its process died or raised.

    details: the traceback of what it raised; empty where it died. kind: its type's name.
    """

    reason: str
    details: str = ""
    kind: str = ""

    @property
    def fault(self) -> Fault:
        """Return the exception that the worker raised."""
        message = self.reason.removeprefix(f"{self.kind}: ")
        return Fault(0.0, "the worker process", self.kind, message, self.details)


@dataclass(frozen=True, slots=True)
class _Done(Generic[Outcome]):
    """A worker's message that its order is done, with the outcome."""

    outcome: Outcome | WorkerLost


_ITSELF = "the run itself: its parent process died"


class _Stderr:
    """The stderr of the pool's process, handed to a worker; number: its descriptor there."""

    def __init__(self, number: int = 2) -> None:
        self.number = number

    def __reduce__(self) -> "tuple[Callable[[Any], _Stderr], tuple[object]]":
        """Return what a worker makes it of again: a copy of the descriptor goes with it."""
        return _received, (reduction.DupFd(self.number),)


def _received(descriptor: Any) -> _Stderr:
    """Return the pool's stderr as it arrived in a worker."""
    return _Stderr(descriptor.detach())


class PipeInbox:
    """A worker's inbox of operator commands from the parent; the parent's death is an abort."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._orphaned = False

    def poll(self) -> OperatorCommand | None:
        """Return the next operator command from the parent process, or None."""
        if self._orphaned:
            return None
        try:
            if not self._connection.poll(0):
                return None
            command = self._connection.recv()
        except (EOFError, OSError):
            self._orphaned = True
            return OperatorCommand("abort", _ITSELF)
        return command if isinstance(command, OperatorCommand) else None


def _work(
    connection: Connection,
    fly: "Fly[Any, Any]",
    environment: Mapping[str, str],
    stderr: _Stderr,
) -> None:
    """Fly an order in a worker process, and end when the parent closes the pipe."""
    # The run server's environment and terminal may be older than its campaign's.
    os.environ.clear()
    os.environ.update(environment)
    os.dup2(stderr.number, 2)
    os.close(stderr.number)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for number in (signal.SIGTERM, signal.SIGHUP):
        # `timeout`, a service manager and a terminal that closes send these to the whole group; the
        # parent tells us what to do. A handler, for what is ignored our children would ignore too.
        signal.signal(number, lambda *_: None)
    os.dup2(2, 1)  # stdout is the parent's document; whatever a library prints goes to stderr
    adopt_descendants()
    inbox = PipeInbox(connection)

    def report(news: News) -> None:
        # A parent that does not read (SIGSTOP) must not make a flight wait.
        _, writable, _ = select.select([], [connection], [], 0.0)
        if writable:
            with contextlib.suppress(OSError):
                connection.send(news)

    order = _first_order(connection)
    if order is None:
        return
    try:
        outcome = fly(order, report, inbox)
    except BaseException as error:  # noqa: BLE001  # a worker must tell, whatever it was
        outcome = _lost_by(error)
    if left := end_descendants():
        sys.stderr.write(f"ended what a run left behind: {', '.join(left)}\n")
    try:
        connection.send(_Done(outcome))
    except OSError:
        return
    except Exception as error:  # noqa: BLE001  # an outcome that cannot be sent
        connection.send(_Done(_lost_by(error)))
    _first_order(connection)  # until the parent has read it, and closes the pipe


def _first_order(connection: Connection) -> Any:  # what the pool's owner flies
    """Return a worker's order; None once the parent has closed the pipe."""
    while True:
        try:
            order = connection.recv()
        except (EOFError, OSError):
            return None
        if not isinstance(order, OperatorCommand):  # one came after the run that it was meant for
            return order


def _lost_by(error: BaseException) -> "WorkerLost":
    """Return the worker's loss by an exception."""
    kind = type(error).__name__
    return WorkerLost(f"{kind}: {error}", traceback.format_exc(), kind)


@dataclass(slots=True)
class _Worker:
    process: BaseProcess
    connection: Connection
    preparing: asyncio.Timeout | None = None
    """Runs until the first word of the present order."""

    def hurry(self) -> None:
        """Have a worker that has not said anything yet do so soon, or be killed."""
        if self.preparing is not None:
            due_s = asyncio.get_running_loop().time() + _ABORTED_S
            self.preparing.reschedule(min(due_s, self.preparing.when() or due_s))


class Pool(Generic[Order, Outcome]):
    """A pool of up to `jobs` worker processes that fly orders; outcomes come when done.

    done: takes an order's outcome; what it returns is flown next. ready: takes an order when its
    turn has come, and returns it with what is known by then; None: it is not flown any more.

    stall_s: a worker that has reported and then says nothing for so long is killed: it hangs, or
    was stopped. Its guard brings its vehicles down. ended_badly: told of a worker that had done all
    its orders and then did not end as it should.
    """

    def __init__(
        self,
        *,
        jobs: int,
        fly: "Fly[Order, Outcome]",
        report: Report,
        done: Callable[[Order, Outcome | WorkerLost], Order | None],
        stall_s: float = 60.0,
        ended_badly: Callable[[str], None] = lambda _: None,
        ready: Callable[[Order], Order | None] = lambda order: order,
    ) -> None:
        self._ready = ready
        self._ended_badly = ended_badly
        self._jobs = jobs
        self._fly = fly
        self._report = report
        self._done = done
        self._context = run_context()
        self._stall_s = stall_s
        self._busy: list[_Worker] = []
        self._stopped: OperatorCommand | None = None
        self._going = asyncio.Event()
        self._going.set()

    def abort(self, command: OperatorCommand) -> None:
        """Have every worker's run land as aborted; orders not begun are not flown."""
        self._stopped = command
        self._going.set()
        self.pass_on(command)
        for worker in self._busy:
            worker.hurry()

    def pass_on(self, command: OperatorCommand) -> int:
        """Pass an operator command to every worker's run; return how many there are."""
        for worker in self._busy:
            _, writable, _ = select.select([], [worker.connection], [], 0.0)
            if writable:
                with contextlib.suppress(OSError):
                    worker.connection.send(command)
        return len(self._busy)

    def pause(self) -> None:
        """Have the pool begin no order until `go_on`; runs in flight continue."""
        self._going.clear()

    def go_on(self) -> None:
        """Have the pool begin orders again."""
        self._going.set()

    async def fly(self, orders: Iterable[Order]) -> None:
        """Fly all orders on the workers, in order of start; return when no worker is left."""
        waiting = deque(orders)
        async with asyncio.TaskGroup() as group:
            for number in range(min(self._jobs, len(waiting))):
                group.create_task(self._serve(waiting), name=f"worker {number}")

    async def _serve(self, waiting: "deque[Order]") -> None:
        loop = asyncio.get_running_loop()
        worker: _Worker | None = None
        try:
            while waiting:
                await self._going.wait()
                # Preparing the run server takes seconds; signals are heeded meanwhile.
                if worker is None:
                    worker = await loop.run_in_executor(None, self._start)
                await self._going.wait()
                if self._stopped is not None or not waiting:
                    break
                order = self._ready(waiting.popleft())
                if order is None:
                    continue
                outcome = await self._fly_one(worker, order)
                over, worker = worker, None
                ended = await finish(self._end(over), name="the end of a worker")
                if ended and not isinstance(outcome, WorkerLost):
                    self._ended_badly(ended)
                again = self._done(order, outcome)
                if again is not None:
                    waiting.appendleft(again)
        finally:
            if worker is not None:
                ended = await finish(self._end(worker), name="the end of a worker")
                if ended:
                    self._ended_badly(ended)

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=_work,
            args=(theirs, self._fly, dict(os.environ), _Stderr()),
            name="wil-campaign run",
            daemon=False,
        )
        process.start()
        theirs.close()
        return _Worker(process, ours)

    async def _fly_one(self, worker: _Worker, order: Order) -> Outcome | WorkerLost:
        self._busy.append(worker)
        patience_s = _FIRST_WORD_S
        try:
            worker.connection.send(order)
            while True:
                async with asyncio.timeout(patience_s) as preparing:
                    worker.preparing = preparing if patience_s == _FIRST_WORD_S else None
                    if worker.preparing is not None and self._stopped is not None:
                        worker.hurry()
                    message = await _receive(worker.connection)
                worker.preparing = None
                patience_s = self._stall_s
                if isinstance(message, _Done):
                    outcome: Outcome | WorkerLost = message.outcome
                    return outcome
                if isinstance(message, News):
                    self._report(message)
        except TimeoutError:
            worker.process.kill()
            if worker.preparing is not None and self._stopped is not None:
                return WorkerLost("aborted before its process had prepared the run; it was killed")
            return WorkerLost(f"its process did not respond for {patience_s:g} s; it was killed")
        except (EOFError, OSError):
            loop = asyncio.get_running_loop()
            await loop.run_in_executor(None, worker.process.join, 5.0)
            return WorkerLost(_exit_text(worker.process.exitcode))
        finally:
            worker.preparing = None
            self._busy.remove(worker)

    async def _end(self, worker: _Worker) -> str:
        """End a worker; return in words what was wrong with its end."""
        worker.connection.close()
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, worker.process.join, 20.0)
        if worker.process.is_alive():
            print(  # noqa: T201  # the last word to a person about a process that hangs
                f"worker process {worker.process.pid} did not exit; killing it", file=sys.stderr
            )
            worker.process.kill()
            await loop.run_in_executor(None, worker.process.join)
            return f"worker process {worker.process.pid} did not exit; it was killed"
        if worker.process.exitcode:
            return _exit_text(worker.process.exitcode, "after its last verdict")
        return ""


async def _receive(connection: Connection) -> object:
    """Return a worker's next message without blocking the loop."""
    loop = asyncio.get_running_loop()
    if not connection.poll(0):
        ready: asyncio.Future[None] = loop.create_future()
        loop.add_reader(connection.fileno(), _set_once, ready)
        try:
            await ready
        finally:
            loop.remove_reader(connection.fileno())
    message: object = connection.recv()
    return message


def _set_once(ready: "asyncio.Future[None]") -> None:
    """Set a worker's future, unless it is done."""
    if not ready.done():
        ready.set_result(None)


def _exit_text(exitcode: int | None, when: str = "before it had a verdict") -> str:
    """Return a worker's exit code in words."""
    if exitcode is None:
        return "its process stopped answering"
    if exitcode < 0:
        return f"its process was ended by {signal.Signals(-exitcode).name}"
    return f"its process ended with exit status {exitcode} {when}"
