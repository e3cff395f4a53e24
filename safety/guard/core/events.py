"""The configuration of the guard's core, its outputs and its events."""

from dataclasses import dataclass
from typing import Literal

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.contingency import require_landing
from wil_campaign.safety.guard.core.setpoint_limits import SetpointLimits
from wil_campaign.safety.model.verdict import DecisiveEvent, DecisiveKind
from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode, MavlinkTarget
from wil_campaign.vehicles.autopilots.failsafes import OWN_SYSTEM_ID

Cause = Literal["fence", "silence", "lost", "failsafe", "takeover", "abort", "bring_down", "clock"]
"""Why the guard took over. bring_down: the orchestrator requested it, for its own reason. clock:
the times of two simulated vehicles diverged."""

EventKind = Literal[
    "fence",
    "silence",
    "lost",
    "failsafe",
    "takeover",
    "abort",
    "bring_down",
    "clock",
    "hold",
    "resume",
    "proposed",
    "geofence",
    "refused",
    "action",
    "dropped",
    "steered",
    "unread",
    "limited",
    "heard",
    "link",
    "rival",
    "pose",
    "record",
    "guard",
    "alone",
]
"""A cause; hold, resume: the operator's; proposed: new fences are acceptable, to be uploaded first;
geofence: fences were changed in flight; refused: a command that cannot be executed now; action:
a step of a contingency; dropped: frames of the orchestrator or of a ground station that were not
forwarded; steered: a ground station sends positions of sticks in flight; unread: frames of the
vehicle that the orchestrator did not read in time; limited: setpoints exceeded the campaign's
limits, reported at the first and after the last of them; heard: a lost vehicle or orchestrator
is received again; link: another link or address of a vehicle is active now; rival: another
sender at a vehicle's port has the same system id, and is not accepted; pose: a position was
ignored, because it is not finite or its source is frozen; record: the log of a vehicle's frames
cannot be written any more; guard: the guard's own process ended or failed; alone: a cause that
brings down this one vehicle and decides nothing for the other."""


@dataclass(frozen=True, slots=True)
class ToVehicle:
    """Guard output: whole MAVLink frames for the vehicle `name`."""

    name: str
    frames: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class ToOrchestrator:
    """Guard output: whole MAVLink frames of the vehicle `name` for the orchestrator."""

    name: str
    frames: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class ToGcs:
    """Guard output: whole MAVLink frames of the vehicle `name` for its ground station port."""

    name: str
    frames: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class GuardEvent:
    """An event of the guard for the record; vehicle is empty when it concerns all."""

    t_s: float
    kind: EventKind
    vehicle: str
    text: str


Output = ToVehicle | ToOrchestrator | ToGcs | GuardEvent
Outputs = tuple[Output, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardedVehicle:
    """A vehicle as the guard's core is configured for it: ids, fence, limits, plan.

    attached: this program did not start it, so that it may be hardware. landing: LAND, or RTL where
    the campaign requests it and preflight allowed it. terminate: the campaign allows cutting the
    motors of this vehicle as the last resort. gcs: a ground station port is open for it. limits:
    of its setpoints; None forwards all. lands_alone: a cause about this vehicle brings down no
    other. abandoned_when_lost: its landing is not awaited once it is silent, because it is
    simulated beside a vehicle that continues.
    """

    autopilot: Autopilot
    target: MavlinkTarget
    fence: Fence | None = None
    attached: bool = False
    landing: FlightMode = FlightMode.LAND
    terminate: bool = False
    gcs: bool = False
    limits: SetpointLimits | None = None
    lands_alone: bool = False
    abandoned_when_lost: bool = False

    def __post_init__(self) -> None:
        require_landing(self.landing)

    @property
    def may_terminate(self) -> bool:
        """Return whether its motors may be cut: always in simulation, where nothing can break."""
        return self.terminate or not self.attached


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardSettings:
    """The settings of the guard: times in seconds, distances in metres.

    latency_s, braking_m_s2: how late and how hard a vehicle brakes when commanded to. The latency
    is the whole time until it brakes at this rate: estimator, link and tilting over. The defaults
    are a bound, not a fit (docs/geofence.md, `python bench/stopping.py`); on hardware it may be
    more. keep_m: distance to be kept to the fence. orchestrator_silent_s: counts from its first
    sign of life. asked_s: how long a mode change counts as requested after a command was forwarded
    (heartbeats come once a second). system_id, component_id: the sender of the guard's messages,
    the driver's system, because ArduPilot's GCS failsafe heeds one system only (MAV_GCS_SYSID), and
    a component of its own, by which acknowledgements are told apart.
    """

    latency_s: float = 0.7
    braking_m_s2: float = 2.5
    keep_m: float = 0.0
    vehicle_lost_s: float = 3.0
    orchestrator_silent_s: float = 0.4
    asked_s: float = 3.0
    heartbeat_s: float = 1.0
    system_id: int = OWN_SYSTEM_ID
    component_id: int = 191


def unrecorded_event(name: str, t_s: float, error: OSError) -> GuardEvent:
    """Return the event that a vehicle's frames are not recorded any more."""
    why = error.strerror or str(error)
    return GuardEvent(t_s, "record", name, f"the recording ended early: {name}.tlog: {why}")


def is_about_fences(event: GuardEvent) -> bool:
    """Return whether an event answers a proposal or a change of fences."""
    refused = event.kind == "refused" and ": geofence: " in event.text
    return refused or event.kind in {"proposed", "geofence"}


_DECISIVE: dict[EventKind, DecisiveKind] = {
    "fence": "FAIL",
    "failsafe": "FAIL",
    "silence": "ERROR",
    "lost": "ERROR",
    "guard": "ERROR",
    "clock": "ERROR",
    "record": "ERROR",
    "steered": "INVALID",
    "abort": "ABORTED",
    "takeover": "ABORTED",
}


_RECORDED_ALONE = frozenset({"record", "steered"})
"""What decides a run that its own program lands."""


def decisive_guard_event(event: GuardEvent) -> DecisiveEvent | None:
    """Return the decisive event of a guard event; None if it decides nothing.

    A `bring_down` has the orchestrator's own reason; a `hold` is INVALID only after t0, which the
    guard does not know.
    """
    kind = _DECISIVE.get(event.kind)
    if kind is None:
        return None
    return DecisiveEvent(event.t_s, kind, event.text, f"guard.{event.kind}/{event.vehicle}")


def brings_down(event: GuardEvent) -> bool:
    """Return whether the guard lands all vehicles with this event."""
    return event.kind == "bring_down" or (
        event.kind not in _RECORDED_ALONE and event.kind in _DECISIVE
    )
