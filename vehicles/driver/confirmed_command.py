"""Orders that are seen done, and an error in words when they are not."""

from collections.abc import Awaitable, Callable

from vehicles.driver.session.conditions import ConditionWaiter
from vehicles.driver.vehicle_commands import Done
from vehicles.driver.vehicle_state import VehicleState
from vehicles.errors import StateTimeoutError

SEEN_WITHIN_S = 3.0
"""HEARTBEAT comes once a second, and one may be lost."""

Order = Callable[[Done], Awaitable[None]]


class ConfirmedCommand:
    """Sends commands until they are confirmed: accepted, and their effect seen.

    state: gives the vehicle as last heard. circumstances: gives words that are added to errors.
    """

    def __init__(
        self,
        *,
        name: str,
        changes: ConditionWaiter,
        state: Callable[[], VehicleState],
        circumstances: Callable[[], str],
    ) -> None:
        self._name = name
        self._changes = changes
        self._state = state
        self._circumstances = circumstances

    async def confirm(self, order: Order, done: Done, what: str) -> None:
        """Send a command until confirmed. Raises CommandError, StateTimeoutError.

        An acknowledgement does not say of which of two commands of one kind it is, and on a bad
        link it may be the earlier one's: what is not seen done is asked for once more, unless
        somebody else has changed the mode since.
        """
        before = self._state().custom_mode
        await order(done)
        if await self._changes.until(done, SEEN_WITHIN_S / 2.0):
            return
        if self._state().custom_mode == before:
            await order(done)
        await self.see(done, SEEN_WITHIN_S, what)

    async def see(self, condition: Done, timeout_s: float, what: str) -> None:
        """Wait until a command's effect is seen. Raises StateTimeoutError."""
        if await self._changes.until(condition, timeout_s):
            return
        state = self._state()
        armed = "armed" if state.armed else "disarmed"
        raise StateTimeoutError(
            f"{self._name}: not seen {what} within {timeout_s:g} s; it was last {armed} in "
            f"{state.mode_name}, {state.landed.replace('_', ' ')}{self._circumstances()}"
        )
