"""The base of the observers of a run: plugins derive from it what takes part beside the flight."""

from collections.abc import Coroutine, Iterable, Iterator, Mapping
from contextlib import AsyncExitStack
from typing import Any

from wil_campaign.orchestrator.run_results.result_parts import ExternalResult
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.vehicles.readings import Reading


class Observer:
    """Observes one run, in the order of its methods; this one does nothing."""

    async def open(self, stack: AsyncExitStack) -> None:
        """Open what is needed, closed with the run by `stack`. Raises VehicleError."""

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles, before they are identified."""

    def attach_guard(self, guard: Guard) -> None:
        """Attach the guard of the vehicles, which takes commands."""

    async def before_arming(self, _unbooted: Mapping[str, frozenset[str]], /) -> str:
        """Return what was checked before the vehicles arm, in words; empty for nothing.

        _unbooted: by vehicle the parameters that were changed while it ran. Raises VehicleError.
        """
        return ""

    def tasks(self, _run_state: RunState, /) -> Iterator[tuple[str, Coroutine[Any, Any, None]]]:
        """Yield what runs until the run's end: the name of each task, and its coroutine."""
        yield from ()

    def perceived(self, reading: Reading, by: tuple[str, ...]) -> None:
        """Receive a reading that the autonomies of vehicles perceive. by: their names."""

    def untouched(self, reading: Reading) -> None:
        """Receive a sensor's reading as the vehicle made it."""

    def contact(self, flag: Flag) -> None:
        """Receive a contact at the moment it is detected."""

    @property
    def environment(self) -> Mapping[str, str]:
        """Return environment variables for the programs of the run; asked once it is open."""
        return {}

    @property
    def result(self) -> ExternalResult:
        """Return the observer's part of the run's results."""
        return ExternalResult()
