"""The worker pool: flies orders on workers, as many at once as there are jobs.

A worker that is lost takes one run with it, never more: the caller is told and a new worker takes
the next run.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic

from orchestrator.campaign.workers.run_workers import (
    Order,
    OrderDone,
    Outcome,
    Worker,
    WorkerLost,
    Workers,
)
from orchestrator.model.flight_place import FlightPlace
from orchestrator.model.progress import News, Report
from safety.guard.core.operator_command import OperatorCommand
from vehicles.tasks import finish, start, stop

_FIRST_WORD_S = 600.0
"""Until its first word a worker loads the campaign's files and compiles."""
_ABORTED_S = 5.0
"""What is left of that once an abort has come: nothing flies yet that would have to land."""


@dataclass(slots=True)
class _BusyWorker(Generic[Order, Outcome]):
    worker: Worker[Order, Outcome]
    preparing: asyncio.Timeout | None = None
    """Runs until the first word of the present order."""

    def hurry(self) -> None:
        """Have a worker that has not said anything yet do so soon, or be killed."""
        if self.preparing is not None:
            due_s = asyncio.get_running_loop().time() + _ABORTED_S
            self.preparing.reschedule(min(due_s, self.preparing.when() or due_s))


class Pool(Generic[Order, Outcome]):
    """A pool of up to `jobs` workers that fly orders; outcomes come when done.

    done: takes an order's outcome; what it returns is flown next. ready: takes an order when its
    turn has come, and returns it with what is known by then; None: it is not flown any more.

    stall_s: a worker that has reported and then says nothing for so long is killed: it hangs, or
    was stopped. Its guard brings its vehicles down. ended_badly: told of a worker that had done all
    its orders and then did not end as it should. begun: told of an order and where it is flown.
    """

    def __init__(
        self,
        *,
        jobs: int,
        workers: Workers[Order, Outcome],
        report: Report,
        done: Callable[[Order, Outcome | WorkerLost], Order | None],
        stall_s: float = 60.0,
        ended_badly: Callable[[str], None] = lambda _: None,
        ready: Callable[[Order], Order | None] = lambda order: order,
        begun: Callable[[Order, FlightPlace], None] = lambda _, __: None,
    ) -> None:
        self._begun = begun
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
        """Have every worker's run land as aborted; orders not begun are not flown.

        One for a node or a bench does so for the workers there alone, and bars the place.
        """
        if command.is_partial:
            self._barred.append(command)
            self.pass_on(command)
            return
        self._stopped = command
        self._going.set()
        self._needless.set()
        self.pass_on(command)
        for busy in self._busy:
            busy.hurry()

    def pass_on(self, command: OperatorCommand) -> int:
        """Pass an operator command to every worker's run that it is for; return how many."""
        meant = [busy for busy in self._busy if _is_for(command, busy.worker.place)]
        for busy in meant:
            busy.worker.send(command)
        return len(meant)

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
                    worker.kill()  # no other task gets it, and so ends without its orders
                    break
                order = self._ready(waiting.popleft())
                self._note_waiting(waiting)
                if order is None:
                    continue
                outcome = await self._fly_one(worker, order)
                over, worker = worker, None
                await self._end(over, is_lost=isinstance(outcome, WorkerLost))
                again = self._done(order, outcome)
                if again is not None:
                    waiting.appendleft(again)
                    self._note_waiting(waiting)
        finally:
            if worker is not None:
                await self._end(worker, is_lost=False)

    async def _end(self, worker: Worker[Order, Outcome], *, is_lost: bool) -> None:
        """End a worker; report what was wrong with that, unless it is lost anyway."""
        ended = await finish(worker.end(), name="the end of a worker")
        if ended and not is_lost:
            self._ended_badly(ended)

    def _note_waiting(self, waiting: "deque[Order]") -> None:
        """Take whether an order still waits for a worker."""
        if self._stopped is None and waiting:
            self._needless.clear()
        else:
            self._needless.set()

    async def _start_worker(self) -> Worker[Order, Outcome] | None:
        """Return a new worker; None where by then no order waits for one.

        Preparing the run server takes seconds, a place on a cluster as long as others have it;
        signals are heeded meanwhile.
        """
        starting = start(self._workers.start(), name="the start of a worker")
        needless = start(self._needless.wait(), name="orders that wait for a worker")
        try:
            await asyncio.wait([starting, needless], return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            await stop(needless, starting)
            if not starting.cancelled():
                starting.result().kill()
            raise
        await stop(needless)
        if not starting.done():
            await stop(starting)
        return None if starting.cancelled() else starting.result()

    async def _fly_one(self, worker: Worker[Order, Outcome], order: Order) -> Outcome | WorkerLost:
        busy = _BusyWorker(worker)
        self._busy.append(busy)
        patience_s = _FIRST_WORD_S
        self._begun(order, worker.place)
        try:
            await worker.begin(order)
            while True:
                async with asyncio.timeout(patience_s) as preparing:
                    busy.preparing = preparing if patience_s == _FIRST_WORD_S else None
                    if busy.preparing is not None and self._stopped is not None:
                        busy.hurry()
                    message = await worker.receive()
                busy.preparing = None
                patience_s = self._stall_s
                if isinstance(message, OrderDone):
                    outcome: Outcome | WorkerLost = message.outcome
                    return outcome
                if isinstance(message, News):
                    self._report(message)
        except TimeoutError:
            worker.kill()
            reason = f"its process did not respond for {patience_s:g} s; it was killed"
            if busy.preparing is not None and self._stopped is not None:
                reason = "aborted before its process had prepared the run; it was killed"
            return await worker.outcome_of_lost(reason)
        except (EOFError, OSError):
            return await worker.outcome_of_lost("")
        finally:
            busy.preparing = None
            self._busy.remove(busy)


def _is_for(command: OperatorCommand, place: FlightPlace) -> bool:
    """Return whether an operator's command is for what flies at a place."""
    return place.is_meant(node=command.node, bench=command.bench)
