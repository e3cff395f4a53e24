"""What the orchestrator and the guard's process say to each other, as values; see `protocol`."""

from dataclasses import dataclass
from typing import Any, Literal

from safety.geofence import Fence
from safety.guard.contingency import Phase
from safety.guard.events import Cause, GuardEvent
from worlds.frames import Quat, Vec3

OrderKind = Literal["abort", "hold", "resume", "bring_down"]


@dataclass(frozen=True, slots=True)
class CharterMessage:
    """What the guard is to guard, as plain values."""

    plain: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Start:
    """Start a vehicle's process as a child of the guard."""

    vehicle: str
    argv: tuple[str, ...]
    environment: dict[str, str]


@dataclass(frozen=True, slots=True)
class Bytes:
    """MAVLink frames of the vehicle at `index`, or for it; t_s: when the guard had them."""

    index: int
    t_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Position:
    """Where the vehicle at `index` is, world frame."""

    index: int
    t_s: float
    position_ned_m: Vec3
    q_wxyz: Quat
    velocity_ned_m_s: Vec3


@dataclass(frozen=True, slots=True)
class Alive:
    """A sign of life of the orchestrator's event loop."""


@dataclass(frozen=True, slots=True)
class Order:
    """A command; text: who gave it, or for bring_down the reason."""

    kind: OrderKind
    text: str


@dataclass(frozen=True, slots=True)
class NewFences:
    """Give vehicles new fences, all or none; who: gave the command.

    proposed: only say whether they could be given.
    """

    who: str
    fences: dict[str, Fence]
    proposed: bool = False


@dataclass(frozen=True, slots=True)
class AnchorAt:
    """Where a vehicle's local frame is in the world."""

    vehicle: str
    origin_ned_m: Vec3
    turn_rad: float


@dataclass(frozen=True, slots=True)
class GoDark:
    """Let nothing through between the guard and a vehicle for a while."""

    vehicle: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class Follow:
    """Let the clock follow the vehicle that leads it: all that had to be started runs."""


@dataclass(frozen=True, slots=True)
class End:
    """Nothing more is to be flown: reap and end."""


@dataclass(frozen=True, slots=True)
class Opened:
    """The links are open; ports: the local UDP port of each, 0 for a link without one."""

    pid: int
    ports: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Started:
    """A vehicle's process runs."""

    vehicle: str
    pid: int


@dataclass(frozen=True, slots=True)
class Ended:
    """A vehicle's process ended, or could not be started (exit_code None)."""

    vehicle: str
    exit_code: int | None
    last_words: str


@dataclass(frozen=True, slots=True)
class OnWire:
    """A command that just went to a vehicle."""

    index: int
    t_s: float
    frame: bytes


@dataclass(frozen=True, slots=True)
class Told:
    """An event of the guard."""

    event: GuardEvent


@dataclass(frozen=True, slots=True)
class Status:
    """Where the guard stands; sent several times a second, as its sign of life.

    at_rest: nothing may be armed, latched or not.
    """

    latched: Cause | None
    all_down: bool
    at_rest: bool
    phases: tuple[Phase, ...]


@dataclass(frozen=True, slots=True)
class Pace:
    """The run clock from now on: `run_s` at `wall_s` (CLOCK_MONOTONIC), and its slope."""

    wall_s: float
    run_s: float
    rate: float


@dataclass(frozen=True, slots=True)
class Failed:
    """The guard could not begin; says why."""

    text: str


Message = (
    CharterMessage
    | Start
    | Bytes
    | Position
    | Alive
    | Order
    | NewFences
    | AnchorAt
    | GoDark
    | Follow
    | End
    | Opened
    | Started
    | Ended
    | OnWire
    | Told
    | Status
    | Pace
    | Failed
)
