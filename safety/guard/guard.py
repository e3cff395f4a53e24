"""What a guard is, in this process or in one of its own."""

from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Protocol, Self

from safety.fence.geofence import Fence
from safety.guard.core.contingency import Phase
from safety.guard.core.events import GuardEvent
from safety.guard.core.operator_command import OperatorCommand
from safety.model.samples import PoseSample
from vehicles.poses.anchor import Anchor


class Guard(Protocol):
    """Stands between the orchestrator and the vehicles; an async context manager.

    What it decides comes as events. Leaving ends it: land before that.
    """

    @property
    def events(self) -> Sequence[GuardEvent]:
        """Return all events so far."""

    @property
    def phases(self) -> Mapping[str, Phase]:
        """Return where each vehicle's contingency stands."""

    async def __aenter__(self) -> Self:
        """Open its links. Raises LinkError."""

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close its links."""

    def on_event(self, listener: Callable[[GuardEvent], None]) -> None:
        """Have every event given to `listener`, at once, from the event loop."""

    def position(self, sample: PoseSample) -> None:
        """Take where a vehicle is, from the fastest source there is."""

    def anchor(self, name: str, anchor: Anchor) -> None:
        """Set where a vehicle's local frame is in the world."""

    def start_outage(self, name: str, duration_s: float) -> None:
        """Let nothing through between the guard and a vehicle for a while."""

    def alive(self) -> None:
        """Take a sign of life of the orchestrator; the first one starts the watch on it."""

    def command(self, command: OperatorCommand) -> None:
        """Follow an operator's abort, hold or resume; an event says what comes of it."""

    def propose_fences(self, fences: Mapping[str, Fence], who: str) -> None:
        """Ask whether vehicles could be given new fences; an event says so, or why not."""

    def change_fences(self, fences: Mapping[str, Fence], who: str) -> None:
        """Give vehicles new fences, all or none; an event says which."""

    def bring_down(self, reason: str) -> None:
        """Bring all down for a reason of the orchestrator's own."""

    async def all_down(self, timeout_s: float) -> bool:
        """Wait until all were brought down; False when they are not after `timeout_s`."""

    async def at_rest(self, timeout_s: float) -> bool:
        """Wait until nothing may be armed; False when something may be after `timeout_s`."""
