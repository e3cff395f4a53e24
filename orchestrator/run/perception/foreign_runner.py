"""An autonomy that is no class of Python, by a plugin: what runs it, or what the run calls."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Protocol

from wil_campaign.orchestrator.run_results.result_parts import ProgramResult
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.vehicles.autonomy import Autonomy
from wil_campaign.vehicles.readings import Reading


class OpenedAutonomy(Protocol):
    """A foreign autonomy that is open during a run, which calls it; it may raise AutonomyFault."""

    @property
    def autonomy(self) -> Autonomy:
        """Return what the run calls."""
        ...

    @property
    def result(self) -> ProgramResult:
        """Return how the autonomy ended."""
        ...


class ForeignRunner(AbstractAsyncContextManager["ForeignRunner"], ABC):
    """Runs a foreign autonomy on one vehicle while its context is open.

    done: set when the autonomy is done.
    """

    context: VehicleContext
    done: asyncio.Event

    @property
    @abstractmethod
    def result(self) -> ProgramResult:
        """Return how the autonomy ended."""

    @abstractmethod
    def on_first_setpoint(self, started: Callable[[str, float], None]) -> None:
        """Call `started(name, t_s)` once, when the next setpoint is sent."""

    @abstractmethod
    def perceive(self, reading: Reading) -> None:
        """Hand a reading to the autonomy."""

    @abstractmethod
    def perceive_raw(self, reading: Reading) -> None:
        """Hand a mixture's input reading to the autonomy."""

    @abstractmethod
    async def fly(self) -> None:
        """Pass the autonomy's setpoints on until cancelled or done."""
