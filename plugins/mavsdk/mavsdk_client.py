"""The driver's client of its mavsdk process: starts, monitors and ends it, and sends it orders.

The driver's socket to a mavsdk process: writes and reads whole messages without waiting.
"""

import asyncio
import re
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, cast

from wil_campaign.foundation.processes.child import ChildProcess, exit_status_text
from wil_campaign.foundation.processes.codec import FrameReader, ProcessMessageError, framed_packet
from wil_campaign.plugins.mavsdk.messages import (
    FromProcess,
    LogProgress,
    MavsdkAlive,
    MavsdkReady,
    MessageNotSent,
    Order,
    OrderExecuted,
    OrderRefused,
    SendMessage,
    ToProcess,
    from_process,
    to_process,
)
from wil_campaign.vehicles.driver.session.repeater import Repeater
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link import LinkError

_LONGEST_QUEUE_BYTES = 4 << 20
"""A process that does not read counts as hung long before; a mission of thousands fits in."""


class MessageSocket(asyncio.Protocol):
    """A socket of messages: writes them, and passes received ones on; `garbage`: unreadable."""

    def __init__(self, on_message: Callable[[FromProcess], None]) -> None:
        self._on_message = on_message
        self._frames = FrameReader()
        self._transport: asyncio.Transport | None = None
        self.garbage = 0

    @classmethod
    async def on(cls, end: socket.socket, on_message: Callable[[FromProcess], None]) -> Self:
        """Return a line socket on this socket, which it closes."""
        loop = asyncio.get_running_loop()
        end.setblocking(False)
        _, lines = await loop.create_connection(lambda: cls(on_message), sock=end)
        return lines

    def write(self, message: ToProcess) -> None:
        """Write a message to the line socket; dropped when the other end is gone or full."""
        transport, frame = self._transport, framed_packet(to_process.encode(message))
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() + len(frame) <= _LONGEST_QUEUE_BYTES:
            transport.write(frame)

    def close(self) -> None:
        """Close the line socket."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the line socket's transport (asyncio calls this)."""
        self._transport = cast("asyncio.Transport", transport)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's
        """Drop the transport (asyncio calls this); the process's exit is reported elsewhere."""
        self._transport = None

    def data_received(self, data: bytes) -> None:
        """Pass the line socket's whole messages on (asyncio calls this)."""
        for packet in self._frames.feed(data):
            try:
                message = from_process.decode(packet)
            except ProcessMessageError:
                self.garbage += 1
                continue
            self._on_message(message)


FailureListener = Callable[[VehicleError], None]

_START_S = 20.0
_SILENT_S = 5.0
"""It sends `MavsdkAlive` five times a second, and a busy machine may delay that by seconds."""
_FLYING_SILENT_S = 0.8
"""The limit while it has setpoints to send: after 1 s without, PX4 enters its own failsafe, which
would seem to be the cause."""
_CHECK_EVERY_S, _OWN_DELAY_S = 0.1, 0.3
"""A check that comes so late was delayed on our side: that time is no silence of the process."""
_LOG_LINE = re.compile(r"\|(Debug|Info |Warn )\]")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_SETPOINTS = {"SET_POSITION_TARGET_LOCAL_NED"}
_IMPORT_FAILED = re.compile(r"(ModuleNotFound|Import)Error: .*'mavsdk[.']")
"""The message also for mavsdk 3, which was another library."""
_INSTALL = "the driver mavsdk needs the package of that name: pip install 'mavsdk>=4.1,<5'"


class MavsdkRefusedError(VehicleError):
    """mavsdk refused an order; result: the name of its result."""

    def __init__(self, message: str, result: str) -> None:
        super().__init__(message)
        self.result = result


@dataclass(slots=True)
class _Waiting:
    """A mavsdk order that awaits its reply. until_s: its deadline, on the wall clock."""

    future: asyncio.Future[OrderExecuted]
    what: str
    until_s: float
    progress: Callable[[float], None] | None


class MavsdkClient:
    """The client of a mavsdk process. name: of the vehicle, for messages.

    Deadlines are on the wall clock, whatever the loop's clock: mavsdk knows no other. When the
    process dies or hangs, all waits raise the VehicleError that `on_failure` reports.
    """

    def __init__(self, *, name: str) -> None:
        self._name = name
        self._child: ChildProcess | None = None
        self._lines: MessageSocket | None = None
        self._ready: asyncio.Future[None] | None = None
        self._waiting: dict[int, _Waiting] = {}
        self._count = 0
        self._last_received_s = 0.0
        self._unconfirmed_since_s: float | None = None
        self._last_check_s = 0.0
        self._failure: VehicleError | None = None
        self._listeners: list[FailureListener] = []
        self._watch = Repeater(period_s=_CHECK_EVERY_S, action=self._check_process)
        self.late = 0
        """Number of messages that were not sent because they came too late."""

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
            argv=(sys.executable, "-P", "-m", "wil_campaign.plugins.mavsdk", url),
            stdin=theirs.fileno(),
        )
        self._last_received_s = time.monotonic() + _START_S - _SILENT_S
        try:
            self._child.start(self._on_exit)
        except OSError as error:
            ours.close()
            self._ready.cancel()
            raise LinkError(f"{self._name}: the mavsdk process cannot start: {error}") from error
        finally:
            theirs.close()
        self._lines = await MessageSocket.on(ours, self._on_message)
        self._last_check_s = time.monotonic()
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
        """End the mavsdk process and all waits for it."""
        self._watch.stop()
        self._failure = self._failure or VehicleError(f"{self._name}: the mavsdk process was ended")
        self._give_up(self._failure)
        if self._lines is not None:
            self._lines.close()
        if self._child is not None:
            await self._child.end()

    def send_message(self, name: str, fields: str) -> None:
        """Send a message through mavsdk; does nothing when the process is gone."""
        if self._lines is not None and self._failure is None:
            now_s = time.monotonic()
            if self._unconfirmed_since_s is None and name in _SETPOINTS:
                self._unconfirmed_since_s = now_s
            self._lines.write(SendMessage(name, fields, now_s))

    async def order(
        self,
        make: Callable[[int], Order],
        what: str,
        within_s: float,
        progress: Callable[[float], None] | None = None,
    ) -> OrderExecuted:
        """Execute an order by mavsdk. make: builds the order with its number.

        Raises RefusedError with mavsdk's result, and VehicleError when the process has failed.
        """
        if self._failure is not None:
            raise self._failure
        if self._lines is None:
            raise VehicleError(f"{self._name}: the mavsdk process is not started yet")
        self._count = number = self._count + 1
        future: asyncio.Future[OrderExecuted] = asyncio.get_running_loop().create_future()
        self._waiting[number] = _Waiting(future, what, time.monotonic() + within_s, progress)
        self._lines.write(make(number))
        try:
            return await future
        finally:
            del self._waiting[number]

    def _on_message(self, message: FromProcess) -> None:
        self._last_received_s = max(self._last_received_s, time.monotonic())
        match message:
            case MavsdkReady():
                self._last_received_s = time.monotonic()
                if self._ready is not None and not self._ready.done():
                    self._ready.set_result(None)
            case MavsdkAlive(late=late):
                # From the thread that sends messages: orders may succeed while that one hangs.
                self._unconfirmed_since_s, self.late = None, late
            case MessageNotSent(name=name, result=result):
                self._fail(f"mavsdk cannot send {name} ({result})")
            case _:
                self._on_reply(message)

    def _on_reply(self, message: OrderExecuted | OrderRefused | LogProgress) -> None:
        """Handle a reply of the mavsdk process to an order."""
        waiting = self._waiting.get(message.number)
        if waiting is None or waiting.future.done():
            return
        match message:
            case OrderExecuted():
                waiting.future.set_result(message)
            case OrderRefused(result=result):
                text = f"{self._name}: {waiting.what}: mavsdk reports {result}"
                waiting.future.set_exception(MavsdkRefusedError(text, result))
            case LogProgress(part=part):
                if waiting.progress is not None:
                    waiting.progress(part)

    def _check_process(self) -> None:
        now_s = time.monotonic()
        delay_s, self._last_check_s = now_s - self._last_check_s, now_s
        if delay_s > _OWN_DELAY_S:
            self._extend_deadlines(delay_s)
        overdue = (
            self._unconfirmed_since_s is not None
            and now_s - self._unconfirmed_since_s > _FLYING_SILENT_S
        )
        if overdue or now_s - self._last_received_s > _SILENT_S:
            silent_s = now_s - self._last_received_s
            self._fail(f"the mavsdk process hangs: no response for {silent_s:.1f} s")
            return
        for waiting in self._waiting.values():
            if now_s > waiting.until_s and not waiting.future.done():
                text = f"{self._name}: {waiting.what}: mavsdk did not answer"
                waiting.future.set_exception(MavsdkRefusedError(text, "TIMEOUT"))

    def _extend_deadlines(self, delay_s: float) -> None:
        self._last_received_s += delay_s
        if self._unconfirmed_since_s is not None:
            self._unconfirmed_since_s += delay_s
        for waiting in self._waiting.values():
            waiting.until_s += delay_s

    def _on_exit(self, child: ChildProcess) -> None:
        last_line = _last_line(child.stderr_tail)
        self._fail(f"the mavsdk process {exit_status_text(child.exit_code)}{last_line}")

    def _fail(self, what: str) -> None:
        if self._failure is not None:
            return
        self._watch.stop()
        self._failure = VehicleError(f"{self._name}: {what}; nothing more is sent to it")
        if self._child is not None:
            # A process that hangs might wake up and continue to send.
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
    if _IMPORT_FAILED.match(lines[-1]):
        return f": {_INSTALL}"
    return f": {lines[-1].strip()}"
