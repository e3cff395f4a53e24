"""Protocols of workers, which fly orders one at a time, and the messages that they send."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from wil_campaign.orchestrator.operator.run_messages import FlightPlace, OperatorInbox, Report
from wil_campaign.orchestrator.state.faults import InternalFault
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

Order = TypeVar("Order")
Outcome = TypeVar("Outcome")
OrderT_contra = TypeVar("OrderT_contra", contravariant=True)
OutcomeT_co = TypeVar("OutcomeT_co", covariant=True)
Fly = Callable[[Order, Report, OperatorInbox], Outcome]


@dataclass(frozen=True, slots=True)
class WorkerLost:
    """A worker's order without an outcome: its process died or raised.

    details: the traceback of what it raised; empty where it died. kind: its type's name.
    is_own_end: its process ended or hung by itself, while its campaign and machine went on. called:
    the vehicle whose autonomy was being called then; "" for none. has_goal: by that call, whatever
    the log of the run has. no_retry: why the run is not
    flown again, where that is known without its files.
    """

    reason: str
    details: str = ""
    kind: str = ""
    is_own_end: bool = False
    called: str = ""
    has_goal: bool = False
    no_retry: str = ""

    @property
    def fault(self) -> InternalFault:
        """Return the exception that the worker raised."""
        message = self.reason.removeprefix(f"{self.kind}: ")
        return InternalFault(0.0, "the worker process", self.kind, message, self.details)


@dataclass(frozen=True, slots=True)
class OrderDone(Generic[Outcome]):
    """A worker's message that its order is done, with the outcome."""

    outcome: Outcome | WorkerLost


class Worker(Protocol[OrderT_contra, OutcomeT_co]):
    """A worker that takes one order, reports while it flies, and is ended afterwards (protocol)."""

    @property
    def place(self) -> FlightPlace:
        """Return where the worker flies."""

    async def begin(self, order: OrderT_contra) -> None:
        """Send the order. Raises OSError, EOFError when the worker has ended, EngineError."""

    async def receive(self) -> object:
        """Return the worker's next message: News, or OrderDone at the end.

        Raises OSError, EOFError when the worker has ended.
        """

    def send(self, command: OperatorCommand) -> None:
        """Pass an operator's command on; never waits, never raises."""

    def kill(self) -> None:
        """End the worker at once; the guard of its run brings the vehicles down."""

    async def outcome_of_lost(self, reason: str) -> OutcomeT_co | WorkerLost:
        """Return the outcome of the order of a worker that ended or was killed.

        reason: why it was killed; "" if it ended by itself.
        """

    async def end(self) -> str:
        """End a worker that has done its order; return in words what was wrong with its end."""


class WorkerStarter(Protocol[OrderT_contra, OutcomeT_co]):
    """Starts workers (protocol)."""

    async def start(self) -> Worker[OrderT_contra, OutcomeT_co]:
        """Return a new worker, once it can take its order."""

    async def close(self) -> None:
        """Release what the workers shared, after the last one has ended."""
