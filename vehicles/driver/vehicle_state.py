"""What a driver reports of its vehicle: its state, estimates, and events.

Types that are created many times a second are named tuples: a frozen dataclass takes two to four
times as long.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Vec3

Landed = Literal["unknown", "on_ground", "in_air", "taking_off", "landing"]
"""MAV_LANDED_STATE."""

LANDED_STATES: tuple[Landed, ...] = ("unknown", "on_ground", "in_air", "taking_off", "landing")

ReportName = Literal["heartbeat", "landed_state", "battery", "estimator"]
"""The reports of a vehicle's state that come in separate messages."""

EventKind = Literal[
    "mode",
    "armed",
    "disarmed",
    "landed_state",
    "text",
    "failsafe",
    "failsafe_over",
    "fault",
    "fault_over",
    "link_lost",
    "link_back",
    "reboot",
    "estimator_reset",
    "unusable_estimate",
    "other_sender",
    "second_vehicle",
]


class LocalEstimate(NamedTuple):
    """A vehicle's estimate in its own local frame, at seconds since its boot."""

    boot_s: float
    pose: Pose
    velocity_ned_m_s: Vec3


class EstimateSample(NamedTuple):
    """A vehicle's estimate in the world frame.

    t_s: the time that it is valid for, by the clock map. arrived_s: its time of arrival. Both are
    on the run clock. boot_s: t_s on the vehicle's clock.
    """

    t_s: float
    arrived_s: float
    boot_s: float
    pose: Pose
    velocity_ned_m_s: Vec3


@dataclass(frozen=True, slots=True)
class StatusText:
    """A vehicle's STATUSTEXT; severity by MAV_SEVERITY (0 emergency to 7 debug)."""

    t_s: float
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class BatteryState:
    """The vehicle's battery in SYS_STATUS; values that the autopilot does not know are None."""

    voltage_v: float | None
    remaining: float | None
    """0 to 1."""


@dataclass(frozen=True, slots=True)
class VehicleEvent:
    """An event in a vehicle's state; t_s: when it was received (run clock).

    text: for people ("OFFBOARD", "Armed by external command"). mode: for kind "mode", the new mode.
    asked: for kind "mode", whether we last requested it. duration_s: for kind "link_back", how long
    nothing was received. severity: for kind "text", its MAV_SEVERITY.
    """

    t_s: float
    kind: EventKind
    text: str
    mode: FlightMode | None = None
    asked: bool = False
    duration_s: float | None = None
    severity: int | None = None


class VehicleState(NamedTuple):
    """The vehicle's last reported state; immutable, a new one replaces it.

    last_received_s: when a message of it last arrived (run clock); None before. custom_mode and
    system_status as in HEARTBEAT. estimate: None until the vehicle is anchored in the world.
    local: the same in the autopilot's own frame. faults: of its estimator, in words.
    position_losses: what held its position at arming and was lost since; not among the faults.
    """

    last_received_s: float | None = None
    link_up: bool = False
    armed: bool = False
    mode: FlightMode = FlightMode.OTHER
    mode_name: str = ""
    custom_mode: int | None = None
    system_status: int = 0
    landed: Landed = "unknown"
    failsafe: bool = False
    faults: tuple[str, ...] = ()
    position_losses: tuple[str, ...] = ()
    estimate: EstimateSample | None = None
    local: LocalEstimate | None = None
    battery: BatteryState | None = None
    texts: tuple[StatusText, ...] = ()
