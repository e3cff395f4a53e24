"""An autopilot that behaves to the outside as PX4 1.18 in SITL (SIH quadrotor) does."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.airframe import Airframe
from vehicles.embedded.autopilot import px4_telemetry, telemetry
from vehicles.embedded.autopilot.base import GCS_SILENT_AFTER_S, EmbeddedAutopilot
from vehicles.embedded.autopilot.commands import (
    ACCEPTED,
    DENIED,
    FORCE_DISARM,
    TEMPORARILY_REJECTED,
    UNSUPPORTED,
    Command,
    on_command,
    on_message,
)
from vehicles.embedded.autopilot.flight import FlightStyle
from vehicles.embedded.autopilot.guidance import (
    Behaviour,
    Follow,
    GoTo,
    Hold,
    Land,
    LandProfile,
    ReturnHome,
    Speeds,
    TakeOff,
)
from vehicles.embedded.autopilot.parameters import load_parameters
from vehicles.embedded.autopilot.px4_modes import Px4Mode, px4_mode
from vehicles.embedded.autopilot.setpoints import RELATIVE_ALTITUDE_FRAMES, Wanted
from vehicles.embedded.autopilot.setpoints import global_setpoint, local_setpoint
from vehicles.embedded.autopilot.state import Identity
from vehicles.embedded.battery import Charge
from vehicles.embedded.controller import Gains
from worlds.frames import Vec3, quat_from_euler, rotate

CRITICAL: int = mavlink.MAV_SEVERITY_CRITICAL
INFO: int = mavlink.MAV_SEVERITY_INFO
_FILE = Path(__file__).with_name("px4_parameters.yaml")

# Seconds since boot, from the reference trace.
HEADING_S = 3.2
POSITION_S = 3.2
CHECKS_PASS_S = 4.9
PREARM_BIT_S = 6.3
_HEADING_TEXT_S = 2.55


class Px4(EmbeddedAutopilot):
    """PX4: modes, readiness, failsafes, takeoff and landing."""

    index_on_set: ClassVar[bool] = True
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
        self._mode_after_disarm = Px4Mode.HOLD
        self._takeoff_down_m: float | None = None
        self._setpoint_at_s = -math.inf
        self._failsafe_at_s = -math.inf
        self._heading_text_said = False
        self._takeoff_said = False
        self._landing_said = True
        self._follow = Follow(speeds=self._speeds(), yaw_rad=0.0, may_lift=True)
        self._land_mode_began = False

    # Readiness.

    @property
    def position_valid(self) -> bool:
        """Return whether the estimator has a position."""
        return self.t_s >= POSITION_S

    @property
    def can_arm(self) -> bool:
        """Return whether the checks pass in the present mode."""
        if self.never_ready or self.t_s < CHECKS_PASS_S or self.terminated:
            return False
        if self.mode is Px4Mode.OFFBOARD and not self.setpoints_stream:
            return False
        return not (self.mode.prevents_arming or self.mode.is_manual)

    @property
    def prearm_bit(self) -> bool:
        """Return the PREARM_CHECK bit of SYS_STATUS: later than the checks, and off in a fall."""
        if self.never_ready or self.t_s < PREARM_BIT_S or self.terminated:
            return False
        if self.flight.armed:
            return self.t_s - self._failsafe_at_s > 0.18
        return self.can_arm

    @property
    def setpoints_stream(self) -> bool:
        """Return whether offboard setpoints are fresh."""
        return self.t_s - self._setpoint_at_s <= self.parameters["COM_OF_LOSS_T"]

    def hears_texts(self) -> bool:
        """Return whether a ground station is there: PX4 talks to nobody else."""
        return self.gcs_silent_s <= GCS_SILENT_AFTER_S

    def _next_text_id(self, chunks: int) -> int:
        number = self._text_id
        self._text_id = (number + 1) % 65536
        return number

    # Messages.

    def heartbeat(self) -> Any:
        """Return the HEARTBEAT of now."""
        base_mode = self.mode.base_mode
        if self.terminated:
            status = mavlink.MAV_STATE_FLIGHT_TERMINATION
        elif self.flight.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            status = mavlink.MAV_STATE_CRITICAL if self.failsafe else mavlink.MAV_STATE_ACTIVE
        else:
            status = mavlink.MAV_STATE_STANDBY if self.can_arm else mavlink.MAV_STATE_UNINIT
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            mavlink.MAV_AUTOPILOT_PX4,
            base_mode,
            self.mode.custom_mode,
            status,
            3,
        )

    def autopilot_version(self) -> Any:
        """Return AUTOPILOT_VERSION."""
        return px4_telemetry.autopilot_version(self.identity)

    def own_message(self, message_id: int) -> Any | None:
        """Return a message that depends on modes and readiness."""
        if message_id == mavlink.MAVLINK_MSG_ID_SYS_STATUS:
            return px4_telemetry.sys_status(self.state, t_s=self.t_s, prearm=self.prearm_bit)
        if message_id == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            return mavlink.MAVLink_extended_sys_state_message(0, self.landed_state)
        if message_id == mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS:
            landed_after_flight = self.flight.landed and self.flight.landed_at_s is not None
            return px4_telemetry.estimator_status(
                self.state, armed=self.flight.armed, landed_after_flight=landed_after_flight
            )
        if message_id == mavlink.MAVLINK_MSG_ID_VFR_HUD:
            return px4_telemetry.vfr_hud(self.state, self.flight.throttle)
        return super().own_message(message_id)

    @property
    def landed_state(self) -> int:
        """Return MAV_LANDED_STATE."""
        flight = self.flight
        if not flight.armed or (flight.landed and not flight.lifting):
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self.mode is Px4Mode.TAKEOFF:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        if self.mode is Px4Mode.LAND:
            return int(mavlink.MAV_LANDED_STATE_LANDING)
        return int(mavlink.MAV_LANDED_STATE_IN_AIR)

    def split_mode(self, custom_mode: int) -> tuple[int, int]:
        """Return (main, sub) of a custom_mode."""
        return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF

    @on_message("SET_POSITION_TARGET_LOCAL_NED")
    def _on_local_setpoint(self, message: Any) -> None:
        frame, now = message.coordinate_frame, self.state.now
        if frame == mavlink.MAV_FRAME_BODY_NED:
            # PX4 turns body velocities with the whole attitude, and takes no body positions.
            body: Vec3 = (message.vx, message.vy, message.vz)
            message.vx, message.vy, message.vz = rotate(quat_from_euler(*now.euler_rad), body)
            message.type_mask |= 0b111
        elif frame != mavlink.MAV_FRAME_LOCAL_NED:
            self.text(
                CRITICAL, f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported\t"
            )
            return
        message.coordinate_frame = mavlink.MAV_FRAME_LOCAL_NED
        self._take_setpoint(local_setpoint(message, now))

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if self.position_valid:
            state = self.state
            self._take_setpoint(global_setpoint(message, state.place, state.home_down_m))

    def _take_setpoint(self, wanted: Wanted | None) -> None:
        if wanted is None:
            return
        self._setpoint_at_s = self.t_s
        self._follow.set(
            position_ned_m=wanted.position_ned_m,
            velocity_ned_m_s=wanted.velocity_ned_m_s,
            yaw_rad=wanted.yaw_rad
            if wanted.yaw_rad is not None or wanted.yaw_rate_rad_s
            else self.flight.controller.yaw_setpoint_rad,
            yaw_rate_rad_s=wanted.yaw_rate_rad_s,
        )

    # Commands.

    def is_forced(self, command: Command) -> bool:
        """Return whether param2 is PX4's magic, for arming and disarming alike."""
        return command.params[1] == FORCE_DISARM

    def set_mode(self, base_mode: int, mode: int, submode: int) -> int:
        """Change to a mode that the user wants, if it can run."""
        if not base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        wanted = px4_mode(mode, submode)
        return self.choose(wanted) if wanted is not None else DENIED

    def choose(self, mode: Px4Mode) -> int:
        """Switch to the user's mode; while armed only if it can run. Ends a failsafe."""
        if self.flight.armed and not self._can_run(mode):
            self.text(CRITICAL, f"Switching to mode '{mode.words}' is currently not possible\t")
            return TEMPORARILY_REJECTED
        self.failsafe = False
        if not mode.prevents_arming:
            self._mode_after_disarm = mode
        self.enter(mode)
        return ACCEPTED

    def _can_run(self, mode: Px4Mode) -> bool:
        if mode.is_manual:
            return False
        if mode is Px4Mode.OFFBOARD:
            return self.setpoints_stream
        if mode is Px4Mode.MISSION:
            return self.state.mission_total > 0
        return self.position_valid

    def arm(self, *, force: bool) -> int:
        """Arm if the checks pass, by force in any case."""
        if self.flight.armed:
            return ACCEPTED
        if self.refusal is not None:
            self.text(CRITICAL, f"Arming denied: {self.refusal}\t")
            return TEMPORARILY_REJECTED
        if not (self.can_arm or force):
            self.text(CRITICAL, "Arming denied: Resolve system health failures first\t")
            return TEMPORARILY_REJECTED
        self.flight.arm(self.t_s)
        self.state.home_ned_m = self.state.now.position_ned_m
        self.failsafe = False
        self._takeoff_said = False
        self._landing_said = True
        self.text(INFO, "Armed by external command\t")
        self.enter(self.mode)
        return ACCEPTED

    def disarm(self, *, force: bool) -> int:
        """Disarm on the ground, in the air only by force."""
        if not self.flight.armed:
            return ACCEPTED
        if not (self.flight.landed or force):
            self.text(CRITICAL, "Disarming denied: not landed\t")
            return TEMPORARILY_REJECTED
        self._disarm("external command")
        return ACCEPTED

    def _disarm(self, by: str) -> None:
        self.flight.disarm()
        self.failsafe = False
        self.mode = self._mode_after_disarm
        self.text(INFO, f"Disarmed by {by}\t")

    @on_command(mavlink.MAV_CMD_NAV_TAKEOFF)
    def _take_off(self, command: Command) -> int:
        origin_m = self.state.place.origin.altitude_m
        self._takeoff_down_m = origin_m - command.z if math.isfinite(command.z) else None
        return self.choose(Px4Mode.TAKEOFF)

    @on_command(mavlink.MAV_CMD_NAV_LAND)
    def _land(self, _: Command) -> int:
        return self.choose(Px4Mode.LAND)

    @on_command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    def _return(self, _: Command) -> int:
        return self.choose(Px4Mode.RTL)

    @on_command(mavlink.MAV_CMD_DO_REPOSITION)
    def _reposition(self, command: Command) -> int:
        if not self.position_valid:
            return DENIED
        here, state = self.state.now, self.state
        altitude_m = command.z
        if command.frame in RELATIVE_ALTITUDE_FRAMES:
            altitude_m += state.place.origin.altitude_m - state.home_down_m
        position = state.place.local(command.x, command.y, altitude_m)
        north, east, down = (
            value if math.isfinite(value) else present
            for value, present in zip(position, here.position_ned_m, strict=True)
        )
        yaw = command.params[3]
        if (result := self.choose(Px4Mode.HOLD)) == ACCEPTED and not self.flight.landed:
            speed = command.params[0]
            speeds = self._speeds() if not speed > 0.0 else self._speeds()._replace(across=speed)
            self.flight.fly(
                GoTo(
                    position_ned_m=(north, east, down),
                    yaw_rad=yaw if math.isfinite(yaw) else here.euler_rad[2],
                    speeds=speeds,
                    radius_m=0.3,
                )
            )
        return result

    @on_command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION)
    def _terminate(self, command: Command) -> int:
        if command.params[0] > 0.5 and self.flight.armed:
            self._cut("Flight termination by command")
            return ACCEPTED
        return UNSUPPORTED

    # Flying.

    def enter(self, mode: Px4Mode) -> None:
        """Fly a mode from now on."""
        self.mode = mode
        if self.flight.armed:
            self.flight.fly(self._behaviour(mode))

    def _behaviour(self, mode: Px4Mode) -> Behaviour:
        now = self.state.now
        speeds, yaw = self._speeds(), now.euler_rad[2]
        if mode is Px4Mode.OFFBOARD:
            return self._follow
        if mode is Px4Mode.TAKEOFF:
            return self._takeoff_behaviour()
        if mode is Px4Mode.LAND:
            return self._landing()
        if mode is Px4Mode.RTL:
            return self._returning()
        return Hold(speeds=speeds, yaw_rad=yaw)

    def _takeoff_behaviour(self) -> Behaviour:
        now = self.state.now
        down = self._takeoff_down_m
        if down is None:
            height_m = self.parameters["MIS_TAKEOFF_ALT"]
            down = self.state.home_down_m - height_m
            self.text(INFO, f"Using default takeoff altitude: {height_m:.1f} m\t")
        self._takeoff_down_m = None
        return TakeOff(
            down_m=min(down, now.position_ned_m[2]),
            climb_m_s=self.parameters["MPC_TKO_SPEED"],
            ramp_s=self.parameters["MPC_TKO_RAMP_T"],
            radius_m=self.parameters["NAV_MC_ALT_RAD"],
            speeds=self._speeds(),
        )

    def _landing(self) -> Land:
        p = self.parameters
        crawl_m = p["MPC_LAND_ALT3"]
        profile = LandProfile(
            (
                (p["MPC_LAND_ALT1"], p["MPC_Z_V_AUTO_DN"]),
                (p["MPC_LAND_ALT2"], p["MPC_LAND_SPEED"]),
                (crawl_m, p["MPC_LAND_SPEED"]),
                (crawl_m, p["MPC_LAND_CRWL"]),
            )
        )
        return Land(profile=profile, speeds=self._speeds(), ground_down_m=self.state.home_down_m)

    def _returning(self) -> ReturnHome:
        """Return the flight home at PX4's return altitude, a cone near home (rtl_direct.cpp)."""
        p, here = self.parameters, self.state.now.position_ned_m
        home = self.state.home_ned_m or (0.0, 0.0, 0.0)
        distance_m = math.hypot(here[0] - home[0], here[1] - home[1])
        near_m = p["NAV_ACC_RAD"]
        height_m = 2.0 * distance_m if distance_m <= near_m else p["RTL_RETURN_ALT"]
        height_m = max(height_m, home[2] - here[2])
        amsl_m = self.state.place.origin.altitude_m - home[2] + height_m
        self.text(
            INFO,
            f"RTL: start return at {amsl_m:.0f} m ({height_m:.0f} m above destination)\t",
        )
        return ReturnHome(
            home_ned_m=home,
            return_down_m=home[2] - height_m,
            speeds=self._speeds(),
            wait_s=max(0.0, p["RTL_LAND_DELAY"]),
            land=self._landing(),
        )

    def _speeds(self) -> Speeds:
        p = self.parameters
        return Speeds(p["MPC_XY_CRUISE"], p["MPC_Z_V_AUTO_UP"], p["MPC_Z_V_AUTO_DN"])

    # Supervision.

    def supervise(self) -> None:
        """Check modes and failsafes."""
        t_s, flight = self.t_s, self.flight
        if self.state.home_ned_m is None and self.position_valid:
            self.state.home_ned_m = self.state.now.position_ned_m
        if not self._heading_text_said and t_s >= _HEADING_TEXT_S:
            self._heading_text_said = True
            self.text(CRITICAL, "Preflight Fail: no heading reference\t")
        if not flight.armed:
            return
        self._say_phases()
        if self.terminated:
            return
        behaviour = flight.behaviour
        if self.mode is Px4Mode.TAKEOFF and isinstance(behaviour, TakeOff) and behaviour.done:
            self.choose(Px4Mode.HOLD)
            flight.fly(
                Hold(
                    speeds=self._speeds(),
                    yaw_rad=behaviour.yaw_rad,
                    position_ned_m=behaviour.goal_ned_m,
                )
            )
        if self.mode is Px4Mode.OFFBOARD and not self.setpoints_stream:
            self._fall_back()
        self._disarm_when_due()

    def _say_phases(self) -> None:
        flight = self.flight
        if flight.lifting and not self._takeoff_said:
            self._takeoff_said, self._landing_said = True, False
            self.text(INFO, "Takeoff detected\t")
        if flight.landed and not flight.lifting and not self._landing_said:
            self._landing_said, self._takeoff_said = True, False
            self.text(INFO, "Landing detected\t")

    def _fall_back(self) -> None:
        """Act on lost setpoints as COM_OBL_RC_ACT says; without sticks, manual modes mean return."""
        action = int(self.parameters["COM_OBL_RC_ACT"])
        if action == 7:
            self._disarm("failsafe")
            return
        mode = {4: Px4Mode.LAND, 5: Px4Mode.HOLD}.get(action, Px4Mode.RTL)
        self.fail(mode)

    def fail(self, mode: Px4Mode) -> None:
        """Begin a failsafe: fly this mode until the user chooses another."""
        self.failsafe = True
        self._failsafe_at_s = self.t_s
        self.text(CRITICAL, "Failsafe activated\t")
        self.enter(mode)

    def _disarm_when_due(self) -> None:
        flight, t_s, p = self.flight, self.t_s, self.parameters
        if not flight.landed or flight.lifting:
            return
        if flight.landed_at_s is not None:
            if 0.0 < p["COM_DISARM_LAND"] <= t_s - flight.landed_at_s:
                self._disarm("landing")
        elif 0.0 < p["COM_DISARM_PRFLT"] <= t_s - flight.armed_at_s:
            self._disarm("auto preflight disarming")

    def strike(self, thing: str) -> None:
        """Terminate: PX4's failure detector sees the attitude leave its limits."""
        self._cut(f"Critical failure detected: terminate flight ({thing})")

    def _cut(self, text: str) -> None:
        self.terminated = self.flight.motors_cut = True
        self.text(int(mavlink.MAV_SEVERITY_EMERGENCY), f"{text}\t")
