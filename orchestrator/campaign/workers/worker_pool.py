"""The worker pool: flies orders on workers, up to `jobs` at once.

A lost worker loses only its own run: the caller gets a WorkerLost, and a new worker takes the next
order.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic

from wil_campaign.foundation.tasks import finish_in_task, start_task, stop_tasks
from wil_campaign.orchestrator.campaign.workers.run_workers import (
    Order,
    OrderDone,
    Outcome,
    Worker,
    WorkerLost,
    WorkerStarter,
)
from wil_campaign.orchestrator.operator.run_messages import FlightPlace, News, Report
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

_FIRST_MESSAGE_S = 600.0
"""The limit for a worker's first message: until then it loads the campaign's files and compiles."""
_ABORTED_S = 5.0
"""The rest of that limit after an abort: nothing flies yet that would have to land."""
_TURN_S = 1.0
_LEAST_TURNS = 12
"""A limit is counted in turns of our loop: a loop that stood still must not kill what flies."""


@dataclass(slots=True)
class _BusyWorker(Generic[Order, Outcome]):
    """A worker with an order. left_s: for how long it may still send nothing.

    is_preparing: it has sent no message about its order yet.
    """

    worker: Worker[Order, Outcome]
    run: str
    left_s: float = _FIRST_MESSAGE_S
    is_preparing: bool = True

    def shorten_limit(self) -> None:
        """Shorten the limit of a worker that has sent no message yet."""
        if self.is_preparing:
            self.left_s = min(self.left_s, _ABORTED_S)

    async def receive(self) -> object:
        """Return the worker's next message. Raises TimeoutError, EOFError, OSError.

        A turn of the loop counts once, however long the loop stood still (Ctrl-S, Ctrl-Z, a slow
        disk): what the worker has sent meanwhile is read first.
        """
        turn_s = min(_TURN_S, self.left_s / _LEAST_TURNS)
        receiving = start_task(self.worker.receive(), name=f"message of {self.run}")
        try:
            while self.left_s > 0.0:
                done, _ = await asyncio.wait([receiving], timeout=turn_s)
                if done:
                    return receiving.result()
                self.left_s -= turn_s
            raise TimeoutError
        finally:
            with suppress(EOFError, OSError):
                await stop_tasks(receiving)


class WorkerPool(Generic[Order, Outcome]):
    """A pool of up to `jobs` workers that fly orders.

    done: called with an order and its outcome; an order that it returns is flown next. ready:
    called with an order before it is flown; returns it completed, or None to skip it.

    stall_s: a worker that has reported and then sends nothing for so long is killed: it hangs, or
    was stopped. Its guard brings its vehicles down. ended_badly: called with the reason when a
    worker that had done its order did not end properly. begun: called with an order and its place.
    run_of: returns the name of an order's run, by which commands address it.
    """

    def __init__(
        self,
        *,
        jobs: int,
        workers: WorkerStarter[Order, Outcome],
        report: Report,
        done: Callable[[Order, Outcome | WorkerLost], Order | None],
        stall_s: float = 60.0,
        ended_badly: Callable[[str], None] = lambda _: None,
        ready: Callable[[Order], Order | None] = lambda order: order,
        begun: Callable[[Order, FlightPlace], None] = lambda _, __: None,
        run_of: Callable[[Order], str] = str,
    ) -> None:
        self._begun = begun
        self._run_of = run_of
        self._barred: list[OperatorCommand] = []
        self._ready = ready
        self._ended_badly = ended_badly
        self._jobs = jobs
        self._workers = workers
        self._report = report
        self._done = done
        self._stall_s = stall_s
        self._busy: list[_BusyWorker[Order, Outcome]] = []
        self._stopped: OperatorCommand | None = None
        self._going = asyncio.Event()
        self._going.set()
        self._needless = asyncio.Event()
        """Set while no order waits for a worker."""

    def abort(self, command: OperatorCommand) -> None:
        """Abort every worker's run, which lands; orders not begun are not flown.

        A command for one node or bench does so for the workers there, and bars that place.
        """
        if command.is_partial:
            self._barred.append(command)
            self.pass_on(command)
            return
        self._stopped = command
        self._going.set()
        self._needless.set()
        for busy in self._busy:
            busy.shorten_limit()
        self.pass_on(command)

    def pass_on(self, command: OperatorCommand) -> int:
        """Pass an operator command to every worker's run that it addresses; return how many.

        An exception of one worker keeps it from no other; raises an ExceptionGroup of them then.
        """
        addressed = [
            busy
            for busy in self._busy
            if command.is_for(busy.run) and _is_for(command, busy.worker.place)
        ]
        missed, errors = [], []
        for busy in addressed:
            try:
                busy.worker.send(command)
            except Exception as error:  # noqa: BLE001  # raised below
                missed.append(busy.run)
                errors.append(error)
        if errors:
            raise ExceptionGroup(f"{command.kind} was not passed to {', '.join(missed)}", errors)
        return len(addressed)

    def pause(self) -> None:
        """Begin no order until `go_on`; runs in flight continue."""
        self._going.clear()

    def go_on(self) -> None:
        """Begin orders again."""
        self._going.set()

    async def fly(self, orders: Iterable[Order]) -> None:
        """Fly all orders on the workers, in this order; return when no worker is left."""
        waiting = deque(orders)
        async with asyncio.TaskGroup() as group:
            for number in range(min(self._jobs, len(waiting))):
                group.create_task(self._serve(waiting), name=f"worker {number}")

    async def _serve(self, waiting: "deque[Order]") -> None:
        worker: Worker[Order, Outcome] | None = None
        try:
            while waiting:
                await self._going.wait()
                if worker is None:
                    worker = await self._start_worker()
                await self._going.wait()
                if worker is None or self._stopped is not None or not waiting:
                    break
                if any(_is_for(command, worker.place) for command in self._barred):
                    worker.kill()  # so that this place gets no further order
                    break
                order = self._ready(waiting.popleft())
                self._note_waiting(waiting)
                if order is None:
                    continue
                outcome = await self._fly_one(worker, order)
                over, worker = worker, None
                is_lost = isinstance(outcome, WorkerLost)
                await self._end(over, is_lost=is_lost, after=self._run_of(order))
                again = self._done(order, outcome)
                if again is not None:
                    waiting.appendleft(again)
                    self._note_waiting(waiting)
        finally:
            if worker is not None:
                await self._end(worker, is_lost=False)

    async def _end(self, worker: Worker[Order, Outcome], *, is_lost: bool, after: str = "") -> None:
        """End a worker; report a problem with that, unless its run is lost anyway.

        after: the run that it flew; "" for none.
        """
        ended = await finish_in_task(worker.end(), name="the end of a worker")
        if ended and not is_lost:
            self._ended_badly(f"after {after}: {ended}" if after else ended)

    def _note_waiting(self, waiting: "deque[Order]") -> None:
        if self._stopped is None and waiting:
            self._needless.clear()
        else:
            self._needless.set()

    async def _start_worker(self) -> Worker[Order, Outcome] | None:
        """Return a new worker; None if by then no order waits for one.

        Starting the run server takes seconds, and a place on a cluster may take long; signals are
        handled meanwhile.
        """
        starting = start_task(self._workers.start(), name="the start of a worker")
        needless = start_task(self._needless.wait(), name="the end of waiting orders")
        try:
            await asyncio.wait([starting, needless], return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            await stop_tasks(needless, starting)
            if not starting.cancelled():
                starting.result().kill()
            raise
        await stop_tasks(needless)
        if not starting.done():
            await stop_tasks(starting)
        return None if starting.cancelled() else starting.result()

    async def _fly_one(self, worker: Worker[Order, Outcome], order: Order) -> Outcome | WorkerLost:
        busy = _BusyWorker(worker, self._run_of(order))
        self._busy.append(busy)
        self._begun(order, worker.place)
        patience_s = busy.left_s
        try:
            await worker.begin(order)
            if self._stopped is not None:
                busy.shorten_limit()
            while True:
                message = await busy.receive()
                busy.is_preparing = False
                busy.left_s = patience_s = self._stall_s
                if isinstance(message, OrderDone):
                    outcome: Outcome | WorkerLost = message.outcome
                    return outcome
                if isinstance(message, News):
                    self._report(message)
        except TimeoutError:
            worker.kill()
            reason = f"its process did not respond for {patience_s:g} s; it was killed"
            if busy.is_preparing and self._stopped is not None:
                reason = "aborted before its process had prepared the run; it was killed"
            return await worker.outcome_of_lost(reason)
        except (EOFError, OSError):
            return await worker.outcome_of_lost("")
        finally:
            self._busy.remove(busy)


def _is_for(command: OperatorCommand, place: FlightPlace) -> bool:
    return place.is_meant(node=command.node, bench=command.bench)
