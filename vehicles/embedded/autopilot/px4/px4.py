"""The emulated PX4, which behaves over MAVLink as PX4 1.18 in SITL (SIH quadrotor) does."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.aircraft import EmulatedAircraft
from wil_campaign.vehicles.embedded.autopilot.flight.flight import TiltWatch
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GuidanceBehaviour,
    HoldBehaviour,
    TakeOffBehaviour,
    WantedMotion,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import EmulatedMissionItem
from wil_campaign.vehicles.embedded.autopilot.flight.places import is_altitude, is_on_globe
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    global_setpoint,
    local_setpoint,
)
from wil_campaign.vehicles.embedded.autopilot.px4 import px4_feasibility
from wil_campaign.vehicles.embedded.autopilot.px4.px4_core import Px4Core
from wil_campaign.vehicles.embedded.autopilot.px4.px4_failsafes import (
    WARNINGS,
    Px4FailsafeAction,
    Px4FailsafeDecision,
    Px4FailsafeInputs,
    Px4Failsafes,
)
from wil_campaign.vehicles.embedded.autopilot.px4.px4_modes import Px4Mode
from wil_campaign.vehicles.embedded.autopilot.services import mission_service
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    UNSUPPORTED,
    ReceivedCommand,
    on_command,
    on_message,
)
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import EmulatedFence
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL, INFO, WARNING
from wil_campaign.worlds.frames import Vec3, quat_from_euler, rotate

_HEADING_TEXT_S = 2.55
_TILT_FOR_S = 0.3
"""FD_FAIL_R_TTRI, FD_FAIL_P_TTRI."""
_BREAKER_CLOSED = 121212
"""Value of CBRK_FLIGHTTERM that keeps the failure detector from terminating the flight."""
_GF_WARNS = 1
"""GF_ACTION up to which no destination is refused."""
_FAILSAFE_MODES = {
    Px4FailsafeAction.HOLD: Px4Mode.HOLD,
    Px4FailsafeAction.RETURN: Px4Mode.RTL,
    Px4FailsafeAction.LAND: Px4Mode.LAND,
}


_STICKS_LOST = {1: Px4Mode.HOLD, 2: Px4Mode.RTL, 3: Px4Mode.LAND}
"""NAV_RCL_ACT."""


class Px4(Px4Core):
    """The emulated PX4 over MAVLink: setpoints, commands, missions, failsafes."""

    def __init__(self, aircraft: EmulatedAircraft) -> None:
        super().__init__(aircraft)
        self._failsafes = Px4Failsafes(self.parameters)
        self._tilt = TiltWatch(
            limit_rad=math.radians(self.parameters["FD_FAIL_R"]), for_s=_TILT_FOR_S
        )
        self._takeoff_down_m: float | None = None
        self._heading_text_sent = False
        self._left_offboard = False
        """Whether it flies a failsafe for lost setpoints: OFFBOARD, which the user chose, goes on
        once there are setpoints again (FailsafeBase::checkModeFallback)."""

    # Setpoints.

    @on_message("SET_POSITION_TARGET_LOCAL_NED")
    def _on_local_setpoint(self, message: Any) -> None:
        frame, now = message.coordinate_frame, self.state.now
        if frame == mavlink.MAV_FRAME_BODY_NED:
            # PX4 rotates body velocities by the whole attitude, and ignores body positions.
            body: Vec3 = (message.vx, message.vy, message.vz)
            message.vx, message.vy, message.vz = rotate(quat_from_euler(*now.euler_rad), body)
            message.type_mask |= 0b111
        elif frame != mavlink.MAV_FRAME_LOCAL_NED:
            self.outbox.send_text(
                CRITICAL, f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported\t"
            )
            return
        message.coordinate_frame = mavlink.MAV_FRAME_LOCAL_NED
        self._receive_setpoint(local_setpoint(message, now))

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if self.position_valid:
            state = self.state
            self._receive_setpoint(global_setpoint(message, state.frame, state.home_down_m))

    def _receive_setpoint(self, wanted: WantedMotion | None) -> None:
        if wanted is None:
            return
        self.setpoint_at_s = self.t_s
        self.follow.set(wanted, keep_yaw_rad=self.flight.law.yaw_setpoint_rad)

    # Commands.

    def choose(self, mode: Px4Mode) -> int:
        """Switch PX4 to the user's mode; a pending failsafe is dropped."""
        result = super().choose(mode)
        if result == ACCEPTED:
            self._left_offboard = False
            self._failsafes.on_user_mode()
        return result

    def _can_arm(self) -> bool:
        """Return whether PX4's checks pass, that of its geofence included."""
        return super()._can_arm() and self._fence_fault() is None

    def _arming_fault(self, *, force: bool) -> str | None:
        fault, outside = super()._arming_fault(force=force), self._fence_fault()
        if fault is not None and outside is not None:
            self.outbox.send_text(CRITICAL, f"{outside}\t")
        return fault

    def _fence_fault(self) -> str | None:
        """Return PX4's text for why it does not arm outside its geofence (geofenceCheck.cpp)."""
        if not int(self.parameters["GF_ACTION"]):
            return None
        return self._breach(self.fence)

    def _begin_flight(self) -> None:
        super()._begin_flight()
        self._failsafes.reset()

    @on_command(mavlink.MAV_CMD_NAV_TAKEOFF)
    def _take_off(self, command: ReceivedCommand) -> int:
        if not self._may_be_place(command):
            return DENIED
        origin_m = self.state.frame.altitude_m
        self._takeoff_down_m = origin_m - command.z if math.isfinite(command.z) else None
        return self.choose(Px4Mode.TAKEOFF)

    @on_command(mavlink.MAV_CMD_MISSION_START)
    def _start_mission(self, command: ReceivedCommand) -> int:
        """Fly PX4's mission, and arm for it; param1 is its first item."""
        if not self.missions.is_uploaded:
            self.outbox.send_text(CRITICAL, "Mission start denied! No valid mission\t")
            return DENIED
        first = command.params[0]
        if not (math.isfinite(first) and -1 <= first < self.state.mission_total):
            return DENIED
        if first >= 0:
            self.missions.set_current(int(first))
        result = self.choose(Px4Mode.MISSION)
        if result != ACCEPTED:
            return result
        self.armed_by, usual = "mission start", self.armed_by
        result = self.arm(force=False)
        self.armed_by = usual
        return result

    def mission_fault(self, items: tuple[EmulatedMissionItem, ...]) -> str | None:
        """Return PX4's text for why it does not fly a mission; None when it does."""
        home_amsl_m = self.state.frame.altitude_m - self.state.home_down_m
        return px4_feasibility.mission_fault(items, home_amsl_m=home_amsl_m)

    def lift(self, down_m: float) -> GuidanceBehaviour | None:
        """Return the climb that PX4 flies before a waypoint when it is on the ground."""
        if not self.flight.landed:
            return None
        state = self.state
        least_m = self.parameters["MIS_TAKEOFF_ALT"]
        return self.manoeuvres.take_off(min(down_m, state.home_down_m - least_m))

    @property
    def flies_by_speeds(self) -> bool:
        """Return whether PX4 flies by its own speeds."""
        return self.mode is not Px4Mode.OFFBOARD

    @on_command(mavlink.MAV_CMD_DO_REPOSITION)
    def _reposition(self, command: ReceivedCommand) -> int:
        if command.whole(1) != mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
            return UNSUPPORTED
        if not self.position_valid or not self._may_be_place(command):
            return DENIED
        position = self.place_of(command)
        result = self.choose(Px4Mode.HOLD)
        acts = int(self.parameters["GF_ACTION"]) > _GF_WARNS
        if acts and self._breach(self.fence, position) is not None:
            self.outbox.send_text(CRITICAL, "Reposition is outside geofence\t")
        elif result == ACCEPTED and not self.flight.landed:
            speed, _, _, yaw = command.params
            self.flight.fly(self.manoeuvres.go_to(position, speed_m_s=speed, yaw_rad=yaw))
        return result

    @on_command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION)
    def _terminate(self, command: ReceivedCommand) -> int:
        if command.params[0] > 0.5 and self.flight.armed:
            self.terminate("Flight termination by command")
            return ACCEPTED
        return DENIED

    @on_command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN)
    def _reboot(self, command: ReceivedCommand) -> int:
        action = command.whole(0)
        if action == 0:
            return ACCEPTED
        if action != 1 or self.flight.armed:
            return DENIED
        self.reboot_requested = True
        return ACCEPTED

    def _sets_home_here(self, command: ReceivedCommand) -> bool:
        return command.params[0] > 0.5

    @on_command(mavlink.MAV_CMD_NAV_LAND)
    def _land(self, _: ReceivedCommand) -> int:
        return self._choose_saying(Px4Mode.LAND, "Landing at current position\t")

    @on_command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    def _return(self, _: ReceivedCommand) -> int:
        return self._choose_saying(Px4Mode.RTL, "Returning to launch\t")

    def _choose_saying(self, mode: Px4Mode, text: str) -> int:
        if not self.flight.armed or self._can_run(mode):
            self.outbox.send_text(INFO, text)
        return self.choose(mode)

    # Flying.

    def _behaviour(self, mode: Px4Mode) -> GuidanceBehaviour:
        if mode is Px4Mode.TAKEOFF:
            down_m = self._takeoff_down_m
            if down_m is None:
                height_m = self.parameters["MIS_TAKEOFF_ALT"]
                down_m = self.state.home_down_m - height_m
                self.outbox.send_text(INFO, f"Using default takeoff altitude: {height_m:.1f} m\t")
            self._takeoff_down_m = None
            return self.manoeuvres.take_off(down_m)
        if mode is Px4Mode.MISSION:
            return self.missions.begin()
        return super()._behaviour(mode)

    # Supervision.

    def supervise(self) -> None:
        """Send PX4's due texts; check modes and failsafes."""
        if self.state.home_ned_m is None and self.position_valid:
            self.state.home_ned_m = self.state.now.position_ned_m
        if not self._heading_text_sent and self.t_s >= _HEADING_TEXT_S:
            self._heading_text_sent = True
            self.outbox.send_text(CRITICAL, "Preflight Fail: no heading reference\t")
        if not self.flight.armed:
            return
        self._report_phases()
        self.missions.watch()
        if not self.terminated:
            self._end_takeoff()
            if self._tilt.tumbling(self.state.now, self.t_s) and self._may_terminate():
                self.terminate("Critical failure detected: terminate flight")
            if self.mode.is_manual and self.fresh_sticks() is None:
                self.outbox.send_text(WARNING, "Manual control lost\t")
                self.fail(_STICKS_LOST.get(int(self.parameters["NAV_RCL_ACT"]), Px4Mode.RTL))
            if self._left_offboard and self.setpoints_stream:
                self.choose(Px4Mode.OFFBOARD)
            decision = self._failsafes.check(self._view())
            if decision is not None:
                self._act(decision)
        self._disarm_when_due()

    def _may_be_place(self, command: ReceivedCommand) -> bool:
        """Return whether PX4 accepts a command's position; NaN means not given."""
        x, y, z = (0.0 if math.isnan(each) else each for each in (command.x, command.y, command.z))
        return is_on_globe(x, y) and is_altitude(z)

    def _may_terminate(self) -> bool:
        return int(self.parameters["CBRK_FLIGHTTERM"]) != _BREAKER_CLOSED

    def _report_phases(self) -> None:
        flying = self.flight.takeoff_detected or not self.flight.landed
        if flying is not self.flying:
            self.flying = flying
            self.outbox.send_text(INFO, "Takeoff detected\t" if flying else "Landing detected\t")

    def _end_takeoff(self) -> None:
        """Change PX4 from TAKEOFF to HOLD near the takeoff height."""
        behaviour = self.flight.behaviour
        if (
            self.mode is Px4Mode.TAKEOFF
            and isinstance(behaviour, TakeOffBehaviour)
            and behaviour.done
        ):
            self.choose(Px4Mode.HOLD)
            self.flight.fly(
                HoldBehaviour(
                    speeds=self.manoeuvres.speeds(),
                    yaw_rad=behaviour.yaw_rad,
                    position_ned_m=behaviour.goal_ned_m,
                )
            )

    def _view(self) -> Px4FailsafeInputs:
        return Px4FailsafeInputs(
            t_s=self.t_s,
            offboard=self.mode is Px4Mode.OFFBOARD,
            landing=self.mode is Px4Mode.LAND and not self.failsafe,
            landed=self.flight.landed,
            setpoint_age_s=self.t_s - self.setpoint_at_s,
            gcs_age_s=self.t_s - self.gcs_last_received_s,
            battery=self.state.charge.remaining,
            outside_fence=self._breach(self.fence) is not None,
        )

    def _act(self, decision: Px4FailsafeDecision) -> None:
        action = decision.action
        breach = self._breach(self.fence) if decision.cause == "fence" else None
        if breach is not None:
            self.outbox.send_text(CRITICAL, breach)
        if action is Px4FailsafeAction.WARN:
            self.outbox.send_text(WARNING, WARNINGS[decision.cause])
        elif action is Px4FailsafeAction.DISARM:
            self.stop_motors("failsafe")
        elif action is Px4FailsafeAction.TERMINATE:
            self.terminate("Failsafe activated: terminate")
        elif not self.flight.landed or decision.cause == "offboard":
            self.fail(_FAILSAFE_MODES[action], hold_s=decision.hold_s)
            self._left_offboard = decision.cause == "offboard"

    def _breach(self, fence: EmulatedFence, place_ned_m: Vec3 | None = None) -> str | None:
        """Return PX4's text for how the vehicle, or a place, breaches a fence; None if not."""
        p, here = self.parameters, place_ned_m or self.state.now.position_ned_m
        far_m, high_m = self.manoeuvres.from_home_m(here)
        if 0.0 < p["GF_MAX_HOR_DIST"] < far_m:
            return "Geofence: exceeding maximum distance to Home"
        if 0.0 < p["GF_MAX_VER_DIST"] < high_m:
            return "Geofence: exceeding maximum altitude above Home"
        if fence.areas and fence.breached(here[0], here[1]):
            return "Geofence: approaching or outside geofence"
        return None

    def _fence_result(self, fence: EmulatedFence) -> int:
        """Refuse a PX4 fence that would be breached at once, or that excludes home."""
        home = self.state.home_ned_m
        breached = self._breach(fence) is not None or (
            home is not None and fence.breached(home[0], home[1])
        )
        if fence.areas and int(self.parameters["GF_ACTION"]) > 1 and breached:
            self.outbox.send_text(CRITICAL, "Geofence invalid, doesn't contain Home position\t")
            return int(mavlink.MAV_MISSION_DENIED)
        return mission_service.ACCEPTED

    def _disarm_delay_s(self, *, after_flight: bool) -> float:
        return self.parameters["COM_DISARM_LAND" if after_flight else "COM_DISARM_PRFLT"]
