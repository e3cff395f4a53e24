"""The guard's knowledge of one vehicle, from the vehicle's own frames and from positions."""

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from wil_campaign.safety.fence.stopping import AccelerationEstimate, VehicleMotion
from wil_campaign.safety.guard.core.contingency import ContingencyFacts
from wil_campaign.safety.guard.core.events import GuardedVehicle, GuardSettings
from wil_campaign.safety.guard.core.frozen_source import FrozenSource
from wil_campaign.safety.guard.core.velocity_command import VelocityCommand
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.mavlink.fields import (
    CONDITION_YAW,
    DO_CHANGE_SPEED,
    DO_REPOSITION,
    EXTENDED_SYS_STATE,
    HEARTBEAT,
    LOCAL_POSITION_NED,
    NAV_TAKEOFF,
    CommandFields,
    HeartbeatFields,
    read_heartbeat,
    read_landed,
    read_local_position,
)
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.poses.anchor import Anchor
from wil_campaign.vehicles.setpoints import Setpoint
from wil_campaign.worlds.frames import Vec3, norm

_LAND_AFTERWARDS = frozenset({FlightMode.LAND, FlightMode.RTL, FlightMode.MISSION})
"""Modes from which an autopilot lands by itself."""
_FRESH_S = 1.0
_ARMED_LATELY_S = 1.5
"""Heartbeats come once a second: an armed vehicle reports it within this time. A single heartbeat
that reports disarmed may be a replay, or of another vehicle with the same system ID, and ends no
flight."""
_REPORTED_S = 0.3
"""After how long without a position from the orchestrator the vehicle's own estimate counts."""
_MODES_OF: Mapping[int, tuple[FlightMode, ...]] = {
    CONDITION_YAW: (),
    DO_CHANGE_SPEED: (),
    DO_REPOSITION: (FlightMode.HOLD, FlightMode.GUIDED),
}
"""The modes in which commands result that a program under test may repeat all the time."""
_RISEN_M = 0.5
"""A vehicle that is so much above where it stood has left the ground, whatever its height errs by;
below, no floor of a fence is needed: the ground is there."""


class _Ground:
    """The height at which a vehicle last stood, and whether it has risen from there since."""

    def __init__(self) -> None:
        self._up_m: float | None = None
        self._left = False

    @property
    def not_left(self) -> bool:
        """Return whether the vehicle has not left the ground since it last reported to stand."""
        return self._up_m is not None and not self._left

    def note(self, up_m: float, *, landed: bool) -> None:
        """Record a height of the vehicle. landed: whether it reports that it stands."""
        if landed:
            self._up_m, self._left = up_m, False
        elif self._up_m is not None and up_m - self._up_m > _RISEN_M:
            self._left = True

    def is_low(self, up_m: float) -> bool:
        return self._up_m is not None and abs(up_m - self._up_m) <= _RISEN_M


@dataclass(frozen=True, slots=True)
class ModeChange:
    """An uncommanded mode change: by the pilot, or by the autopilot's own failsafe."""

    kind: Literal["takeover", "failsafe"]
    text: str


class ObservedVehicle:
    """The guard's observed state of one vehicle, from its messages; None is unknown."""

    def __init__(self, vehicle: GuardedVehicle, settings: GuardSettings) -> None:
        self._vehicle = vehicle
        self._settings = settings
        self.last_received_s: float | None = None
        self.armed: bool | None = None
        self.mode: FlightMode | None = None
        self.landed: bool | None = None
        self.failsafe = False
        self.taken_over = False
        """Whether a pilot or a ground station has taken control; stays set."""
        self.anchor: Anchor | None = None
        """Its local frame in the world; with it, its LOCAL_POSITION_NED is a position source."""
        self._mode_name = ""
        self._critical = False
        self._requested_s = dict.fromkeys(FlightMode, -math.inf)
        self._mode_commands = dict(_mode_commands(vehicle))
        self._resumed_s: float | None = None
        self._arm_requested_s: float | None = None
        self._is_ours = not vehicle.attached
        self._is_left_to_others = False
        self._armed_s: float | None = None
        self._stored_m: Vec3 | None = None
        self._up_m: float | None = None
        self._speed_m_s: float | None = None
        self._seen_s: float | None = None
        self.placed_s: float | None = None
        """When it last had a position in the world."""
        self._motion: VehicleMotion | None = None
        self._acceleration = AccelerationEstimate()
        self._commanded = VelocityCommand()
        self._reported_s: float | None = None
        self._source = FrozenSource(same_s=_REPORTED_S)
        self._ground = _Ground()

    @property
    def on_ground(self) -> bool:
        """Return whether the vehicle stands: by its report, or since that it has not risen.

        An autopilot reports a takeoff when it begins it, seconds before it leaves the ground.
        """
        return self.landed is True or self._ground.not_left

    def may_be_armed(self, t_s: float) -> bool:
        """Return whether the vehicle is armed, or was just commanded to arm.

        A vehicle that reported both within a heartbeat and a half counts as armed.
        """
        if self.armed or (self._armed_s is not None and t_s - self._armed_s <= _ARMED_LATELY_S):
            return True
        requested_s = self._arm_requested_s
        return requested_s is not None and t_s - requested_s <= self._settings.asked_s

    def facts(self, t_s: float) -> ContingencyFacts:
        """Return the observed state as facts for the vehicle's contingency."""
        armed = True if self.may_be_armed(t_s) else self.armed
        return ContingencyFacts(
            armed=armed,
            mode=self.mode,
            landed=self.landed,
            failsafe=self.failsafe,
            pilot=(self.taken_over and armed is not False)
            or (self._is_left_to_others and armed is True),
            up_m=self._up_m,
            speed_m_s=self._speed_m_s,
            seen_s=self._seen_s,
        )

    def note_command(self, command: CommandFields, t_s: float) -> None:
        """Record a forwarded command of the orchestrator: its effect is expected."""
        self._requested_s.update(dict.fromkeys(self._modes_of(command), t_s))
        if command.arms:
            self._arm_requested_s, self._is_ours = t_s, True

    def leave_to_others(self) -> None:
        """Leave an attached vehicle alone that the orchestrator never commanded to arm.

        Somebody else flies it, as on a mission of a ground station.
        """
        self._is_left_to_others = not self._is_ours

    def note_mode_request(self, custom_mode: int, t_s: float) -> None:
        """Record that the orchestrator requested a mode by SET_MODE."""
        self._requested_s[self._vehicle.autopilot.mode_of(custom_mode)] = t_s

    def note_setpoint(self, setpoint: Setpoint | None, t_s: float) -> None:
        """Record a forwarded setpoint, world frame; None for one that the guard cannot read."""
        self._commanded.note(setpoint, self.motion(t_s), t_s)

    def note_pause(self) -> None:
        """Record that earlier setpoints no longer count: the vehicle is commanded to hold."""
        self._commanded.forget()

    def note_resume(self, t_s: float) -> None:
        """Record that the guard's own hold has ended; its effect may be reported only now."""
        self._resumed_s = t_s

    def doubt(
        self, position_ned_m: Vec3, velocity_ned_m_s: Vec3, t_s: float, *, reported: bool
    ) -> str:
        """Return why a vehicle's position in the world is to be ignored; empty if it is not.

        reported: whether the orchestrator sent it, from the source that the judge uses.
        """
        if not math.isfinite(sum(position_ned_m) + sum(velocity_ned_m_s)):
            return "a position is not finite"
        if reported:
            self._reported_s = t_s
            self._source.note_position(
                position_ned_m,
                t_s,
                on_ground=self.landed is True,
                low=self._ground.is_low(-position_ned_m[2]),
            )
            if self._source.is_frozen(t_s):
                return (
                    "its pose source repeats one position while its own estimate moves: the guard "
                    "ignores it and uses the estimate"
                )
        return ""

    def place(self, position_ned_m: Vec3, velocity_ned_m_s: Vec3, t_s: float) -> None:
        """Record a vehicle's position in the world; from then on only world heights are used."""
        self.placed_s = t_s
        acceleration = self._acceleration.update(velocity_ned_m_s, t_s)
        guided = self.mode is FlightMode.GUIDED
        commanded = self._commanded.velocity(t_s) if guided else None
        self._motion = VehicleMotion(position_ned_m, velocity_ned_m_s, acceleration, commanded)
        self._store_sample(position_ned_m, velocity_ned_m_s, t_s)
        self._ground.note(-position_ned_m[2], landed=self.landed is True)

    def motion(self, t_s: float) -> VehicleMotion | None:
        """Return the vehicle's observed motion in the world, if within the last second."""
        known = self.placed_s is not None and t_s - self.placed_s <= _FRESH_S
        return self._motion if known else None

    def knows_world(self, t_s: float) -> bool:
        """Return whether there is a better position source than the vehicle's estimate."""
        lately = self._reported_s is not None and t_s - self._reported_s <= _REPORTED_S
        return lately and not self._source.is_frozen(t_s)

    def read_position(self, frame: MavlinkFrame, t_s: float) -> tuple[Vec3, Vec3] | None:
        """Observe a LOCAL_POSITION_NED; return position and velocity in the world, if known."""
        if frame.message_id != LOCAL_POSITION_NED:
            return None
        local = read_local_position(frame)
        if local is None:
            return None
        position_m, velocity_m_s = local
        self._source.note_estimate(position_m)
        if self.knows_world(t_s):
            return None
        if self.anchor is None:
            if self.placed_s is None:
                self._store_sample(position_m, velocity_m_s, t_s)
            return None
        return self.anchor.position(position_m), self.anchor.velocity(velocity_m_s)

    def read_state(
        self, frame: MavlinkFrame, t_s: float, commanded: frozenset[FlightMode] | None
    ) -> ModeChange | None:
        """Observe a HEARTBEAT or EXTENDED_SYS_STATE; return an uncommanded mode change.

        commanded: the modes that the guard itself requests; None while the orchestrator is in
        command.
        """
        if frame.message_id == EXTENDED_SYS_STATE:
            landed = read_landed(frame)
            self.landed = self.landed if landed is None else landed
        elif frame.message_id == HEARTBEAT:
            return self._read_heartbeat(read_heartbeat(frame), t_s, commanded)
        return None

    def _read_heartbeat(
        self, heartbeat: HeartbeatFields, t_s: float, commanded: frozenset[FlightMode] | None
    ) -> ModeChange | None:
        old, was_armed, old_name = self.mode, self.armed, self._mode_name
        was_critical, self._critical = self._critical, heartbeat.critical
        new = self._vehicle.autopilot.mode_of(heartbeat.custom_mode)
        self.mode, self.armed = new, heartbeat.armed
        self._mode_name = self._vehicle.autopilot.mode_name(heartbeat.custom_mode)
        if heartbeat.armed:
            self._arm_requested_s, self._armed_s = None, t_s
        if not heartbeat.armed:
            self.failsafe = False
            return None
        if new is FlightMode.PILOT and not self._fell_back(old, was_critical=was_critical):
            if self.taken_over:
                return None
            self.taken_over = True
            return ModeChange("takeover", f"the pilot has control in {self._mode_name}")
        if old is None or new is old:
            return None
        self.failsafe = was_armed is True and self._is_unrequested(old, new, t_s, commanded)
        if not self.failsafe:
            return None
        text = f"its autopilot changed from {old_name} to {self._mode_name} without a command"
        return ModeChange("failsafe", text)

    def _fell_back(self, old: FlightMode | None, *, was_critical: bool) -> bool:
        """Return whether the autopilot itself has entered a pilot's mode, by its last heartbeat.

        PX4 without setpoints changes from OFFBOARD to POSCTL by itself (COM_OBL_RC_ACT 0), and is
        critical from the same heartbeat on. One that was critical before has another reason, such
        as a battery warning (docs/decisions/0031-a-pilot-beside-a-warning.md).
        """
        if not self._critical or self._mode_name not in self._vehicle.autopilot.fallback_modes:
            return False
        lost_guidance = old is FlightMode.GUIDED and not was_critical
        return lost_guidance or (old is FlightMode.PILOT and self.failsafe)

    def _is_unrequested(
        self, old: FlightMode, new: FlightMode, t_s: float, commanded: frozenset[FlightMode] | None
    ) -> bool:
        requested = t_s - self._requested_s[new] <= self._settings.asked_s
        if commanded is not None:
            # The effect of a request just before the guard took over may be reported only now; a
            # landing that follows the operator's hold is the autopilot's own.
            lands_from_hold = new is FlightMode.LAND and old is FlightMode.HOLD
            late = requested and new is not FlightMode.RTL and not lands_from_hold
            return new not in commanded and new is not FlightMode.GUIDED and not late
        resumed_s = self._resumed_s
        is_held = resumed_s is not None and t_s - resumed_s <= self._settings.asked_s
        if requested or (new is FlightMode.HOLD and is_held):
            return False
        if new in {FlightMode.LAND, FlightMode.RTL}:
            return old not in _LAND_AFTERWARDS
        return old is FlightMode.GUIDED

    def _modes_of(self, command: CommandFields) -> Iterable[FlightMode]:
        """Return the modes in which a command may result: any where that is not known."""
        if command.number == NAV_TAKEOFF:
            return self._vehicle.autopilot.takeoff_modes
        mode = self._mode_commands.get(command)
        return _MODES_OF.get(command.number, FlightMode) if mode is None else (mode,)

    def _store_sample(self, position_m: Vec3, velocity_m_s: Vec3, t_s: float) -> None:
        received_s = self.last_received_s
        is_silent = received_s is None or t_s - received_s > _FRESH_S
        if is_silent and position_m == self._stored_m:
            return  # Nothing shows whether the source is frozen: a stall would cut motors.
        self._stored_m, self._up_m = position_m, -position_m[2]
        self._speed_m_s = norm(velocity_m_s)
        self._seen_s = t_s


def _mode_commands(vehicle: GuardedVehicle) -> Iterator[tuple[CommandFields, FlightMode]]:
    """Yield the commands that set a vehicle's modes."""
    for mode in FlightMode:
        with suppress(ValueError):
            one = vehicle.autopilot.set_mode(vehicle.target, mode)
            command = CommandFields(
                one.command, one.param1, one.param2, one.target_system, one.param3
            )
            yield command, mode
