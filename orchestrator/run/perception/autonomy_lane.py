"""Where the calls of an autonomy are made: in the loop, or in a thread of their own beside it.

On the wall clock nothing of the autonomy's may hold up the loop, which is the guard's heartbeat and
the judge's eye: a thread makes the calls, in their order. On other clocks time waits for them.
"""

import asyncio
import contextlib
import ctypes
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from queue import SimpleQueue
from typing import Protocol

from wil_campaign.foundation.processes.linux import processor_wait_s
from wil_campaign.orchestrator.run.perception.autonomy_calls import (
    AutonomyFault,
    HangWarning,
    call_autonomy,
    checked_command,
    frames_in_words,
    require_method_ran,
)
from wil_campaign.orchestrator.state.call_marker import marked_autonomy_call
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.copies import copied_reading

Perceive = Callable[[Reading], object]
Act = Callable[[], object]

LONGEST_BEHIND_S = 0.8
"""How far an autonomy may be behind its calls, in one of them or by and by: PX4 ends OFFBOARD 1 s
after the last setpoint (COM_OF_LOSS_T), and the reason is to be the autonomy's, not its."""
_OLDEST_S = 10.0
"""How long a reading may wait for `perceive` before the goal, when nothing is asked of `act`."""
_LOOK_S = 0.05
_HELD_S = 0.5
"""Processor time of one call that explains why nothing else of the process ran."""
_LATELY_S = 3.0


@dataclass(slots=True)
class CallTimes:
    """What calls of one kind took, in seconds: without what the machine made them wait."""

    count: int = 0
    total_s: float = 0.0
    longest_s: float = 0.0

    def add(self, took_s: float) -> None:
        """Add a call."""
        self.count += 1
        self.total_s += took_s
        self.longest_s = max(self.longest_s, took_s)

    def __str__(self) -> str:
        mean_s = self.total_s / self.count if self.count else 0.0
        return f"{mean_s:.3f} s on average and {self.longest_s:.3f} s at most"


class AutonomyLane(Protocol):
    """Makes the calls of one autonomy, in their order (protocol)."""

    act_times: CallTimes
    perceive_times: CallTimes

    def offer(self, perceive: Perceive, reading: Reading, method: str) -> None:
        """Give the autonomy a copy of a reading. method: its name. Raises AutonomyFault."""

    async def act(self, act: Act) -> Command:
        """Return the autonomy's command. Raises AutonomyFault."""

    def held_up(self) -> str:
        """Return in words how a call has lately kept the loop from running; "" where none has."""

    def close(self) -> None:
        """End the calls; one that hangs is given up."""


class LoopLane:
    """Calls made in the loop: it stands still meanwhile. call_s: limit of one. check: after each.

    name: of the vehicle. check may raise AutonomyFault.
    """

    def __init__(self, *, name: str, call_s: float, check: Callable[[], None]) -> None:
        self._name = name
        self._call_s = call_s
        self._check = check
        self.act_times, self.perceive_times = CallTimes(), CallTimes()

    def offer(self, perceive: Perceive, reading: Reading, method: str) -> None:
        """Give the autonomy a copy of a reading. Raises AutonomyFault."""
        with _measured(self.perceive_times), marked_autonomy_call(self._name):
            answer = call_autonomy(lambda: perceive(copied_reading(reading)), within_s=self._call_s)
        self._check()
        require_method_ran(answer, method)

    async def act(self, act: Act) -> Command:
        """Return the autonomy's command at once. Raises AutonomyFault."""
        with _measured(self.act_times), marked_autonomy_call(self._name, has_goal=True):
            answer = call_autonomy(act, within_s=self._call_s)
        self._check()
        return checked_command(answer)

    def held_up(self) -> str:
        """Return "": where the loop makes the calls, no guard waits for it."""
        return ""

    def close(self) -> None:
        """Do nothing: no call is in progress."""


@dataclass(slots=True, eq=False)
class _Job:
    """A call for the thread. answer: set in the loop. Times: None before it began, or ended."""

    name: str
    call: Act
    answer: "asyncio.Future[Command | None]"
    began_cpu_s: float | None = None
    ended_s: float | None = None


@dataclass(slots=True)
class _Held:
    """A call that used the processor for long. at_s: when it ended, monotonic."""

    name: str = ""
    cpu_s: float = 0.0
    at_s: float = field(default=-_LATELY_S)


class ThreadLane:
    """Calls made in a thread of their own, on the wall clock, while the loop goes on.

    rate_hz: of `act`. An autonomy that is behind its calls for longer than `longest_s` is too slow:
    its fault. What the machine made it wait, or slept itself, does not count. fault: called with a
    fault of `perceive`, whose caller does not wait. To be made in the loop.
    """

    def __init__(
        self,
        *,
        name: str,
        rate_hz: float,
        call_s: float,
        check: Callable[[], None],
        fault: Callable[[AutonomyFault], None],
        longest_s: float = LONGEST_BEHIND_S,
    ) -> None:
        self._name = name
        self._rate_hz, self._call_s, self._longest_s = rate_hz, call_s, longest_s
        self._check, self._fault = check, fault
        self.act_times, self.perceive_times = CallTimes(), CallTimes()
        self._behind_s = 0.0
        self._waiting: deque[float] = deque()
        self._jobs: SimpleQueue[_Job | None] = SimpleQueue()
        self._job: _Job | None = None
        self._holding_call = _Held()
        self._is_over = False
        self._loop = asyncio.get_running_loop()
        self._thread = threading.Thread(target=self._work, name=f"autonomy of {name}", daemon=True)
        self._thread.start()

    def offer(self, perceive: Perceive, reading: Reading, method: str) -> None:
        """Queue a copy of a reading for the autonomy. Raises AutonomyFault."""
        own = call_autonomy(lambda: copied_reading(reading))
        now_s = time.monotonic()
        if self._waiting and now_s - self._waiting[0] > _OLDEST_S:
            text = f"{len(self._waiting)} readings wait, the first for {_OLDEST_S:g} s"
            raise self._too_slow(text)
        answer: asyncio.Future[Command | None] = self._loop.create_future()
        answer.add_done_callback(self._perceived)
        self._waiting.append(now_s)
        self._jobs.put(_Job(method, lambda: perceive(own), answer))

    async def act(self, act: Act) -> Command:
        """Return the autonomy's command, after the readings before it. Raises AutonomyFault."""
        answer: asyncio.Future[Command | None] = self._loop.create_future()
        job = _Job("act", act, answer)
        thread, asked_s = self._thread.native_id or 0, time.monotonic()
        waited_s, cpu_s, passed_s = processor_wait_s(thread), self._cpu_s(), 0.0
        self._jobs.put(job)
        while True:
            began_s = time.monotonic()
            await asyncio.wait([answer], timeout=_LOOK_S)
            # Of a process that was stopped, and of a machine that was, little is counted.
            passed_s += min(time.monotonic() - began_s, 2.0 * _LOOK_S)
            if job.ended_s is not None:
                passed_s = min(passed_s, job.ended_s - asked_s)
            took_s = max(
                passed_s - (processor_wait_s(thread) - waited_s), self._cpu_s() - cpu_s, 0.0
            )
            behind_s = max(0.0, self._behind_s + took_s - 1.0 / self._rate_hz)
            if answer.done() and (answer.exception() is not None or took_s <= self._call_s):
                break
            if took_s > self._call_s:
                raise self._no_answer()
            if behind_s > self._longest_s:
                now = f"act has not answered for {took_s:.2f} s{self._place()}"
                raise self._too_slow(f"it is {behind_s:.2f} s behind: {now}")
        command = answer.result()
        self.act_times.add(took_s)
        self._behind_s = behind_s
        if behind_s > self._longest_s:
            raise self._too_slow(f"it is {behind_s:.2f} s behind")
        if command is None:
            raise RuntimeError("a call of act has no command")
        return command

    def held_up(self) -> str:
        """Return in words how a call has lately kept the loop from running; "" where none has."""
        job, held = self._job, self._holding_call
        if job is not None and job.began_cpu_s is not None:
            cpu_s = self._cpu_s() - job.began_cpu_s
            if cpu_s >= _HELD_S:
                return self._holding(job.name, cpu_s) + self._place()
        is_recent = time.monotonic() - held.at_s <= _LATELY_S
        return self._holding(held.name, held.cpu_s) if is_recent else ""

    def close(self) -> None:
        """End the calls; one that hangs is interrupted, and given up where it cannot be."""
        self._is_over = True
        self._jobs.put(None)
        if self._job is not None and self._thread.ident is not None:
            ctypes.pythonapi.PyThreadState_SetAsyncExc(
                ctypes.c_ulong(self._thread.ident), ctypes.py_object(HangWarning)
            )

    def _work(self) -> None:
        with contextlib.suppress(HangWarning):
            while (job := self._jobs.get()) is not None:
                if not self._is_over:
                    self._do(job)

    def _do(self, job: _Job) -> None:
        """Make a call, and hand its answer to the loop."""
        fault: AutonomyFault | None = None
        answer: Command | None = None
        self._job, job.began_cpu_s = job, time.thread_time()
        try:
            is_act = job.name == "act"
            times = CallTimes() if is_act else self.perceive_times
            with _measured(times), marked_autonomy_call(self._name, has_goal=is_act):
                returned = call_autonomy(job.call)
            self._check()
            if is_act:
                answer = checked_command(returned)
            else:
                require_method_ran(returned, job.name)
        except AutonomyFault as error:
            fault = error
        finally:
            self._job, job.ended_s = None, time.monotonic()
        cpu_s = time.thread_time() - job.began_cpu_s
        if cpu_s >= _HELD_S:
            self._holding_call = _Held(job.name, cpu_s, time.monotonic())
        with contextlib.suppress(RuntimeError):  # the loop has closed meanwhile
            self._loop.call_soon_threadsafe(_settle, job.answer, answer, fault)

    def _perceived(self, answer: "asyncio.Future[Command | None]") -> None:
        self._waiting.popleft()
        error = answer.exception()
        if isinstance(error, AutonomyFault) and not self._is_over:
            self._fault(error)

    def _cpu_s(self) -> float:
        """Return the processor time of the thread, from any other one; 0 once it has ended."""
        if self._thread.ident is None or not self._thread.is_alive():
            return 0.0
        with contextlib.suppress(OSError):
            return time.clock_gettime(time.pthread_getcpuclockid(self._thread.ident))
        return 0.0

    def _place(self) -> str:
        """Return where in the autonomy's code the thread is, in brackets; "" where unknown."""
        frame = sys._current_frames().get(self._thread.ident or 0)  # noqa: SLF001 - has no other name
        found = "" if frame is None else frames_in_words(traceback.extract_stack(frame))
        return f" ({found})" if found else ""

    def _no_answer(self) -> AutonomyFault:
        limit = f"{self._call_s:g} s, its limit (autonomy.limits.call_s)"
        return AutonomyFault(f"gave no answer within {limit}{self._place()}")

    def _too_slow(self, text: str) -> AutonomyFault:
        perceive = f"; perceive took {self.perceive_times}" if self.perceive_times.count else ""
        act = f"act took {self.act_times}" if self.act_times.count else "no act was answered"
        return AutonomyFault(
            f"is too slow for the wall clock: {text}; {act}, of the {1.0 / self._rate_hz:.3f} s "
            f"between two of them (autonomy.rate_hz){perceive}"
        )

    @staticmethod
    def _holding(name: str, cpu_s: float) -> str:
        return (
            f"held up the program: {name} used the processor for {cpu_s:.2f} s without letting "
            "anything else of Python run"
        )


def _settle(
    future: "asyncio.Future[Command | None]", answer: Command | None, fault: AutonomyFault | None
) -> None:
    if future.done():
        return
    if fault is None:
        future.set_result(answer)
    else:
        future.set_exception(fault)
        future.exception()  # it is looked at, or its caller has gone


@contextlib.contextmanager
def _measured(times: CallTimes) -> Iterator[None]:
    thread = threading.get_native_id()
    began_s, waited_s = time.monotonic(), processor_wait_s(thread)
    try:
        yield
    finally:
        waited_s = processor_wait_s(thread) - waited_s
        times.add(max(0.0, time.monotonic() - began_s - waited_s))
