"""The driver's end of its mavsdk process: started, spoken to, watched, and ended for certain."""

import asyncio
import re
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

from vehicles.driver.session.repeater import Repeater
from vehicles.errors import VehicleError
from vehicles.links.link import LinkError
from vehicles.mavsdk.line_socket import LineSocket
from vehicles.mavsdk.messages import (
    Alive,
    Done,
    FromProcess,
    NotSent,
    Order,
    Progress,
    Ready,
    Refused,
    SendMessage,
)
from vehicles.processes.child import ChildProcess, how_it_ended

FailureListener = Callable[[VehicleError], None]

_START_S = 20.0
_SILENT_S = 5.0
"""It gives a sign five times a second, and a busy machine may keep it for seconds."""
_FLYING_SILENT_S = 0.8
"""While it has setpoints to say: at 1 s PX4 falls into its own failsafe, which would be blamed."""
_WATCH_S, _KEPT_S = 0.1, 0.3
"""A look of ours that comes so late was kept itself: that time is no silence of the other end."""
_LOG_LINE = re.compile(r"\|(Debug|Info |Warn )\]")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_SETPOINTS = {"SET_POSITION_TARGET_LOCAL_NED"}
_NOT_THERE = re.compile(r"(ModuleNotFound|Import)Error: .*'mavsdk[.']")
"""Also what is said of mavsdk 3, which was another library."""
_INSTALL = "the driver mavsdk needs the package of that name: pip install 'mavsdk>=4.1,<5'"


class RefusedError(VehicleError):
    """mavsdk refused an order; result: its word for why."""

    def __init__(self, message: str, result: str) -> None:
        super().__init__(message)
        self.result = result


@dataclass(slots=True)
class _Waiting:
    """A mavsdk order without its reply. until_s: when to give up, on the wall clock."""

    future: asyncio.Future[Done]
    what: str
    until_s: float
    progress: Callable[[float], None] | None


class MavsdkClient:
    """The client of a mavsdk process. name: of the vehicle, for messages.

    Limits are on the wall's clock, whatever the loop's: mavsdk knows no other. When the process
    dies or hangs, all that waits raises the VehicleError that `on_failure` is told.
    """

    def __init__(self, *, name: str) -> None:
        self._name = name
        self._child: ChildProcess | None = None
        self._lines: LineSocket | None = None
        self._ready: asyncio.Future[None] | None = None
        self._waiting: dict[int, _Waiting] = {}
        self._count = 0
        self._heard_s = 0.0
        self._owed_s: float | None = None
        self._looked_s = 0.0
        self._failure: VehicleError | None = None
        self._listeners: list[FailureListener] = []
        self._watch = Repeater(period_s=_WATCH_S, action=self._look)
        self.late = 0
        """Messages that were not said because they came too late."""

    @property
    def pid(self) -> int | None:
        """Return the mavsdk process's id; None before the start."""
        return None if self._child is None else self._child.pid

    @property
    def failed(self) -> bool:
        """Return whether the mavsdk process has died or hangs."""
        return self._failure is not None

    def on_failure(self, listener: FailureListener) -> None:
        """Call `listener` once when the mavsdk process has died or hangs."""
        self._listeners.append(listener)

    async def start(self, url: str) -> None:
        """Start the mavsdk process on this connection. Raises LinkError."""
        ours, theirs = socket.socketpair()
        self._ready = asyncio.get_running_loop().create_future()
        self._child = ChildProcess(
            argv=(sys.executable, "-m", "vehicles.mavsdk", url), stdin=theirs.fileno()
        )
        self._heard_s = time.monotonic() + _START_S - _SILENT_S
        try:
            self._child.start(self._on_exit)
        except OSError as error:
            ours.close()
            self._ready.cancel()
            raise LinkError(f"{self._name}: mavsdk's process cannot start: {error}") from error
        finally:
            theirs.close()
        self._lines = await LineSocket.on(ours, self._take)
        self._looked_s = time.monotonic()
        self._watch.start()
        try:
            await self._ready
        except VehicleError as error:
            await self.end()
            raise LinkError(str(error)) from error
        except BaseException:
            await self.end()
            raise

    async def end(self) -> None:
        """End the mavsdk process and all that waits for it."""
        self._watch.stop()
        self._failure = self._failure or VehicleError(f"{self._name}: mavsdk was ended")
        self._give_up(self._failure)
        if self._lines is not None:
            self._lines.close()
        if self._child is not None:
            await self._child.end()

    def say(self, name: str, fields: str) -> None:
        """Send a message by mavsdk; nothing when the process is gone."""
        if self._lines is not None and self._failure is None:
            now_s = time.monotonic()
            if self._owed_s is None and name in _SETPOINTS:
                self._owed_s = now_s
            self._lines.write(SendMessage(name, fields, now_s))

    async def order(
        self,
        make: Callable[[int], Order],
        what: str,
        within_s: float,
        progress: Callable[[float], None] | None = None,
    ) -> Done:
        """Execute an order by mavsdk. make: gives it the number of its reply.

        Raises RefusedError with mavsdk's word, and VehicleError when there is no answer.
        """
        if self._failure is not None:
            raise self._failure
        if self._lines is None:
            raise VehicleError(f"{self._name}: mavsdk was not started yet")
        self._count = number = self._count + 1
        future: asyncio.Future[Done] = asyncio.get_running_loop().create_future()
        self._waiting[number] = _Waiting(future, what, time.monotonic() + within_s, progress)
        self._lines.write(make(number))
        try:
            return await future
        finally:
            del self._waiting[number]

    def _take(self, message: FromProcess) -> None:
        self._heard_s = max(self._heard_s, time.monotonic())
        match message:
            case Ready():
                self._heard_s = time.monotonic()
                if self._ready is not None and not self._ready.done():
                    self._ready.set_result(None)
            case Alive(late=late):
                # Of the thread that says messages: an order may be answered while that one hangs.
                self._owed_s, self.late = None, late
            case NotSent(name=name, result=result):
                self._fail(f"mavsdk cannot say {name} ({result})")
            case _:
                self._on_answer(message)

    def _on_answer(self, message: Done | Refused | Progress) -> None:
        """Handle a reply of the mavsdk process to an order."""
        waiting = self._waiting.get(message.number)
        if waiting is None or waiting.future.done():
            return
        match message:
            case Done():
                waiting.future.set_result(message)
            case Refused(result=result):
                text = f"{self._name}: {waiting.what}: mavsdk says {result}"
                waiting.future.set_exception(RefusedError(text, result))
            case Progress(part=part):
                if waiting.progress is not None:
                    waiting.progress(part)

    def _look(self) -> None:
        now_s = time.monotonic()
        kept_s, self._looked_s = now_s - self._looked_s, now_s
        if kept_s > _KEPT_S:
            self._forgive(kept_s)
        owes = self._owed_s is not None and now_s - self._owed_s > _FLYING_SILENT_S
        if owes or now_s - self._heard_s > _SILENT_S:
            silent_s = now_s - self._heard_s
            self._fail(f"mavsdk's process hangs: no response for {silent_s:.1f} s")
            return
        for waiting in self._waiting.values():
            if now_s > waiting.until_s and not waiting.future.done():
                text = f"{self._name}: {waiting.what}: mavsdk did not answer"
                waiting.future.set_exception(RefusedError(text, "TIMEOUT"))

    def _forgive(self, kept_s: float) -> None:
        self._heard_s += kept_s
        if self._owed_s is not None:
            self._owed_s += kept_s
        for waiting in self._waiting.values():
            waiting.until_s += kept_s

    def _on_exit(self, child: ChildProcess) -> None:
        said = _last_line(child.stderr_tail)
        self._fail(f"mavsdk's process {how_it_ended(child.exit_code)}{said}")

    def _fail(self, what: str) -> None:
        if self._failure is not None:
            return
        self._watch.stop()
        self._failure = VehicleError(f"{self._name}: {what}; nothing more is sent to it")
        if self._child is not None:
            # What hangs might wake and go on with what it was told.
            self._child.kill()
        self._give_up(self._failure)
        for listener in self._listeners:
            listener(self._failure)

    def _give_up(self, error: VehicleError) -> None:
        if self._ready is not None and not self._ready.done():
            self._ready.set_exception(error)
        for waiting in self._waiting.values():
            if not waiting.future.done():
                waiting.future.set_exception(error)


def _last_line(text: str) -> str:
    """Return the last line of mavsdk's output that is no routine log."""
    plain = _COLOUR.sub("", text)
    lines = [line for line in plain.splitlines() if line.strip() and not _LOG_LINE.search(line)]
    if not lines:
        return ""
    if _NOT_THERE.match(lines[-1]):
        return f": {_INSTALL}"
    return f": {lines[-1].strip()}"
