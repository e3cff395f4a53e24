"""ArduCopter's state machine: readiness, arming, modes, and what it says of itself."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.airframe import Airframe
from vehicles.embedded.autopilot.ardupilot import boot
from vehicles.embedded.autopilot.ardupilot import flying as copter_flying
from vehicles.embedded.autopilot.ardupilot import telemetry as copter_telemetry
from vehicles.embedded.autopilot.ardupilot.avoidance import SimpleAvoidance
from vehicles.embedded.autopilot.ardupilot.modes import CopterMode, copter_mode
from vehicles.embedded.autopilot.base import EmbeddedAutopilot
from vehicles.embedded.autopilot.flying.flight import FlightStyle
from vehicles.embedded.autopilot.flying.guidance import Behaviour, Follow, Hold, ReturnHome
from vehicles.embedded.autopilot.flying.state import Identity
from vehicles.embedded.autopilot.services import telemetry
from vehicles.embedded.autopilot.services.commands import (
    ACCEPTED,
    FAILED,
    FORCE_ARM,
    FORCE_DISARM,
    Command,
)
from vehicles.embedded.autopilot.services.outbox import CRITICAL, EMERGENCY, INFO, WARNING
from vehicles.embedded.autopilot.services.parameters import load_parameters
from vehicles.embedded.battery import Charge
from vehicles.embedded.controller import Gains

_FILE = Path(__file__).with_name("parameters.yaml")
_GAINS = Gains(
    # PSC_NE_POS_P, PSC_D_POS_P; PSC_NE_VEL_P, PSC_D_VEL_P; PSC_NE_VEL_I; WP_ACC, WP_ACC_Z;
    # ATC_ANG_YAW_P; ATC_ANGLE_MAX. Roll and pitch stiffer than ATC_ANG_RLL_P of 4.5, for the
    # rate feed-forward that ArduCopter has and this controller has not.
    position=(1.0, 1.0),
    velocity=(2.0, 5.0),
    integral=(1.0, 2.0),
    acceleration_m_s2=(2.5, 1.0),
    attitude=(7.0, 4.5),
    max_tilt_rad=math.radians(30.0),
)


class CopterCore(EmbeddedAutopilot):
    """ArduCopter's modes and arming; what it does on messages and in time is in the subclass."""

    is_px4: ClassVar[bool] = False
    builders: ClassVar[dict[int, telemetry.Builder]] = telemetry.COMMON | copter_telemetry.BUILDERS
    style: ClassVar[FlightStyle] = FlightStyle(
        gains=_GAINS, spool_s=2.0, lift_s=1.15, noticed_s=1.15, touch_s=1.65
    )

    def __init__(
        self,
        *,
        identity: Identity,
        airframe: Airframe,
        dt_s: float,
        charge: Charge,
        overrides: Mapping[str, float],
    ) -> None:
        super().__init__(
            identity=identity,
            airframe=airframe,
            dt_s=dt_s,
            charge=charge,
            parameters=load_parameters(_FILE, bytewise=False, overrides=overrides),
            rates_hz=copter_telemetry.RATES_HZ,
        )
        self.mode = CopterMode.STABILIZE
        self.failsafe = False
        self.taking_off = False
        self._makers = self._makers_by_id()
        self.avoidance = SimpleAvoidance(self.parameters)
        self.follow = self._new_follow()
        self.velocity_at_s: float | None = None
        """When the velocity setpoint came that is being flown; None when none is."""

    # Readiness.

    @property
    def position_valid(self) -> bool:
        """Return whether EKF3 uses GPS."""
        return self.t_s >= boot.POSITION_S and not self.never_ready

    def _prearm_bit(self) -> bool:
        """Return the bit of SYS_STATUS: true long before GUIDED can be had."""
        return self.t_s >= boot.PREARM_BIT_S and not self.never_ready

    # What it says of itself.

    def message(self, message_id: int) -> Any | None:
        """Return a message that depends on modes and readiness."""
        make = self._makers.get(message_id)
        return make() if make is not None else None

    def _makers_by_id(self) -> dict[int, Callable[[], Any]]:
        flight, state = self.flight, self.state
        return {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: lambda: copter_telemetry.sys_status(
                state, prearm=self._prearm_bit()
            ),
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda: (
                mavlink.MAVLink_extended_sys_state_message(
                    mavlink.MAV_VTOL_STATE_MC, self._landed_state()
                )
            ),
            mavlink.MAVLINK_MSG_ID_VFR_HUD: lambda: copter_telemetry.vfr_hud(
                state, flight.throttle
            ),
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda: copter_telemetry.autopilot_version(
                self.identity
            ),
        }

    def _heartbeat(self) -> Any:
        flight, booting = self.flight, self.t_s < boot.INITIALISED_S
        base_mode = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        # The flag shows that the horizontal position controller runs; at boot it seems to.
        if booting or self.mode.controls_position:
            base_mode |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        if flight.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        if booting:
            status = mavlink.MAV_STATE_BOOT
        elif self.failsafe:
            status = mavlink.MAV_STATE_CRITICAL
        else:
            status = mavlink.MAV_STATE_STANDBY if flight.landed else mavlink.MAV_STATE_ACTIVE
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            self.mode.value,
            status,
            3,
        )

    def _landed_state(self) -> int:
        if self.flight.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.taking_off:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        behaviour = self.flight.behaviour
        if self.mode is CopterMode.LAND or (
            isinstance(behaviour, ReturnHome) and behaviour.landing
        ):
            return int(mavlink.MAV_LANDED_STATE_LANDING)
        return int(mavlink.MAV_LANDED_STATE_IN_AIR)

    # Modes.

    def set_mode(self, mode: int, submode: int) -> int:  # noqa: ARG002 - PX4 alone has submodes
        """Change to a mode that the user wants, if it can run."""
        wanted = copter_mode(mode)
        return self.choose(wanted) if wanted is not None else FAILED

    def choose(self, mode: CopterMode) -> int:
        """Switch to the user's mode if it can run."""
        if mode.needs_position and not self.position_valid:
            self.outbox.say(WARNING, f"Mode change to {mode.words} failed: requires position")
            return FAILED
        self.failsafe = False
        self.enter(mode)
        return ACCEPTED

    def enter(self, mode: CopterMode) -> None:
        """Fly a mode from now on."""
        self.taking_off = False
        if mode is not self.mode:
            self.mode = mode
            # ArduPilot tells a new mode at once, beside its heartbeat of every second.
            self.outbox.send_later(self._heartbeat())
        self.velocity_at_s = None
        if self.flight.armed:
            self.flight.fly(self._behaviour(mode))

    def fail(self, mode: CopterMode) -> None:
        """Begin a failsafe: fly this mode until the user chooses another."""
        self.enter(mode if self.position_valid else CopterMode.LAND)
        self.failsafe = True

    def _behaviour(self, mode: CopterMode) -> Behaviour:
        p, state = self.parameters, self.state
        if mode is CopterMode.GUIDED:
            self.follow = self._new_follow()
            self.follow.stand(state.now)
            return self.follow
        if mode is CopterMode.LAND:
            return copter_flying.land(p, state)
        if mode in {CopterMode.RTL, CopterMode.SMART_RTL}:
            return copter_flying.return_home(p, state)
        return Hold(speeds=copter_flying.speeds(p), yaw_rad=state.now.euler_rad[2])

    def _new_follow(self) -> Follow:
        speeds = copter_flying.speeds(self.parameters)
        limit = self.avoidance.limited if self.avoidance.listens else None
        return Follow(speeds=speeds, yaw_rad=0.0, may_lift=False, limit=limit)

    # Arming.

    def _is_forced(self, command: Command) -> bool:
        return command.params[1] == (FORCE_ARM if command.params[0] == 1.0 else FORCE_DISARM)

    def arm(self, *, force: bool) -> int:
        """Arm if the checks pass; by force they are skipped."""
        if self.flight.armed:
            return ACCEPTED
        fault = self._arming_fault(force=force)
        if fault is not None:
            self.outbox.say(CRITICAL, f"Arm: {fault}")
            return FAILED
        self.flight.arm(self.t_s)
        self.failsafe = False
        if self.t_s >= boot.HOME_SET_S:
            self.set_home()
        self.outbox.say(INFO, "Arming motors")
        self.enter(self.mode)
        return ACCEPTED

    def set_home(self) -> None:
        """Let home be here, and say so."""
        self.state.home_ned_m = self.state.now.position_ned_m
        self.outbox.send_later(telemetry.gps_global_origin(self.state))
        self.outbox.send_later(telemetry.home_position(self.state))

    def _arming_fault(self, *, force: bool) -> str | None:
        if self.refusal is not None:
            return self.refusal
        if self.t_s < boot.INITIALISED_S:
            return "System not initialised"
        if not self.mode.allows_arming:
            return f"{self.mode.words} mode not armable"
        if force:
            return None
        if not self._prearm_bit() or (self.mode.needs_position and not self.position_valid):
            return "Need Position Estimate"
        return self.avoidance.arming_fault(self.t_s)

    def disarm(self, *, force: bool) -> int:
        """Disarm on the ground, in the air only by force."""
        if not self.flight.armed:
            return ACCEPTED
        if not (self.flight.landed or force):
            return FAILED
        self.stop_motors()
        return ACCEPTED

    def stop_motors(self) -> None:
        """Disarm now."""
        self.flight.disarm()
        self.taking_off = False
        self.failsafe = False
        self.outbox.say(INFO, "Disarming motors")

    def strike(self, thing: str) -> None:
        """Disarm: ArduCopter's crash check sees the attitude leave what was asked."""
        if self.flight.armed:
            self.outbox.say(EMERGENCY, f"Crash: Disarming ({thing})")
            self.stop_motors()
