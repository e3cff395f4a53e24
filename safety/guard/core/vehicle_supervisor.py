"""One vehicle that the guard supervises: its state, fence, contingency and setpoint limits.

Limits the setpoint frames of one vehicle, and reports which limits took effect.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from wil_campaign.safety.fence.geofence import Fence, FenceBreach
from wil_campaign.safety.fence.stopping import VehicleMotion
from wil_campaign.safety.guard.core.contingency import (
    Contingency,
    ContingencyAction,
    ContingencyPhase,
    ContingencyPlan,
)
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.core.setpoint_frames import read_setpoint, rewritten_setpoint_frame
from wil_campaign.safety.guard.core.setpoint_limiter import LimitReport, SetpointLimiter
from wil_campaign.safety.guard.core.vehicle_observer import ObservedVehicle
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.autopilots.registry import is_flyable_vehicle
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter, MavlinkFrame
from wil_campaign.vehicles.mavlink.heartbeats import HeartbeatKind, heartbeat_kind
from wil_campaign.vehicles.mavlink.names import message_name
from wil_campaign.vehicles.mavlink.vehicle_frames import VehicleFrames
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.setpoints import Setpoint

_LAPSE_S = 1.0
"""A limit without effect for this time is reported as ended."""


@dataclass(slots=True)
class _LimitingSpell:
    """A time over which one setpoint limit took effect again and again."""

    count: int
    worst: LimitReport
    last_s: float


class SetpointMeter:
    """Forwards one vehicle's setpoint frames within limits; `notes` are for the log.

    Each limit is reported when it begins to take effect; and after a second without effect, how
    often it did and for which largest value.
    """

    def __init__(self, limiter: SetpointLimiter) -> None:
        self._limiter = limiter
        self._spells: dict[str, _LimitingSpell] = {}
        self.notes: list[str] = []

    def change_fence(self, fence: Fence) -> None:
        """Limit setpoints to another fence from now on."""
        self._limiter.change_fence(fence)

    def through(
        self,
        frame: MavlinkFrame,
        asked: Setpoint | None,
        anchor: Anchor | None,
        motion: VehicleMotion | None,
        t_s: float,
    ) -> tuple[bytes | None, Setpoint | None]:
        """Return the frame to forward and its setpoint; None if nothing is forwarded.

        asked: the frame's setpoint in the world frame; None if it cannot be limited.
        """
        if asked is None:
            name = message_name(frame.message_id)
            self._note(LimitReport(f"{name} cannot be limited and is", 1.0, 0.0, ""), t_s)
            return None, None
        given, found = self._limiter.limit(asked, motion, t_s)
        for limit_report in found:
            self._note(limit_report, t_s)
        if given is None or not found:
            return None if given is None else frame.raw, given
        return rewritten_setpoint_frame(frame, given, anchor), given

    def lapse(self, t_s: float) -> None:
        """Take that time has passed: report the limits that have ended."""
        for what, spell in tuple(self._spells.items()):
            if t_s - spell.last_s > _LAPSE_S:
                del self._spells[what]
                if spell.count > 1:
                    note = f"{_report_text(spell.worst)}: {spell.count} times, this the worst"
                    self.notes.append(note)

    def _note(self, limiting: LimitReport, t_s: float) -> None:
        spell = self._spells.get(limiting.what)
        if spell is None:
            self._spells[limiting.what] = _LimitingSpell(1, limiting, t_s)
            self.notes.append(_report_text(limiting))
            return
        spell.count += 1
        spell.last_s = t_s
        if _excess_of(limiting) > _excess_of(spell.worst):
            spell.worst = limiting


def _excess_of(limiting: LimitReport) -> float:
    return abs(limiting.asked - limiting.given)


def _report_text(limiting: LimitReport) -> str:
    if not limiting.unit:
        return f"{limiting.what} is not forwarded"
    asked = "any" if math.isinf(limiting.asked) else f"{limiting.asked:.2f}"
    return f"{limiting.what} limited from {asked} to {limiting.given:.2f} {limiting.unit}"


_LATER, _GENTLER = 2.0, 0.4
"""A vehicle follows its setpoints late by about the latency: limited with the same braking as the
fence's prediction, it would be too fast for that, and the guard would take over."""
_STANDING = (0.0, 0.0, 0.0)


class SupervisedVehicle:
    """The guard's supervision of one vehicle: state, contingency, frames both ways."""

    def __init__(
        self, name: str, vehicle: GuardedVehicle, settings: GuardSettings, plan: ContingencyPlan
    ) -> None:
        self.name = name
        self.vehicle = vehicle
        self._low_fence = _without_floor(vehicle.fence)
        self.seen = ObservedVehicle(vehicle, settings)
        self.contingency = Contingency(
            replace(plan, landing=vehicle.landing, terminate=vehicle.may_terminate)
        )
        self.codec = MavlinkCodec(system_id=settings.system_id, component_id=settings.component_id)
        self.meter = _meter(vehicle, settings)
        self._settings = settings
        self.from_vehicle = FrameSplitter()
        self._own = VehicleFrames()
        self.from_orchestrator = FrameSplitter()
        self.from_gcs = FrameSplitter()
        self.lost = False
        self.gone = False
        """Whether the vehicle's process has ended."""
        self.reported: set[str] = set()
        self.heartbeat_s: float | None = None

    @property
    def is_out_of_reach(self) -> bool:
        """Return whether the vehicle can no longer be reached: its landing is not waited for."""
        return self.gone or (self.lost and self.vehicle.abandoned_when_lost)

    def own_frames(self, frames: Iterable[MavlinkFrame], t_s: float) -> Iterator[MavlinkFrame]:
        """Yield the vehicle's own frames among those from its link, in order.

        Those of other ids are not, nor heartbeats of another kind of sender with its ids, nor
        frames of a second vehicle with its ids, whose sequence numbers are others. The driver
        names them.
        """
        target = self.vehicle.target
        for frame in frames:
            if frame.system != target.system or frame.component != target.component:
                continue
            kind = heartbeat_kind(frame)
            if kind is None or self._is_of_vehicle(kind):
                own, _ = self._own.split(frame, t_s)
                yield from own

    def _is_of_vehicle(self, kind: HeartbeatKind) -> bool:
        return is_flyable_vehicle(*kind) and kind.autopilot == self.vehicle.autopilot.mav_autopilot

    @property
    def commanded(self) -> frozenset[FlightMode] | None:
        """Return the modes the supervisor requests; None under the orchestrator."""
        if self.contingency.phase is ContingencyPhase.IDLE:
            return None
        if self.contingency.phase is ContingencyPhase.PAUSE:
            return frozenset({FlightMode.HOLD})
        return frozenset({FlightMode.HOLD, FlightMode.LAND, self.vehicle.landing})

    @property
    def fence(self) -> Fence | None:
        """Return the fence that applies now: without floor for takeoff, landing, on the ground."""
        seen = self.seen
        low = seen.on_ground or seen.mode is FlightMode.LAND or seen.mode is FlightMode.RTL
        return self._low_fence if low else self.vehicle.fence

    def breach(self, t_s: float) -> FenceBreach | None:
        """Return the breach of the fence that applies now, present or predicted, if any."""
        fence, motion = self.fence, self.seen.motion(t_s)
        if fence is None or motion is None:
            return None
        return fence.breached(
            motion,
            latency_s=self._settings.latency_s,
            braking_m_s2=self._settings.braking_m_s2,
            keep_m=self._settings.keep_m,
        )

    def pass_setpoint(self, frame: MavlinkFrame, t_s: float) -> bytes | None:
        """Return the setpoint frame to forward: unchanged, limited, or None."""
        raw: bytes | None = frame.raw
        setpoint = read_setpoint(frame, self.seen.anchor)
        if self.meter is not None:
            motion = self.seen.motion(t_s)
            raw, setpoint = self.meter.through(frame, setpoint, self.seen.anchor, motion, t_s)
        if raw is not None:
            self.seen.note_setpoint(setpoint, t_s)
        return raw

    def change_fence(self, fence: Fence) -> None:
        """Change the vehicle's supervised fence."""
        self.vehicle = replace(self.vehicle, fence=fence)
        self._low_fence = _without_floor(fence)
        if self.meter is not None:
            self.meter.change_fence(fence)

    def frame(self, action: ContingencyAction, t_s: float) -> bytes:
        """Return the frame that sends a supervisor's action to the vehicle."""
        autopilot, target = self.vehicle.autopilot, self.vehicle.target
        match action:
            case ContingencyAction.ZERO:
                t_boot_ms = int(t_s * 1000.0)
                message = autopilot.velocity_setpoint(
                    target, t_boot_ms=t_boot_ms, velocity_ned_m_s=_STANDING
                )
            case ContingencyAction.HOLD:
                message = autopilot.set_mode(target, FlightMode.HOLD)
            case ContingencyAction.LAND:
                message = autopilot.set_mode(target, FlightMode.LAND)
            case ContingencyAction.RTL:
                message = autopilot.set_mode(target, FlightMode.RTL)
            case ContingencyAction.DISARM:
                message = autopilot.disarm(target)
            case ContingencyAction.TERMINATE:
                if not self.vehicle.may_terminate:
                    raise RuntimeError(f"{self.name} must not be terminated")
                message = autopilot.terminate(target)
        return self.codec.pack(message)


def _without_floor(fence: Fence | None) -> Fence | None:
    """Return a supervised vehicle's fence without its floor; None for None."""
    return None if fence is None else fence.without_floor()


def _meter(vehicle: GuardedVehicle, settings: GuardSettings) -> SetpointMeter | None:
    """Return the setpoint meter of a supervised vehicle; None without limits."""
    if vehicle.limits is None:
        return None
    return SetpointMeter(
        SetpointLimiter(
            limits=vehicle.limits,
            fence=vehicle.fence,
            latency_s=_LATER * settings.latency_s,
            braking_m_s2=_GENTLER * settings.braking_m_s2,
        )
    )
