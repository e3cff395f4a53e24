"""ArduCopter's state machine: readiness, arming, modes, and its reported state."""

import math
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.copter import copter_boot as boot
from wil_campaign.plugins.ardupilot.copter import copter_kernel, copter_telemetry
from wil_campaign.plugins.ardupilot.copter.avoidance import SimpleAvoidance
from wil_campaign.plugins.ardupilot.copter.copter_behaviors import CopterManoeuvres
from wil_campaign.plugins.ardupilot.copter.copter_missions import RULES
from wil_campaign.plugins.ardupilot.copter.copter_modes import (
    ENTRIES,
    CopterMode,
    copter_mode,
)
from wil_campaign.plugins.ardupilot.copter.data_flash import DataFlash
from wil_campaign.plugins.ardupilot.copter.parameter_file import PATH as PARAMETER_FILE
from wil_campaign.plugins.ardupilot.copter.parameter_file import parameter_file
from wil_campaign.plugins.ardupilot.strategy import ArduCopter as Strategy
from wil_campaign.vehicles.embedded.autopilot.aircraft import EmulatedAircraft, FirmwareTraits
from wil_campaign.vehicles.embedded.autopilot.emulated_autopilot import (
    EmulatedAutopilot,
    StandardModes,
)
from wil_campaign.vehicles.embedded.autopilot.flight import telemetry
from wil_campaign.vehicles.embedded.autopilot.flight.flight import FlightStyle
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    FollowBehaviour,
    GuidanceBehaviour,
    ReturnHomeBehaviour,
    speed_limits,
)
from wil_campaign.vehicles.embedded.autopilot.flight.sticks import StickLimits
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    FORCE_ARM,
    FORCE_DISARM,
    ReceivedCommand,
    on_request,
)
from wil_campaign.vehicles.embedded.autopilot.services.message_hub import MessageRules
from wil_campaign.vehicles.embedded.autopilot.services.outbox import EMERGENCY, INFO, WARNING
from wil_campaign.vehicles.embedded.control.law import ControlLawKind
from wil_campaign.worlds.frames import Vec3

_SHORTEST_US = 3000.0
"""The shortest interval of a message at SCHED_LOOP_RATE 400 (GCS::cap_message_interval)."""

_ALTITUDE_FENCE, _CIRCLE_FENCE, _POLYGON_FENCE, _FLOOR_FENCE = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
FLOOR = "Min Alt"
_TAKE_SPEEDS = {CopterMode.AUTO, CopterMode.GUIDED, CopterMode.RTL, CopterMode.SMART_RTL}

LAW = ControlLawKind(
    copter_kernel.step_copter_law,
    copter_kernel.advance_copter_body,
    copter_kernel.GAINS,
    copter_kernel.DEGREES,
    copter_kernel.HUNDREDTHS,
    # Identified from step responses of ArduCopter 4.7: pitch in the step to 0.8 m/s, heading in the
    # step of 60 degrees; the other segments are not fitted.
    (500.0, 500.0, 40.0),
    0.135,
)


class CopterCore(EmulatedAutopilot[CopterMode]):
    """ArduCopter's modes and arming; the subclass handles commands, missions and failsafes."""

    name: ClassVar[str] = Strategy.name
    firmware: ClassVar[FirmwareTraits] = FirmwareTraits(
        mav_autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        messages=MessageRules(
            takes_broadcasts=True, no_stream=DENIED, no_message=FAILED, shortest_us=_SHORTEST_US
        ),
        parameter_file=Strategy.embedded_parameters,
        bytewise=False,
        strict_parameters=False,
        files={PARAMETER_FILE: parameter_file},
        item_rules=RULES,
        first_mission_item=1,
        mode_entries=ENTRIES,
        other_mode=0,
        refused=FAILED,
        set_mode_ack=None,  # handle_set_mode sends none
        heights_relative=True,
        numbers_texts=False,
        log_format=DataFlash,
        first_log=1,
        gps_time_s=boot.GPS_S,
    )
    standard = StandardModes(CopterMode.AUTO, CopterMode.RTL, CopterMode.LAND)
    builders: ClassVar[dict[int, telemetry.Builder]] = telemetry.COMMON | copter_telemetry.BUILDERS
    style: ClassVar[FlightStyle] = FlightStyle(
        law=LAW, spool_s=2.0, lift_s=1.15, noticed_s=1.15, touch_s=1.65
    )
    manoeuvres: CopterManoeuvres

    def __init__(self, aircraft: EmulatedAircraft) -> None:
        super().__init__(aircraft, rates_hz=copter_telemetry.RATES_HZ, mode=CopterMode.STABILIZE)
        if "BATT_LOW_VOLT" not in aircraft.overrides:
            self._fit_low_voltage(aircraft.body.battery.empty_v)
        self.manoeuvres = CopterManoeuvres(self.parameters, self.state)
        self.taking_off = False
        self.avoidance = SimpleAvoidance(self.parameters)
        self.follow = self._new_follow()
        self.velocity_at_s: float | None = None
        """Time of arrival of the velocity setpoint being flown; None without one."""

    def _fit_low_voltage(self, empty_v: float) -> None:
        """Have the default suit the pack: one of two cells is always below that of three."""
        self.parameters.set("BATT_LOW_VOLT", min(empty_v, self.parameters["BATT_LOW_VOLT"]))

    # Readiness.

    @property
    def position_valid(self) -> bool:
        """Return whether ArduCopter's EKF3 uses GPS."""
        return self.t_s >= boot.POSITION_S and not self.never_ready

    def _prearm_bit(self) -> bool:
        """Return ArduCopter's pre-arm bit of SYS_STATUS: true long before GUIDED is possible."""
        if self.t_s < boot.PREARM_BIT_S or self.never_ready:
            return False
        return self.flight.armed or not self.avoidance.lacks_data(self.t_s)

    # Reported state.

    @property
    def takes_speeds(self) -> bool:
        """Return whether ArduCopter's mode takes a change of speed (Mode::set_speed_xy)."""
        return self.mode in _TAKE_SPEEDS

    def _custom_mode(self) -> int:
        return self.mode.value

    def _base_mode(self) -> int:
        base_mode: int = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        # The flag means that the horizontal position controller runs; it is set during boot.
        if self.t_s < boot.INITIALISED_S or self.mode.controls_position:
            base_mode |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        return base_mode

    def _system_status(self) -> int:
        if self.t_s < boot.INITIALISED_S:
            return int(mavlink.MAV_STATE_BOOT)
        return int(mavlink.MAV_STATE_STANDBY if self.flight.landed else mavlink.MAV_STATE_ACTIVE)

    @on_request(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    def _sys_status(self) -> Any:
        return copter_telemetry.sys_status(self.state, prearm=self._prearm_bit())

    @on_request(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
    def _extended_sys_state(self) -> Any:
        return mavlink.MAVLink_extended_sys_state_message(
            mavlink.MAV_VTOL_STATE_MC, self._landed_state()
        )

    @on_request(mavlink.MAVLINK_MSG_ID_VFR_HUD)
    def _vfr_hud(self) -> Any:
        speed_m_s = telemetry.ground_speed_m_s(self.state)
        return telemetry.vfr_hud(self.state, self.flight.throttle, airspeed_m_s=speed_m_s)

    @on_request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    def _autopilot_version(self) -> Any:
        return copter_telemetry.autopilot_version(self.identity)

    def _landed_state(self) -> int:
        if self.flight.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.taking_off:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        behaviour = self.flight.behaviour
        if self.mode is CopterMode.LAND or (
            isinstance(behaviour, ReturnHomeBehaviour) and behaviour.landing
        ):
            return int(mavlink.MAV_LANDED_STATE_LANDING)
        return int(mavlink.MAV_LANDED_STATE_IN_AIR)

    # Modes.

    def set_mode(self, mode: int, submode: int) -> int:  # noqa: ARG002 - PX4 alone has submodes
        """Switch ArduCopter to the user's mode by number, if it can run."""
        wanted = copter_mode(mode)
        if wanted is None:
            self.outbox.send_text(WARNING, f"No such mode {mode}")
            return FAILED
        return self.choose(wanted)

    def choose(self, mode: CopterMode) -> int:
        """Switch ArduCopter to the user's mode if it can run.

        A mode that is flown already goes on as it is (`Copter::set_mode`): choosing GUIDED again
        does not end a takeoff. Disarmed it takes any mode; arming checks it.
        """
        if mode is self.mode and self.flight.armed:
            self.failsafe = False
            return ACCEPTED
        if self.flight.armed and mode.needs_position and not self.position_valid:
            self.outbox.send_text(WARNING, f"Mode change to {mode.words} failed: requires position")
            return FAILED
        self.failsafe = False
        self.enter(mode)
        return ACCEPTED

    def enter(self, mode: CopterMode) -> None:
        """Enter an ArduCopter mode."""
        self.taking_off = False
        if mode is not self.mode:
            self.manoeuvres.forget_speeds()
            self.mode = mode
            # ArduPilot reports a new mode by an extra heartbeat at once.
            self.outbox.send_later(self._heartbeat())
        self.velocity_at_s = None
        super().enter(mode)

    def fail(self, mode: CopterMode) -> None:
        """Begin an ArduCopter failsafe: fly its mode until the user chooses another."""
        self.enter(mode if self.position_valid else CopterMode.LAND)
        self.failsafe = True

    def _behaviour(self, mode: CopterMode) -> GuidanceBehaviour:
        if mode is CopterMode.GUIDED:
            self.follow = self._new_follow()
            self.follow.stand(self.state.now)
            return self.follow
        if mode is CopterMode.LAND:
            return self.manoeuvres.land()
        if mode in {CopterMode.RTL, CopterMode.SMART_RTL}:
            return self.manoeuvres.go_home()
        if mode.is_manual and self.sticks is not None:
            return self._by_sticks()
        return self.manoeuvres.hold()

    def _stick_limits(self) -> StickLimits:
        p = self.parameters
        up_cm_s = p["PILOT_SPEED_UP"]
        down_cm_s = p["PILOT_SPEED_DN"] or up_cm_s
        speeds = speed_limits(p["LOIT_SPEED"] / 100.0, up_cm_s / 100.0, down_cm_s / 100.0)
        return StickLimits(speeds, math.radians(p["PILOT_Y_RATE"]))

    def _sticks_last_s(self) -> float:
        return self.parameters["RC_OVERRIDE_TIME"]

    def _new_follow(self) -> FollowBehaviour:
        speeds = self.manoeuvres.speeds()
        limit = self.avoidance.limited if self.avoidance.listens else None
        return FollowBehaviour(speeds=speeds, yaw_rad=0.0, may_lift=False, limit=limit)

    # Arming.

    def _is_forced(self, command: ReceivedCommand) -> bool:
        arms = command.params[0] == 1.0
        return command.params[1] == FORCE_DISARM or (arms and command.params[1] == FORCE_ARM)

    def _begin_flight(self) -> None:
        if self.t_s >= boot.HOME_SET_S:
            self.set_home()
        self.outbox.send_text(INFO, "Arming motors")

    def set_home(self) -> None:
        """Set ArduCopter's home here, and send it."""
        self.state.home_ned_m = self.state.now.position_ned_m
        self.outbox.send_later(telemetry.gps_global_origin(self.state))
        self.outbox.send_later(telemetry.home_position(self.state))

    def _arming_fault(self, *, force: bool) -> str | None:
        fault = self._unready(force=force)
        return None if fault is None else f"Arm: {fault}"

    def _unready(self, *, force: bool) -> str | None:
        """Return ArduCopter's first failing check; None when all pass."""
        if self.refusal is not None:
            return self.refusal
        if self.t_s < boot.INITIALISED_S:
            return "System not initialised"
        if not self.mode.allows_arming:
            return f"{self.mode.words} mode not armable"
        if force:
            return None
        unplaced = not self._prearm_bit() or (self.mode.needs_position and not self.position_valid)
        fault = self.avoidance.arming_fault(self.t_s)
        return fault or ("Need Position Estimate" if unplaced else None)

    def fences_broken_at(self, place_ned_m: Vec3) -> tuple[str, ...]:
        """Return the names of ArduCopter's fences that leave a place out; none when off."""
        p, home = self.parameters, self.state.home_ned_m or (0.0, 0.0, 0.0)
        kinds = int(p["FENCE_TYPE"]) if p["FENCE_ENABLE"] else 0
        north, east, down = place_ned_m
        height_m = home[2] - down
        out = {
            _ALTITUDE_FENCE: ("Max Alt", height_m > p["FENCE_ALT_MAX"]),
            _CIRCLE_FENCE: (
                "Circle",
                math.hypot(north - home[0], east - home[1]) > p["FENCE_RADIUS"],
            ),
            _POLYGON_FENCE: ("Polygon", bool(kinds) and self.fence.breached(north, east)),
            _FLOOR_FENCE: (FLOOR, height_m < p["FENCE_ALT_MIN"]),
        }
        return tuple(name for bit, (name, broken) in out.items() if kinds & bit and broken)

    def stop_motors(self, by: str) -> None:  # noqa: ARG002 - ArduCopter does not say by what
        """Disarm ArduCopter now."""
        self.flight.disarm()
        self.taking_off = False
        self.failsafe = False
        self.outbox.send_text(INFO, "Disarming motors")

    def strike(self, thing: str) -> None:
        """Disarm: ArduCopter's crash check sees the attitude leave its target."""
        if self.flight.armed:
            self.outbox.send_text(EMERGENCY, f"Crash: Disarming ({thing})")
            self.stop_motors("crash check")
