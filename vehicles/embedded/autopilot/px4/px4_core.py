"""PX4's state machine: readiness, arming, modes, and its reported state."""

import math
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.px4 import Px4 as Strategy
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
    speed_limits,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import ItemRules
from wil_campaign.vehicles.embedded.autopilot.flight.sticks import StickLimits
from wil_campaign.vehicles.embedded.autopilot.px4 import px4_telemetry
from wil_campaign.vehicles.embedded.autopilot.px4.px4_behaviors import Px4Manoeuvres
from wil_campaign.vehicles.embedded.autopilot.px4.px4_failsafes import GCS_SILENT_AFTER_S
from wil_campaign.vehicles.embedded.autopilot.px4.px4_modes import (
    ENTRIES,
    NOT_EMULATED,
    Px4Mode,
    mode_of_flags,
    px4_mode,
)
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    FORCE_DISARM,
    TEMPORARILY_REJECTED,
    ReceivedCommand,
    on_request,
)
from wil_campaign.vehicles.embedded.autopilot.services.fence_items import FENCE_COMMANDS
from wil_campaign.vehicles.embedded.autopilot.services.log_formats import ULog
from wil_campaign.vehicles.embedded.autopilot.services.message_hub import MessageRules
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL, EMERGENCY, INFO
from wil_campaign.vehicles.embedded.control.law import PX4

# Seconds since boot, from the reference trace.
_POSITION_S = 3.2
_CHECKS_PASS_S = 4.9
_PREARM_BIT_S = 6.3
_TERRAIN_LOST_S = 0.7
"""How long after landing the estimator loses its height above ground."""
_PREARM_BIT_OFF_S = 0.18
"""How long the pre-arm bit is 0 when a failsafe begins."""

_FLOWN = {16, 17, 19, 20, 21, 22, 31, 93}
"""WAYPOINT, LOITER_UNLIM, LOITER_TIME, RETURN_TO_LAUNCH, LAND, TAKEOFF, LOITER_TO_ALT, DELAY."""
_ACTIONS = {177, 178, 179, 183, 187, 189, 4501}
"""DO_JUMP, CHANGE_SPEED, SET_HOME, SET_SERVO, SET_ACTUATOR, LAND_START; CONDITION_GATE."""
_PAYLOADS = {195, 196, 197, 200, 201, 203, 204, 205, 206, 211, 212, 214, 260, 530, 531, 532}
_CAMERAS = {1000, 1001, 2000, 2001, 2003, 2500, 2501, 42600}

RULES = ItemRules(
    commands={
        mavlink.MAV_MISSION_TYPE_MISSION: frozenset(_FLOWN | _ACTIONS | _PAYLOADS | _CAMERAS),
        mavlink.MAV_MISSION_TYPE_FENCE: FENCE_COMMANDS,
        mavlink.MAV_MISSION_TYPE_RALLY: frozenset({mavlink.MAV_CMD_NAV_RALLY_POINT}),
    },
    frames=frozenset(
        {
            mavlink.MAV_FRAME_GLOBAL,
            mavlink.MAV_FRAME_GLOBAL_INT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        }
    ),
    most={
        mavlink.MAV_MISSION_TYPE_MISSION: 700,
        mavlink.MAV_MISSION_TYPE_FENCE: Strategy.most_fence_items,
        mavlink.MAV_MISSION_TYPE_RALLY: 32,
    },
    nan_is_unset=True,
    unplaced_frame=mavlink.MAV_FRAME_MISSION,
)
"""Items of missions, fences and rally points that PX4 accepts (mavlink_mission.cpp, v1.18)."""


class Px4Core(EmulatedAutopilot[Px4Mode]):
    """PX4's modes and arming; the subclass handles setpoints, missions and failsafes."""

    name: ClassVar[str] = Strategy.name
    firmware: ClassVar[FirmwareTraits] = FirmwareTraits(
        mav_autopilot=mavlink.MAV_AUTOPILOT_PX4,
        messages=MessageRules(
            takes_broadcasts=False, no_stream=FAILED, no_message=DENIED, shortest_us=None
        ),
        parameter_file=Strategy.embedded_parameters,
        bytewise=True,
        strict_parameters=True,
        files={},
        item_rules=RULES,
        first_mission_item=0,
        mode_entries=ENTRIES,
        other_mode=2,
        refused=TEMPORARILY_REJECTED,
        set_mode_ack=mavlink.MAV_CMD_DO_SET_MODE,  # PX4 converts it to the command
        heights_relative=False,
        numbers_texts=True,
        log_format=ULog,
        first_log=0,
        gps_time_s=0.0,
    )
    standard = StandardModes(Px4Mode.MISSION, Px4Mode.RTL, Px4Mode.LAND)
    builders: ClassVar[dict[int, telemetry.Builder]] = telemetry.COMMON | px4_telemetry.BUILDERS
    style: ClassVar[FlightStyle] = FlightStyle(
        law=PX4, spool_s=1.0, lift_s=2.5, noticed_s=0.88, touch_s=1.0
    )
    no_mission_items: ClassVar[int] = 65535  # as in the reference trace
    manoeuvres: Px4Manoeuvres

    def __init__(self, aircraft: EmulatedAircraft) -> None:
        rates_hz = px4_telemetry.FULL_HZ if aircraft.full_streams else px4_telemetry.LEAN_HZ
        super().__init__(aircraft, rates_hz=rates_hz, mode=Px4Mode.HOLD)
        self.manoeuvres = Px4Manoeuvres(self.parameters, self.state)
        self.terminated = False
        self.armed_by = "external command"
        self.flying = False
        """Whether takeoff is detected, and landing not yet."""
        self.setpoint_at_s = -math.inf
        self.follow = FollowBehaviour(
            speeds=self.manoeuvres.offboard_speeds(), yaw_rad=0.0, may_lift=True, direct=True
        )
        self._mode_after_disarm = Px4Mode.HOLD
        self._failsafe_at_s = -math.inf

    # Readiness.

    @property
    def position_valid(self) -> bool:
        """Return whether PX4's estimator has a position."""
        return self.t_s >= _POSITION_S

    @property
    def setpoints_stream(self) -> bool:
        """Return whether PX4's offboard setpoints are fresh."""
        return self.t_s - self.setpoint_at_s <= self.parameters["COM_OF_LOSS_T"]

    def _can_arm(self) -> bool:
        """Return whether PX4's checks pass in the present mode."""
        if self.never_ready or self.t_s < _CHECKS_PASS_S or self.terminated:
            return False
        if self.mode is Px4Mode.OFFBOARD and not self.setpoints_stream:
            return False
        if self.mode is Px4Mode.MISSION and not self.missions.is_uploaded:
            return False
        if self.mode.is_manual and self.fresh_sticks() is None:
            return False
        return not self.mode.prevents_arming

    def _prearm_bit(self) -> bool:
        """Return PX4's pre-arm bit of SYS_STATUS: set after the checks, 0 as a failsafe begins."""
        if self.never_ready or self.t_s < _PREARM_BIT_S or self.terminated:
            return False
        if self.flight.armed:
            return self.t_s - self._failsafe_at_s > _PREARM_BIT_OFF_S
        return self._can_arm()

    def _sends_texts(self) -> bool:
        return self.t_s - self.gcs_last_received_s <= GCS_SILENT_AFTER_S

    # Reported state.

    def _custom_mode(self) -> int:
        return self.mode.custom_mode

    def _base_mode(self) -> int:
        return self.mode.base_mode

    def _system_status(self) -> int:
        if self.terminated:
            return int(mavlink.MAV_STATE_FLIGHT_TERMINATION)
        if self.flight.armed:
            return int(mavlink.MAV_STATE_CRITICAL if self.failsafe else mavlink.MAV_STATE_ACTIVE)
        return int(mavlink.MAV_STATE_STANDBY if self._can_arm() else mavlink.MAV_STATE_UNINIT)

    @on_request(mavlink.MAVLINK_MSG_ID_SYS_STATUS)
    def _sys_status(self) -> Any:
        return px4_telemetry.sys_status(self.state, prearm=self._prearm_bit())

    @on_request(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
    def _extended_sys_state(self) -> Any:
        return mavlink.MAVLink_extended_sys_state_message(
            mavlink.MAV_VTOL_STATE_UNDEFINED, self._landed_state()
        )

    @on_request(mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS)
    def _estimator_status(self) -> Any:
        landed_at_s = self.flight.landed_at_s if self.flight.landed else None
        return px4_telemetry.estimator_status(
            self.state,
            armed=self.flight.armed,
            landed_after_flight=landed_at_s is not None
            and self.t_s - landed_at_s > _TERRAIN_LOST_S,
        )

    @on_request(mavlink.MAVLINK_MSG_ID_VFR_HUD)
    def _vfr_hud(self) -> Any:
        return telemetry.vfr_hud(self.state, self.flight.throttle, airspeed_m_s=math.nan)

    @on_request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    def _autopilot_version(self) -> Any:
        return px4_telemetry.autopilot_version(self.identity)

    def _landed_state(self) -> int:
        if not self.flight.armed or not self.flying:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.mode is Px4Mode.TAKEOFF:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        if self.mode is Px4Mode.LAND:
            return int(mavlink.MAV_LANDED_STATE_LANDING)
        return int(mavlink.MAV_LANDED_STATE_IN_AIR)

    def _split_mode(self, custom_mode: int) -> tuple[int, int]:
        return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF

    # Modes.

    def set_mode(self, mode: int, submode: int) -> int:
        """Switch PX4 to the user's mode by its numbers, if it can run.

        Of numbers that are no mode PX4 refuses an unknown AUTO mode alone (Commander.cpp).
        """
        numbers = mode & 0xFF, submode & 0xFF
        wanted = px4_mode(*numbers)
        if numbers in NOT_EMULATED:
            return DENIED
        if wanted is None and numbers[0] == Px4Mode.MISSION.value[0]:
            self.outbox.send_text(CRITICAL, "Unsupported auto mode\t")
            return TEMPORARILY_REJECTED
        return ACCEPTED if wanted is None else self.choose(wanted)

    def set_base_mode(self, base_mode: int) -> int:
        """Set PX4's mode by MAV_MODE_FLAGs; flags that name none change nothing."""
        wanted = mode_of_flags(base_mode)
        return ACCEPTED if wanted is None else self.choose(wanted)

    def choose(self, mode: Px4Mode) -> int:
        """Switch PX4 to the user's mode; while armed only if it can run. Ends a failsafe."""
        if self.flight.armed and not self._can_run(mode):
            self.outbox.send_text(
                CRITICAL, f"Switching to mode '{mode.words}' is currently not possible\t"
            )
            return TEMPORARILY_REJECTED
        self.failsafe = False
        if not mode.prevents_arming:
            self._mode_after_disarm = mode
        self.enter(mode)
        return ACCEPTED

    def _can_run(self, mode: Px4Mode) -> bool:
        if self.terminated or (mode.is_manual and self.fresh_sticks() is None):
            return False
        if mode is Px4Mode.OFFBOARD:
            return self.setpoints_stream
        if mode is Px4Mode.MISSION:
            return self.missions.is_uploaded
        return self.position_valid

    def fail(self, mode: Px4Mode, *, hold_s: float = 0.0) -> None:
        """Begin a PX4 failsafe: fly its mode until the user chooses another.

        hold_s: for how long it holds before it acts.
        """
        self.failsafe = True
        self._failsafe_at_s = self.t_s
        after = f": entering Hold for {hold_s:.0f} seconds" if hold_s > 0.0 else ""
        self.outbox.send_text(CRITICAL, f"Failsafe activated{after}\t")
        self.enter(mode)

    def _behaviour(self, mode: Px4Mode) -> GuidanceBehaviour:
        if mode is Px4Mode.OFFBOARD:
            return self.follow
        if mode is Px4Mode.LAND:
            return self.manoeuvres.land()
        if mode is Px4Mode.RTL:
            return self.return_home()
        if mode.is_manual and self.sticks is not None:
            return self._by_sticks()
        return self.manoeuvres.hold()

    def _stick_limits(self) -> StickLimits:
        p = self.parameters
        speeds = speed_limits(p["MPC_VEL_MANUAL"], p["MPC_Z_VEL_MAX_UP"], p["MPC_Z_VEL_MAX_DN"])
        return StickLimits(speeds, math.radians(p["MPC_MAN_Y_MAX"]))

    def _sticks_last_s(self) -> float:
        return self.parameters["COM_RC_LOSS_T"]

    def return_home(self) -> GuidanceBehaviour:
        """Return the behaviour that flies PX4 home, and say so."""
        state, height_m = self.state, self.manoeuvres.return_height_m()
        amsl_m = state.frame.altitude_m - state.home_down_m + height_m
        self.outbox.send_text(
            INFO, f"RTL: start return at {amsl_m:.0f} m ({height_m:.0f} m above destination)\t"
        )
        return self.manoeuvres.go_home()

    # Arming.

    def _is_forced(self, command: ReceivedCommand) -> bool:
        return command.params[1] == FORCE_DISARM

    def _arming_fault(self, *, force: bool) -> str | None:  # noqa: ARG002 - ArduCopter skips checks
        # An arm command from outside never skips the checks (Commander.cpp).
        if self.refusal is None and self._can_arm():
            return None
        return f"Arming denied: {self.refusal or 'Resolve system health failures first'}\t"

    def _begin_flight(self) -> None:
        self.state.home_ned_m = self.state.now.position_ned_m
        self.outbox.send_text(INFO, f"Armed by {self.armed_by}\t")
        self.flying = False

    def _arming_action(self, number: float) -> float:
        return math.floor(abs(number) + 0.5) if math.isfinite(number) else 0.0

    @property
    def _is_on_ground(self) -> bool:
        return self.flight.landed and not self.flight.takeoff_detected

    def _report_not_landed(self) -> None:
        self.outbox.send_text(CRITICAL, "Disarming denied: not landed\t")

    def stop_motors(self, by: str) -> None:
        """Disarm PX4 now, and return to the user's last mode that allows arming."""
        self.flight.disarm()
        self.failsafe = False
        self.mode = self._mode_after_disarm
        self.outbox.send_text(INFO, f"Disarmed by {by}\t")

    def terminate(self, text: str) -> None:
        """Terminate PX4's flight: cut the motors for good."""
        self.terminated = self.flight.motors_cut = True
        self.outbox.send_text(EMERGENCY, f"{text}\t")

    def strike(self, thing: str) -> None:
        """Terminate: PX4's failure detector sees the attitude leave its limits."""
        if self.flight.armed and not self.terminated:
            self.terminate(f"Critical failure detected: terminate flight ({thing})")
