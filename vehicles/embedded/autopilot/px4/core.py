"""PX4's state machine: readiness, arming, modes, and what it says of itself."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.airframe import Airframe
from vehicles.embedded.autopilot.base import EmbeddedAutopilot
from vehicles.embedded.autopilot.flying.flight import FlightStyle
from vehicles.embedded.autopilot.flying.guidance import Behaviour, Follow, Hold
from vehicles.embedded.autopilot.flying.state import Identity
from vehicles.embedded.autopilot.px4 import flying as px4_flying
from vehicles.embedded.autopilot.px4 import telemetry as px4_telemetry
from vehicles.embedded.autopilot.px4.modes import Px4Mode, px4_mode
from vehicles.embedded.autopilot.services import telemetry
from vehicles.embedded.autopilot.services.commands import (
    ACCEPTED,
    DENIED,
    FORCE_DISARM,
    TEMPORARILY_REJECTED,
    Command,
)
from vehicles.embedded.autopilot.services.outbox import CRITICAL, EMERGENCY, INFO
from vehicles.embedded.autopilot.services.parameters import load_parameters
from vehicles.embedded.battery import Charge
from vehicles.embedded.controller import Gains

_FILE = Path(__file__).with_name("parameters.yaml")
_GCS_SILENT_AFTER_S = 2.5
"""A ground station whose heartbeat is older is gone (mavlink_receiver.cpp)."""

# Seconds since boot, from the reference trace.
_POSITION_S = 3.2
_CHECKS_PASS_S = 4.9
_PREARM_BIT_S = 6.3
_TERRAIN_LOST_S = 0.7
"""After landing the estimator's height above ground is gone."""
_PREARM_BIT_OFF_S = 0.18
"""How long the pre-arm bit falls when a failsafe begins."""


class Px4Core(EmbeddedAutopilot):
    """PX4's modes and arming; what it does on messages and in time is in the subclass."""

    is_px4: ClassVar[bool] = True
    builders: ClassVar[dict[int, telemetry.Builder]] = telemetry.COMMON | px4_telemetry.BUILDERS
    style: ClassVar[FlightStyle] = FlightStyle(
        gains=Gains(), spool_s=1.0, lift_s=2.5, noticed_s=0.88, touch_s=1.0
    )

    def __init__(
        self,
        *,
        identity: Identity,
        airframe: Airframe,
        dt_s: float,
        charge: Charge,
        overrides: Mapping[str, float],
        full_streams: bool,
    ) -> None:
        super().__init__(
            identity=identity,
            airframe=airframe,
            dt_s=dt_s,
            charge=charge,
            parameters=load_parameters(_FILE, bytewise=True, overrides=overrides),
            rates_hz=px4_telemetry.FULL_HZ if full_streams else px4_telemetry.LEAN_HZ,
        )
        self.mode = Px4Mode.HOLD
        self.failsafe = False
        self.terminated = False
        self.flying = False
        """Whether takeoff was detected, and landing not yet."""
        self.setpoint_at_s = -math.inf
        self.follow = Follow(
            speeds=px4_flying.offboard_speeds(self.parameters), yaw_rad=0.0, may_lift=True
        )
        self._makers = self._makers_by_id()
        self._mode_after_disarm = Px4Mode.HOLD
        self._failsafe_at_s = -math.inf

    # Readiness.

    @property
    def position_valid(self) -> bool:
        """Return whether the estimator has a position."""
        return self.t_s >= _POSITION_S

    @property
    def setpoints_stream(self) -> bool:
        """Return whether offboard setpoints are fresh."""
        return self.t_s - self.setpoint_at_s <= self.parameters["COM_OF_LOSS_T"]

    def _can_arm(self) -> bool:
        """Return whether the checks pass in the present mode."""
        if self.never_ready or self.t_s < _CHECKS_PASS_S or self.terminated:
            return False
        if self.mode is Px4Mode.OFFBOARD and not self.setpoints_stream:
            return False
        return not (self.mode.prevents_arming or self.mode.is_manual)

    def _prearm_bit(self) -> bool:
        """Return the bit of SYS_STATUS: later than the checks, and off as a failsafe begins."""
        if self.never_ready or self.t_s < _PREARM_BIT_S or self.terminated:
            return False
        if self.flight.armed:
            return self.t_s - self._failsafe_at_s > _PREARM_BIT_OFF_S
        return self._can_arm()

    def _hears_texts(self) -> bool:
        return self.t_s - self.gcs_heard_s <= _GCS_SILENT_AFTER_S

    # What it says of itself.

    def message(self, message_id: int) -> Any | None:
        """Return a message that depends on modes and readiness."""
        make = self._makers.get(message_id)
        return make() if make is not None else None

    def _makers_by_id(self) -> dict[int, Callable[[], Any]]:
        flight, state = self.flight, self.state
        return {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: lambda: px4_telemetry.sys_status(
                state, prearm=self._prearm_bit()
            ),
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: lambda: (
                mavlink.MAVLink_extended_sys_state_message(
                    mavlink.MAV_VTOL_STATE_UNDEFINED, self._landed_state()
                )
            ),
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: lambda: px4_telemetry.estimator_status(
                state,
                armed=flight.armed,
                landed_after_flight=flight.landed
                and flight.landed_at_s is not None
                and self.t_s - flight.landed_at_s > _TERRAIN_LOST_S,
            ),
            mavlink.MAVLINK_MSG_ID_VFR_HUD: lambda: px4_telemetry.vfr_hud(state, flight.throttle),
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda: px4_telemetry.autopilot_version(
                self.identity
            ),
        }

    def _heartbeat(self) -> Any:
        base_mode = self.mode.base_mode
        if self.terminated:
            status = mavlink.MAV_STATE_FLIGHT_TERMINATION
        elif self.flight.armed:
            status = mavlink.MAV_STATE_CRITICAL if self.failsafe else mavlink.MAV_STATE_ACTIVE
        else:
            status = mavlink.MAV_STATE_STANDBY if self._can_arm() else mavlink.MAV_STATE_UNINIT
        if self.flight.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_PX4,
            base_mode,
            self.mode.custom_mode,
            status,
            3,
        )

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
        """Change to a mode that the user wants, if it can run."""
        wanted = px4_mode(mode, submode)
        return self.choose(wanted) if wanted is not None else DENIED

    def choose(self, mode: Px4Mode) -> int:
        """Switch to the user's mode; while armed only if it can run. Ends a failsafe."""
        if self.flight.armed and not self._can_run(mode):
            self.outbox.say(
                CRITICAL, f"Switching to mode '{mode.words}' is currently not possible\t"
            )
            return TEMPORARILY_REJECTED
        self.failsafe = False
        if not mode.prevents_arming:
            self._mode_after_disarm = mode
        self.enter(mode)
        return ACCEPTED

    def _can_run(self, mode: Px4Mode) -> bool:
        if mode.is_manual or self.terminated:
            return False
        if mode is Px4Mode.OFFBOARD:
            return self.setpoints_stream
        if mode is Px4Mode.MISSION:
            return self.state.mission_total > 0
        return self.position_valid

    def enter(self, mode: Px4Mode) -> None:
        """Fly a mode from now on."""
        self.mode = mode
        if self.flight.armed:
            self.flight.fly(self._behaviour(mode))

    def fail(self, mode: Px4Mode) -> None:
        """Begin a failsafe: fly this mode until the user chooses another."""
        self.failsafe = True
        self._failsafe_at_s = self.t_s
        self.outbox.say(CRITICAL, "Failsafe activated\t")
        self.enter(mode)

    def _behaviour(self, mode: Px4Mode) -> Behaviour:
        p, state = self.parameters, self.state
        if mode is Px4Mode.OFFBOARD:
            return self.follow
        if mode is Px4Mode.LAND:
            return px4_flying.land(p, state)
        if mode is Px4Mode.RTL:
            height_m = px4_flying.return_height_m(p, state)
            amsl_m = state.frame.altitude_m - state.home_down_m + height_m
            self.outbox.say(
                INFO,
                f"RTL: start return at {amsl_m:.0f} m ({height_m:.0f} m above destination)\t",
            )
            return px4_flying.return_home(p, state, height_m)
        return Hold(speeds=px4_flying.speeds(p), yaw_rad=state.now.euler_rad[2])

    # Arming.

    def _is_forced(self, command: Command) -> bool:
        return command.params[1] == FORCE_DISARM

    def arm(self, *, force: bool) -> int:
        """Arm if the checks pass, by force in any case."""
        if self.flight.armed:
            return ACCEPTED
        if self.refusal is not None or not (self._can_arm() or force):
            reason = self.refusal or "Resolve system health failures first"
            self.outbox.say(CRITICAL, f"Arming denied: {reason}\t")
            return TEMPORARILY_REJECTED
        self.flight.arm(self.t_s)
        self.state.home_ned_m = self.state.now.position_ned_m
        self.failsafe = False
        self.outbox.say(INFO, "Armed by external command\t")
        self.enter(self.mode)
        return ACCEPTED

    def disarm(self, *, force: bool) -> int:
        """Disarm on the ground, in the air only by force."""
        if not self.flight.armed:
            return ACCEPTED
        if not (self.flight.landed or force):
            self.outbox.say(CRITICAL, "Disarming denied: not landed\t")
            return TEMPORARILY_REJECTED
        self.stop_motors("external command")
        return ACCEPTED

    def stop_motors(self, by: str) -> None:
        """Disarm now; the mode becomes the last one of the user's in which it can be armed."""
        self.flight.disarm()
        self.failsafe = False
        self.mode = self._mode_after_disarm
        self.outbox.say(INFO, f"Disarmed by {by}\t")

    def terminate(self, text: str) -> None:
        """Cut the motors for good."""
        self.terminated = self.flight.motors_cut = True
        self.outbox.say(EMERGENCY, f"{text}\t")

    def strike(self, thing: str) -> None:
        """Terminate: PX4's failure detector sees the attitude leave its limits."""
        if self.flight.armed and not self.terminated:
            self.terminate(f"Critical failure detected: terminate flight ({thing})")
