"""What a guard is commanded and what it must know, one message each.

The guard in this process applies them, the one in its own process gets the same by the channel.
"""

from wil_campaign.foundation.processes.codec import Finite, ProcessMessage
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.operator_command import OperatorCommand

FiniteVec3 = tuple[Finite, Finite, Finite]


class OrchestratorAlive(ProcessMessage, frozen=True):
    """Message to the guard: a sign of life of the orchestrator; the first starts its timeout."""


class OperatorAction(ProcessMessage, frozen=True):
    """Message to the guard: an operator's abort, hold or resume; an event reports it."""

    command: OperatorCommand


class BringDown(ProcessMessage, frozen=True):
    """Message to the guard: bring all down for a reason of the orchestrator."""

    reason: str


class NewFences(ProcessMessage, frozen=True):
    """Message to the guard: give vehicles new fences, all or none; who: gave the command.

    An event reports it. proposed: only report whether they could be given.
    """

    who: str
    fences: dict[str, Fence]
    proposed: bool = False


class AnchorAt(ProcessMessage, frozen=True):
    """Message to the guard: a vehicle's local frame in the world: its estimate is a position."""

    vehicle: str
    origin_ned_m: FiniteVec3
    turn_rad: Finite


class StartOutage(ProcessMessage, frozen=True):
    """Message to the guard: start a link outage between guard and vehicle for a while."""

    vehicle: str
    duration_s: Finite


class OrchestratorEnded(ProcessMessage, frozen=True):
    """Message of the guard's process: the orchestrator is gone for good."""


class VehicleGone(ProcessMessage, frozen=True):
    """Message of the guard's process: a vehicle's process ended or hangs. text: the reason."""

    vehicle: str
    text: str


class ClocksApart(ProcessMessage, frozen=True):
    """Message of the guard's process: a vehicle's time left the run clock's. text: how."""

    vehicle: str
    text: str


Command = OrchestratorAlive | OperatorAction | BringDown | NewFences | AnchorAt | StartOutage
"""What an orchestrator sends."""
Trouble = VehicleGone | ClocksApart
"""What the guard's process finds wrong with a vehicle."""
CoreMessage = (
    OrchestratorAlive
    | OperatorAction
    | BringDown
    | NewFences
    | AnchorAt
    | OrchestratorEnded
    | Trouble
)
"""What the guard's core applies: all but an outage, which is a matter of the links."""
