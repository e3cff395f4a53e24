"""Sends a command, waits for its effect in the telemetry, and reports when there is none."""

import asyncio
from collections.abc import Awaitable, Callable

from wil_campaign.vehicles.driver.session.conditions import ConditionWaiter
from wil_campaign.vehicles.driver.vehicle_commands import Done
from wil_campaign.vehicles.driver.vehicle_state import VehicleState
from wil_campaign.vehicles.errors import StateTimeoutError

SEEN_WITHIN_S = 3.0
"""HEARTBEAT comes once a second, and one may be lost."""
_HEARTBEAT_WITHIN_S = 5.0
"""A bad link may lose more of them; then it is waited for so much longer until one comes."""

SendCommand = Callable[[Done], Awaitable[None]]


class ConfirmedCommand:
    """Sends commands until they are confirmed: accepted, and their effect seen.

    state: returns the vehicle's last state. heartbeat_s: when its last HEARTBEAT came (run clock).
    circumstances: returns text that is added to errors.
    """

    def __init__(
        self,
        *,
        name: str,
        changes: ConditionWaiter,
        state: Callable[[], VehicleState],
        heartbeat_s: Callable[[], float],
        circumstances: Callable[[], str],
    ) -> None:
        self._name = name
        self._changes = changes
        self._state = state
        self._heartbeat_s = heartbeat_s
        self._circumstances = circumstances

    async def confirm(self, send_command: SendCommand, done: Done, what: str) -> None:
        """Send a command until confirmed. Raises CommandError, StateTimeoutError.

        An acknowledgement does not tell two commands of one kind apart, and on a bad link it may
        belong to the earlier one: a command without effect is sent once more, unless the mode has
        been changed since.
        """
        before = self._state().custom_mode
        await send_command(done)
        if await self._changes.until(done, SEEN_WITHIN_S / 2.0):
            return
        if self._state().custom_mode == before:
            await send_command(done)
        sent_s = asyncio.get_running_loop().time()
        if await self._changes.until(done, SEEN_WITHIN_S):
            return
        # Silence is no evidence: a HEARTBEAT shows the effect, or that there is none.
        is_shown = lambda: done() or self._heartbeat_s() > sent_s  # noqa: E731
        await self._changes.until(is_shown, _HEARTBEAT_WITHIN_S)
        waited_s = round(asyncio.get_running_loop().time() - sent_s, 1)
        if not done():
            raise self._no_effect(waited_s, what)

    async def await_effect(self, condition: Done, timeout_s: float, what: str) -> None:
        """Wait until a command's effect is seen. Raises StateTimeoutError."""
        if await self._changes.until(condition, timeout_s):
            return
        raise self._no_effect(timeout_s, what)

    def _no_effect(self, timeout_s: float, what: str) -> StateTimeoutError:
        state = self._state()
        armed = "armed" if state.armed else "disarmed"
        return StateTimeoutError(
            f"{self._name}: not {what} within {timeout_s:g} s; its last state is {armed} in "
            f"{state.mode_name}, {state.landed.replace('_', ' ')}{self._circumstances()}"
        )
