"""What a run changed on one vehicle: restored after the flight, or left to the next start."""

from contextlib import AsyncExitStack
from types import TracebackType
from typing import Protocol

from wil_campaign.vehicles.errors import VehicleError


class OnboardChange(Protocol):
    """A change of a vehicle's onboard configuration, in force while it is entered (protocol)."""

    async def __aenter__(self) -> object:
        """Make the change. Raises VehicleError."""

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore what was before. Raises VehicleError."""

    def leave(self) -> bool:
        """Leave the change to the next start, which restores it; return whether there is any."""


class Restoration:
    """The changes of one vehicle's onboard configuration, in their order."""

    def __init__(self) -> None:
        self._stack = AsyncExitStack()
        self._changes: list[OnboardChange] = []
        self._failures: list[str] = []

    async def enter(self, change: OnboardChange) -> None:
        """Make a change, to be restored. Raises VehicleError."""
        await change.__aenter__()
        self._stack.push_async_callback(self._restore, change)
        self._changes.append(change)

    async def restore(self) -> None:
        """Restore all changes, last first.

        Raises VehicleError, once all were tried, with all that failed: of several errors an exit
        stack raises only the last.
        """
        await self._stack.aclose()
        if self._failures:
            raise VehicleError("; ".join(self._failures))

    async def _restore(self, change: OnboardChange) -> None:
        try:
            await change.__aexit__(None, None, None)
        except VehicleError as error:
            self._failures += [str(error), *getattr(error, "__notes__", ())]

    def leave(self) -> bool:
        """Leave all changes to the next start, which restores them; return whether there is any."""
        self._stack.pop_all()
        left = [change.leave() for change in self._changes]
        return any(left)
