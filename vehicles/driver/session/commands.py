"""Sends commands and awaits their acknowledgements: repeats lost ones, explains refusals."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.errors import CommandError, CommandTimeoutError, VehicleError
from wil_campaign.vehicles.mavlink.names import command_name, result_name

_PROGRESS_TIMEOUT_S = 10.0
"""How long after IN_PROGRESS the next acknowledgement of a command may take."""
_LONGEST_PROGRESS_S = 60.0
"""How long a command may be in progress in all, however often it is acknowledged so."""
_LAST_WAIT = 3.0
"""The wait after the last try is so many times longer: a radio's round trip may be a second."""

_CHECK_EVERY_S, _CHECKS = 0.1, 12
"""How long after a refused repetition the effect of the command is looked for: states come 5 times
a second, and a takeoff begins a second after its command."""
_URGENT = 2
"""An urgent command is repeated so many times more often: still above a bad radio's round trip."""


@dataclass(slots=True)
class _Pending:
    """A command that waits for its COMMAND_ACK."""

    message: Any
    future: asyncio.Future[None]
    done_anyway: Callable[[], bool] | None
    every_s: float
    tries: int
    timer: asyncio.TimerHandle | None = None
    sent: int = 1
    last_result: int | None = None
    progress_ends_s: float | None = None


class Commander:
    """Sends COMMAND_LONG commands and waits for their COMMAND_ACKs.

    An unanswered command is sent again every `ack_timeout_s` with its confirmation counted up,
    `tries` times in all, with a longer wait after the last; so is one that was rejected
    temporarily. circumstances: returns text that is added to errors (the last STATUSTEXTs).
    """

    def __init__(
        self,
        *,
        session: MavlinkSession,
        circumstances: Callable[[], str],
        ack_timeout_s: float = 0.5,
        tries: int = 6,
    ) -> None:
        self._session = session
        self._circumstances = circumstances
        self._ack_timeout_s = ack_timeout_s
        self._tries = tries
        self._pending: dict[int, _Pending] = {}
        self._turns: dict[int, asyncio.Lock] = {}
        self._failure: Exception | None = None
        session.on(mavlink.MAVLINK_MSG_ID_COMMAND_ACK, self._on_ack)

    async def run(self, message: Any, *, done_anyway: Callable[[], bool] | None = None) -> None:
        """Send a command and return once it is accepted.

        done_anyway: returns whether the command has taken effect; called when a repetition is
        refused, because the acknowledgement of the first may have been lost. Raises CommandError
        when refused, CommandTimeoutError when not answered.
        """
        async with self._turns.setdefault(message.command, asyncio.Lock()):
            await self.begin(message, done_anyway=done_anyway)

    def begin(
        self, message: Any, *, done_anyway: Callable[[], bool] | None = None, urgent: bool = False
    ) -> asyncio.Future[None]:
        """Send a command before returning; the future is done once it is accepted (see `run`).

        urgent: repeated twice as often, for as long: another vehicle gets the same command now.
        Raises CommandError when the same command still awaits its acknowledgement, and the error
        that was passed to `fail`.
        """
        if self._failure is not None:
            raise self._failure
        if message.command in self._pending:
            name = command_name(message.command)
            raise CommandError(
                f"the previous {name} is not acknowledged yet", command=name, result="none"
            )
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        hurry = _URGENT if urgent else 1
        every_s, tries = self._ack_timeout_s / hurry, self._tries * hurry
        pending = _Pending(message, future, done_anyway, every_s, tries)
        self._pending[message.command] = pending
        future.add_done_callback(lambda _: self._remove_pending(pending))
        self._session.send(message)
        self._start_timer(pending, every_s)
        return future

    def fail(self, error: Exception) -> None:
        """Raise an error for all pending commands, and for later ones."""
        self._failure = error
        for pending in list(self._pending.values()):
            if not pending.future.done():
                pending.future.set_exception(error)

    def close(self) -> None:
        """Raise VehicleError for all pending commands, and for later ones.

        Cancelled futures would end the tasks that await them as if these had been cancelled.
        """
        futures = [pending.future for pending in self._pending.values()]
        self.fail(
            VehicleError(
                f"{self._session.link.name}: the connection was closed; a command without an "
                "acknowledgement may have been executed all the same"
            )
        )
        for future in futures:
            if not future.cancelled():
                future.exception()  # read: a command that nobody awaits any more is no fault

    def _remove_pending(self, pending: _Pending) -> None:
        if pending.timer is not None:
            pending.timer.cancel()
        if self._pending.get(pending.message.command) is pending:
            del self._pending[pending.message.command]

    def _start_timer(self, pending: _Pending, timeout_s: float) -> None:
        if pending.timer is not None:
            pending.timer.cancel()
        loop = asyncio.get_running_loop()
        pending.timer = loop.call_later(timeout_s, self._on_timeout, pending)

    def _on_timeout(self, pending: _Pending) -> None:
        if pending.future.done():
            return
        if pending.sent >= pending.tries:
            self._fail(pending)
            return
        pending.message.confirmation = min(pending.sent, 255)
        pending.sent += 1
        self._session.send(pending.message)
        last = pending.sent >= pending.tries
        self._start_timer(pending, self._ack_timeout_s * _LAST_WAIT if last else pending.every_s)

    def _on_ack(self, ack: Any, _t_s: float) -> None:
        pending = self._pending.get(ack.command)
        if pending is None or not self._is_ours(ack):
            return
        pending.last_result = ack.result
        if ack.result == mavlink.MAV_RESULT_ACCEPTED:
            self._accept(pending)
        elif ack.result == mavlink.MAV_RESULT_IN_PROGRESS:
            self._await_progress(pending)
        elif ack.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED and pending.sent < pending.tries:
            self._start_timer(pending, self._ack_timeout_s)
        else:
            self._refuse(pending, _CHECKS if pending.sent > 1 else 0)

    def _await_progress(self, pending: _Pending) -> None:
        now_s = asyncio.get_running_loop().time()
        if pending.progress_ends_s is None:
            pending.progress_ends_s = now_s + _LONGEST_PROGRESS_S
        if now_s >= pending.progress_ends_s:
            self._fail(pending)
        else:
            self._start_timer(pending, _PROGRESS_TIMEOUT_S)

    def _is_ours(self, ack: Any) -> bool:
        """Return whether a COMMAND_ACK is for us: the guard has our system id, not our component.

        0 is an autopilot with MAVLink 1, or one that answers to all.
        """
        own = self._session.own
        return ack.target_system in {0, own.system} and ack.target_component in {0, own.component}

    def _refuse(self, pending: _Pending, checks: int) -> None:
        """Handle a command's refusal; of a repetition it may mean that the first is executed."""
        if pending.future.done():
            return
        if pending.sent > 1 and pending.done_anyway is not None and pending.done_anyway():
            self._accept(pending)
        elif checks == 0 or pending.done_anyway is None:
            self._fail(pending)
        else:
            if pending.timer is not None:
                pending.timer.cancel()
            loop = asyncio.get_running_loop()
            pending.timer = loop.call_later(_CHECK_EVERY_S, self._refuse, pending, checks - 1)

    def _accept(self, pending: _Pending) -> None:
        if not pending.future.done():
            pending.future.set_result(None)

    def _fail(self, pending: _Pending) -> None:
        if pending.future.done():
            return
        name = command_name(pending.message.command)
        where = f"{self._session.link.name}: "
        if pending.last_result is None:
            text = f"{where}{name} was not acknowledged, sent {pending.sent} times"
            error: CommandError = CommandTimeoutError(
                text + self._circumstances(), command=name, result="none"
            )
        else:
            result = result_name(pending.last_result)
            in_progress = pending.last_result == mavlink.MAV_RESULT_IN_PROGRESS
            text = f"{where}{name} " + ("does not end: " if in_progress else "was refused with ")
            text += result
            error = CommandError(text + self._circumstances(), command=name, result=result)
        pending.future.set_exception(error)
