"""The interface of a guard, in this process or in its own."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, Self

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.contingency import Phase
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.poses.anchor import Anchor


class Guard(Protocol):
    """The guard between orchestrator and vehicles (protocol); an async context manager.

    Its decisions are reported as events. Leaving the context ends it: land before that.
    """

    @property
    def events(self) -> Sequence[GuardEvent]:
        """Return all events of the guard so far."""

    @property
    def phases(self) -> Mapping[str, Phase]:
        """Return the contingency phase of each vehicle in the guard."""

    async def __aenter__(self) -> Self:
        """Open the guard's links. Raises LinkError."""

    async def __aexit__(self, *_: object) -> None:
        """Close the guard's links."""

    def on_event(self, listener: Callable[[GuardEvent], None]) -> None:
        """Register a listener for every event of the guard, called from the event loop."""

    def position(self, sample: PoseSample) -> None:
        """Give the guard a vehicle's position, from the fastest available source."""

    def anchor(self, name: str, anchor: Anchor) -> None:
        """Give the guard the place of a vehicle's local frame in the world."""

    def start_outage(self, name: str, duration_s: float) -> None:
        """Start a link outage between the guard and a vehicle for a while."""

    def alive(self) -> None:
        """Give the guard the orchestrator's sign of life; the first one starts its timeout."""

    def command(self, command: OperatorCommand) -> None:
        """Have the guard execute an operator's abort, hold or resume; an event reports it."""

    def propose_fences(self, fences: Mapping[str, Fence], who: str) -> None:
        """Have the guard report in an event whether new fences would be accepted."""

    def change_fences(self, fences: Mapping[str, Fence], who: str) -> None:
        """Have the guard change vehicles' fences, all or none; an event says which."""

    def bring_down(self, reason: str) -> None:
        """Have the guard bring all vehicles down for a reason of the orchestrator."""

    async def all_down(self, timeout_s: float) -> bool:
        """Wait until the guard brought all down; False when not within `timeout_s`."""

    async def at_rest(self, timeout_s: float) -> bool:
        """Wait until the guard sees nothing armed; False when not within `timeout_s`."""
