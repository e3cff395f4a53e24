"""The base of live feeds: plugins derive from it what shows each run while it flies."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import ClassVar

from wil_campaign.orchestrator.run.judging.oracle_runner import OracleRunner
from wil_campaign.orchestrator.run.perception.perception import Perception
from wil_campaign.orchestrator.state.mixtures import PreviewImages
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.core.events import GuardEvent
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.safety.model.verdict import DecisiveEvent
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.worlds.scene.track import RunHistory


class RunFeed(AbstractContextManager["RunFeed", None]):
    """The live feed of one run; a context manager.

    The flight calls it: what takes time belongs in a thread of its own. One that raises is closed,
    and the flight goes on.

    name: of the live view. events: times of the world's events, which its moving objects depend on.
    epoch_ns: UTC of the run clock's zero. note: called with the reason when the feed ends early.
    """

    name: ClassVar[str]

    def __init__(
        self,
        *,
        setup: RunSetup,
        run_state: RunState,
        events: RunHistory,
        epoch_ns: int,
        note: Callable[[str], None],
    ) -> None: ...

    def attach(
        self,
        contexts: Sequence[VehicleContext],
        oracle_runner: OracleRunner,
        perception: Perception,
    ) -> None:
        """Publish the state of vehicles, oracles and perception from now on."""

    def tick(self) -> None:
        """Publish the run's state if a view waits for it; called twenty times a second."""

    def shown(self, images: PreviewImages) -> None:
        """Publish a perceived image and the images it was mixed from."""

    def flag(self, flag: Flag) -> None:
        """Publish an oracle's flag."""

    def guard(self, event: GuardEvent) -> None:
        """Publish an event of the guard."""

    def stage(self, stage: Stage, t_s: float) -> None:
        """Publish that the run has entered a stage."""

    def decisive(self, event: DecisiveEvent) -> None:
        """Publish an event that decides the run."""

    def vehicle_event(self, name: str, event: VehicleEvent) -> None:
        """Publish an event of a vehicle that flies."""
