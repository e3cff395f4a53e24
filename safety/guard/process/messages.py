"""The messages between the orchestrator and the guard's process.

They go through a SOCK_SEQPACKET Unix socket, in packets of one or more. Vehicles go by their place
in the guard config. Times are CLOCK_MONOTONIC, which all processes share; under the scaled clock
the run clock, as Pace lays it down.
"""

from typing import Annotated

import msgspec

from wil_campaign.foundation.processes.codec import Finite, MessageCodec, Plain, ProcessMessage
from wil_campaign.safety.fence.fence_values import fence_of_plain, plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import Command
from wil_campaign.safety.guard.core.contingency import ContingencyPhase
from wil_campaign.safety.guard.core.events import Cause, GuardEvent


class ConfigMessage(ProcessMessage, frozen=True):
    """Message: what the guard is to guard; packed: see `guard_config`."""

    packed: bytes


class StartVehicle(ProcessMessage, frozen=True):
    """Message to the guard: start a vehicle's process as a child.

    inherited: descriptors that the guard has inherited for it; it closes its own.
    """

    vehicle: str
    argv: Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]
    environment: dict[str, str]
    inherited: tuple[int, ...] = ()


class FrameBytes(ProcessMessage, frozen=True):
    """Message: MAVLink frames of or for the vehicle at `index`; t_s: when the guard had them."""

    index: int
    t_s: Finite
    data: bytes


class UnreadBytes(ProcessMessage, frozen=True):
    """Message of the guard: `FrameBytes` that were lost, for the orchestrator did not read in time.

    arrived_s: when there were such, thinned as `Arrivals` does it. count: of how many.
    """

    index: int
    arrived_s: tuple[Finite, ...]
    count: int

    def __str__(self) -> str:
        """Return in words what was lost."""
        return f"{self.count} datagrams were lost: this program did not read them in time"


class VehiclePosition(ProcessMessage, frozen=True):
    """Message to the guard: position of the vehicle at `index`, world frame."""

    index: int
    t_s: Finite
    position_ned_m: tuple[float, float, float]
    q_wxyz: tuple[float, float, float, float]
    velocity_ned_m_s: tuple[float, float, float]


class FollowClock(ProcessMessage, frozen=True):
    """Message to the guard: let the clock follow the leading vehicle."""


class EndGuard(ProcessMessage, frozen=True):
    """Message to the guard: nothing more is flown; end children and process."""


class LinksOpened(ProcessMessage, frozen=True):
    """Message of the guard: links are open; ports: local UDP port of each, 0 without one."""

    pid: int
    ports: tuple[int, ...]


class VehicleStarted(ProcessMessage, frozen=True):
    """Message of the guard: a vehicle's process runs."""

    vehicle: str
    pid: int


class VehicleEnded(ProcessMessage, frozen=True):
    """Message of the guard: a vehicle's process ended, or failed to start (exit_code None)."""

    vehicle: str
    exit_code: int | None
    last_output: str


class FrameSent(ProcessMessage, frozen=True):
    """Message of the guard: a command was just sent to a vehicle."""

    index: int
    t_s: Finite
    frame: bytes


class EventMessage(ProcessMessage, frozen=True):
    """Message of the guard: an event."""

    event: GuardEvent


class GuardStatus(ProcessMessage, frozen=True):
    """Message of the guard: its status, sent several times a second as its sign of life.

    at_rest: nothing may be armed, latched or not.
    """

    latched: Cause | None
    all_down: bool
    at_rest: bool
    phases: tuple[ContingencyPhase, ...]


class OrchestratorReached(ProcessMessage, frozen=True):
    """Message to the guard: the orchestrator has done all that was due until this moment."""

    run_s: Finite


class ClockPace(ProcessMessage, frozen=True):
    """Message of the guard: the run clock, `run_s` at `wall_s` (CLOCK_MONOTONIC), and its slope.

    holds_s: for how much wall time, None where the clock does not wait for the
    orchestrator.
    """

    wall_s: Finite
    run_s: Finite
    rate: Annotated[float, msgspec.Meta(ge=0.0, le=1e300)]
    holds_s: Annotated[float, msgspec.Meta(ge=0.0, le=1e300)] | None = None


class GuardFailed(ProcessMessage, frozen=True):
    """Message of the guard: it could not begin; says why."""

    text: str


ToGuard = (
    ConfigMessage
    | StartVehicle
    | FrameBytes
    | VehiclePosition
    | Command
    | FollowClock
    | OrchestratorReached
    | EndGuard
)
ToOrchestrator = (
    FrameBytes
    | FrameSent
    | UnreadBytes
    | LinksOpened
    | VehicleStarted
    | VehicleEnded
    | EventMessage
    | GuardStatus
    | ClockPace
    | GuardFailed
)

_PLAIN: Plain = {Fence: (plain_fence, fence_of_plain)}
to_guard: MessageCodec[list[ToGuard]] = MessageCodec(list[ToGuard], plain=_PLAIN)
to_orchestrator: MessageCodec[list[ToOrchestrator]] = MessageCodec(
    list[ToOrchestrator], plain=_PLAIN
)
