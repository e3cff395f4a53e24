"""Local workers: each run has its own process on this machine, forked from the run server.

The parent handles Ctrl-C and the terminal. A worker treats the death of its parent as an operator's
abort: it lands, writes its result, and ends.
"""

import asyncio
import contextlib
import os
import select
import signal
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing import reduction
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Generic

from wil_campaign.orchestrator.campaign.workers.left_processes import (
    adopt_descendants,
    end_descendants,
    end_despite_threads,
)
from wil_campaign.orchestrator.campaign.workers.run_server import (
    LOST_STATUS,
    has_run_server_ended,
    run_context,
    run_environment,
    run_server_process,
    start_run_server,
)
from wil_campaign.orchestrator.campaign.workers.run_workers import (
    Fly,
    Order,
    OrderDone,
    Outcome,
    WorkerLost,
)
from wil_campaign.orchestrator.operator.run_messages import FlightPlace, News, ProgressLimiter
from wil_campaign.orchestrator.state.call_marker import CallMark, adopt_call_mark
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.vehicles.vehicle_server_process import (
    VehicleServerProcess,
    inherit_vehicle_server,
)

_PROGRESS_S = 0.1
_ENDING_S = 2.0
"""For how long a run server may still take to end whose sockets are closed already."""
_KILLED_S = 20.0
"""A killed process that has not ended after so long never ends: a device holds it."""
_ORPHANED = "the run itself: its parent process died"


class _SentDescriptor:
    """A file descriptor of the pool's process, sent to a worker; number: its own, or the copy's."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __reduce__(self) -> "tuple[Callable[[Any], _SentDescriptor], tuple[object]]":
        """Return how a worker unpickles it: with a duplicate of the descriptor."""
        return _receive_descriptor, (reduction.DupFd(self.number),)


def _receive_descriptor(descriptor: Any) -> _SentDescriptor:
    return _SentDescriptor(descriptor.detach())


@dataclass(frozen=True, slots=True)
class _Sent:
    """The descriptors that a worker gets. mark: of the autonomy's calls."""

    stderr: _SentDescriptor
    mark: _SentDescriptor
    vehicle_server: _SentDescriptor | None


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
            return OperatorCommand("abort", _ORPHANED)
        return command if isinstance(command, OperatorCommand) else None


def _work(
    connection: Connection,
    fly: "Fly[Any, Any]",
    environment: Mapping[str, str],
    sent: _Sent,
) -> None:
    """Fly an order in a worker process, and end when the parent closes the pipe."""
    _adopt(environment, sent)
    for number in (signal.SIGTERM, signal.SIGHUP):
        # `timeout`, a service manager and a closing terminal send these to the whole group; the
        # parent decides what to do. A handler, because children would inherit an ignored signal.
        signal.signal(number, lambda *_: None)
    os.dup2(2, 1)  # stdout is for the parent's output; prints of libraries go to stderr
    adopt_descendants()
    inbox = PipeInbox(connection)
    limiter = ProgressLimiter(_PROGRESS_S)

    def report(news: News) -> None:
        if not limiter.passes(news):
            return
        # A parent that does not read (SIGSTOP) must not block a flight.
        _, writable, _ = select.select([], [connection], [], 0.0)
        if writable:
            with contextlib.suppress(OSError):
                connection.send(news)

    order = _first_order(connection)
    if order is None:
        return
    try:
        outcome = fly(order, report, inbox)
    except BaseException as error:  # noqa: BLE001  # a worker reports every exception
        outcome = _lost_by_exception(error)
    if left := end_descendants():
        sys.stderr.write(f"ended processes that a run left running: {', '.join(left)}\n")
    try:
        connection.send(OrderDone(outcome))
    except OSError:
        return
    except Exception as error:  # noqa: BLE001  # an outcome that cannot be sent
        connection.send(OrderDone(_lost_by_exception(error)))
    _first_order(connection)  # wait until the parent has read it and closes the pipe
    end_despite_threads()


def _adopt(environment: Mapping[str, str], sent: _Sent) -> None:
    """Take over what the campaign's process gives a worker."""
    adopt_call_mark(sent.mark.number)
    if sent.vehicle_server is not None:
        inherit_vehicle_server(sent.vehicle_server.number)
    # The run server may have started with another environment and terminal than the campaign.
    os.environ.clear()
    os.environ.update(environment)
    os.dup2(sent.stderr.number, 2)
    os.close(sent.stderr.number)


def _first_order(connection: Connection) -> Any:  # of the type that `fly` takes
    """Return a worker's order; None once the parent has closed the pipe."""
    while True:
        try:
            order = connection.recv()
        except (EOFError, OSError):
            return None
        if not isinstance(order, OperatorCommand):  # a command came after its run
            return order


def _lost_by_exception(error: BaseException) -> WorkerLost:
    kind = type(error).__name__
    return WorkerLost(f"{kind}: {error}", traceback.format_exc(), kind)


class LocalWorker(Generic[Order, Outcome]):
    """A worker process of this machine, and the pipe to it. completed: see LocalWorkers.

    mark: of the autonomy's calls in the process. prepare: called before an order is sent. server:
    the process id of the run server that forked it.
    """

    def __init__(
        self,
        process: BaseProcess,
        connection: Connection,
        completed: Callable[[Order], Outcome | None],
        mark: CallMark,
        *,
        prepare: Callable[[Order], None] = lambda _: None,
        server: int | None = None,
    ) -> None:
        self._server = server
        self._prepare = prepare
        self._mark = mark
        self._process = process
        self._connection = connection
        self._completed = completed
        self._order: Order | None = None

    @property
    def place(self) -> FlightPlace:
        """Return the empty place, for this machine."""
        return FlightPlace()

    async def begin(self, order: Order) -> None:
        """Send the order to the process. Raises OSError."""
        self._order = order
        self._prepare(order)
        self._connection.send(order)

    async def receive(self) -> object:
        """Return the process's next message. Raises EOFError, OSError."""
        await await_message(self._connection)
        message: object = self._connection.recv()
        return message

    def send(self, command: OperatorCommand) -> None:
        """Pass a command on to the process, unless its pipe is full."""
        # Not `select`, which raises for descriptors above 1023: a campaign of many runs has them.
        poll = select.poll()
        with contextlib.suppress(OSError):
            poll.register(self._connection, select.POLLOUT)
            if poll.poll(0):
                self._connection.send(command)

    def kill(self) -> None:
        """Kill the process."""
        self._process.kill()

    async def outcome_of_lost(self, reason: str) -> Outcome | WorkerLost:
        """Return the outcome that the process had completed, or else how it ended."""
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, self._process.join, 5.0)
        outcome = None if self._order is None else self._completed(self._order)
        if outcome is not None:
            return outcome
        return WorkerLost(
            reason or _exit_text(self._process.exitcode),
            is_own_end=True,
            called=self._mark.vehicle,
            has_goal=self._mark.has_goal,
        )

    async def end(self) -> str:
        """End the process; return in words what was wrong with its end."""
        self._connection.close()
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(None, self._process.join, 20.0)
        if self._process.is_alive():
            print(  # noqa: T201  # the user must learn of a process that hangs
                f"worker process {self._process.pid} did not exit; killing it", file=sys.stderr
            )
            self._process.kill()
            await loop.run_in_executor(None, self._process.join, _KILLED_S)
            how = "; it was killed"
            if self._process.is_alive():
                how = ", nor when killed: it waits for a device, such as a disk"
            return f"worker process {self._process.pid} did not exit{how}"
        if not self._process.exitcode:
            return ""
        if (
            self._process.exitcode == LOST_STATUS
            and self._server is not None
            and await loop.run_in_executor(None, has_run_server_ended, self._server, _ENDING_S)
        ):
            print(  # noqa: T201  # no fault of this run, which has a result
                f"the run server was ended by another, so that nothing is known of the end of "
                f"worker process {self._process.pid}",
                file=sys.stderr,
            )
            return ""
        return _exit_text(self._process.exitcode, "after its last verdict")


class LocalWorkers(Generic[Order, Outcome]):
    """Starts worker processes on this machine. fly: flies an order, in the process.

    completed: returns the outcome that an order's process completed before it was lost, or None.
    forks_vehicles: returns whether an order's vehicles are processes, which a server forks for all
    orders; None for no such server.
    """

    def __init__(
        self,
        fly: "Fly[Order, Outcome]",
        completed: Callable[[Order], Outcome | None] = lambda _: None,
        forks_vehicles: Callable[[Order], bool] | None = None,
    ) -> None:
        self._forks_vehicles = forks_vehicles
        self._vehicle_server: VehicleServerProcess | None = None
        self._fly = fly
        self._completed = completed
        self._context = run_context()

    async def start(self) -> LocalWorker[Order, Outcome]:
        """Return a new worker process; the run server may take seconds to start, in a thread."""
        if self._forks_vehicles is not None and self._vehicle_server is None:
            self._vehicle_server = VehicleServerProcess()
        loop = asyncio.get_running_loop()
        starting = loop.run_in_executor(None, self._start)
        try:
            return await asyncio.shield(starting)
        except asyncio.CancelledError:
            starting.add_done_callback(_kill_started)
            raise

    async def close(self) -> None:
        """Close the server of vehicles; the run server ends with its campaign."""
        if self._vehicle_server is not None:
            await self._vehicle_server.close()
            self._vehicle_server = None

    def _prepare(self, order: Order) -> None:
        """Start what an order's run asks for processes."""
        server, forks = self._vehicle_server, self._forks_vehicles
        if server is not None and forks is not None and forks(order):
            server.start()

    def _start(self) -> LocalWorker[Order, Outcome]:
        """Start a process, on another run server where this one ends meanwhile."""
        start_run_server()  # it may have been killed
        server = run_server_process()
        try:
            return self._fork(server)
        except (OSError, EOFError):
            if server is None or not has_run_server_ended(server, _ENDING_S):
                raise
        start_run_server()
        return self._fork(run_server_process())

    def _fork(self, forked_by: int | None) -> LocalWorker[Order, Outcome]:
        ours, theirs = self._context.Pipe()
        mark, server = CallMark(), self._vehicle_server
        process = self._context.Process(
            target=_work,
            args=(
                theirs,
                self._fly,
                run_environment(),
                _Sent(
                    _SentDescriptor(2),
                    _SentDescriptor(mark.descriptor),
                    None if server is None else _SentDescriptor(server.descriptor),
                ),
            ),
            name="wil-campaign run",
            daemon=False,
        )
        try:
            process.start()
        finally:
            os.close(mark.descriptor)
        theirs.close()
        return LocalWorker(
            process, ours, self._completed, mark, prepare=self._prepare, server=forked_by
        )


async def await_message(connection: Connection) -> None:
    """Wait until a connection has a message or is closed, without blocking the loop."""
    loop = asyncio.get_running_loop()
    if not connection.poll(0):
        ready: asyncio.Future[None] = loop.create_future()
        loop.add_reader(connection.fileno(), _set_once, ready)
        try:
            await ready
        finally:
            loop.remove_reader(connection.fileno())


def _kill_started(starting: "asyncio.Future[LocalWorker[Any, Any]]") -> None:
    if not starting.cancelled() and starting.exception() is None:
        starting.result().kill()


def _set_once(ready: "asyncio.Future[None]") -> None:
    """Set a worker's future, unless it is done."""
    if not ready.done():
        ready.set_result(None)


def _exit_text(exitcode: int | None, when: str = "before it had a verdict") -> str:
    """Return a worker's exit code in words."""
    if exitcode is None:
        return "its process stopped responding"
    if exitcode < 0:
        return f"its process was ended by {signal.Signals(-exitcode).name}"
    return f"its process ended with exit status {exitcode} {when}"
