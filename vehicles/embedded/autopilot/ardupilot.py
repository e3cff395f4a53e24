"""An autopilot that behaves to the outside as ArduCopter 4.7 in SITL does."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.airframe import Airframe
from vehicles.embedded.autopilot import ardupilot_boot as boot
from vehicles.embedded.autopilot import ardupilot_telemetry, telemetry
from vehicles.embedded.autopilot.ardupilot_modes import CopterMode, copter_mode
from vehicles.embedded.autopilot.base import EmbeddedAutopilot
from vehicles.embedded.autopilot.commands import (
    ACCEPTED,
    DENIED,
    FAILED,
    FORCE_ARM,
    FORCE_DISARM,
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
from vehicles.embedded.autopilot.setpoints import (
    RELATIVE_ALTITUDE_FRAMES,
    Wanted,
    global_setpoint,
    local_setpoint,
)
from vehicles.embedded.autopilot.state import Identity
from vehicles.embedded.battery import Charge
from vehicles.embedded.controller import Gains

CRITICAL: int = mavlink.MAV_SEVERITY_CRITICAL
WARNING: int = mavlink.MAV_SEVERITY_WARNING
INFO: int = mavlink.MAV_SEVERITY_INFO
_FILE = Path(__file__).with_name("ardupilot_parameters.yaml")
_IN_FLIGHT_YAW_HEIGHT_M = 2.5
"""EKF3 aligns its yaw in flight above this height (EKF3_MAG_FINAL_RESET_ALT)."""


class ArduCopter(EmbeddedAutopilot):
    """ArduCopter: modes, readiness, failsafes, takeoff and landing."""

    index_on_set: ClassVar[bool] = False
    builders: ClassVar[dict[int, telemetry.Builder]] = (
        telemetry.COMMON | ardupilot_telemetry.BUILDERS
    )
    style: ClassVar[FlightStyle] = FlightStyle(
        # PSC_NE_POS_P, PSC_D_POS_P; PSC_NE_VEL_P, PSC_D_VEL_P; PSC_NE_VEL_I; WP_ACC, WP_ACC_Z;
        # ATC_ANG_RLL_P, ATC_ANG_YAW_P; ATC_ANGLE_MAX
        gains=Gains(
            position=(1.0, 1.0),
            velocity=(2.0, 5.0),
            integral=(1.0, 2.0),
            acceleration_m_s2=(2.5, 1.0),
            attitude=(4.5, 4.5),
            max_tilt_rad=math.radians(30.0),
        ),
        spool_s=2.0,
        lift_s=1.15,
        noticed_s=1.15,
        touch_s=1.65,
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
            rates_hz=ardupilot_telemetry.RATES_HZ,
        )
        self.mode = CopterMode.STABILIZE
        self.failsafe = False
        self._said = 0
        self._setpoint_at_s: float | None = None
        self._taking_off = False
        self._yaw_aligned = False
        self._was_landed = True
        self._follow = self._new_follow()

    # Readiness.

    @property
    def position_valid(self) -> bool:
        """Return whether EKF3 uses GPS."""
        return self.t_s >= boot.POSITION_S and not self.never_ready

    @property
    def prearm_bit(self) -> bool:
        """Return the PREARM_CHECK bit: true long before GUIDED can be had."""
        return self.t_s >= boot.PREARM_BIT_S and not self.never_ready

    # Messages.

    def heartbeat(self) -> Any:
        """Return the HEARTBEAT of now."""
        flight, booting = self.flight, self.t_s < boot.INITIALISED_S
        base_mode = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        # The flag shows that the horizontal position controller runs; at boot it seems to.
        if booting or (self.mode.needs_position or self.mode is CopterMode.LAND):
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

    def autopilot_version(self) -> Any:
        """Return AUTOPILOT_VERSION."""
        return ardupilot_telemetry.autopilot_version(self.identity)

    def own_message(self, message_id: int) -> Any | None:
        """Return a message that depends on modes and readiness."""
        if message_id == mavlink.MAVLINK_MSG_ID_SYS_STATUS:
            return ardupilot_telemetry.sys_status(self.state, prearm=self.prearm_bit)
        if message_id == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            return mavlink.MAVLink_extended_sys_state_message(3, self.landed_state)
        if message_id == mavlink.MAVLINK_MSG_ID_VFR_HUD:
            return ardupilot_telemetry.vfr_hud(self.state, self.flight.throttle)
        return super().own_message(message_id)

    @property
    def landed_state(self) -> int:
        """Return MAV_LANDED_STATE."""
        if self.flight.landed:
            return int(mavlink.MAV_LANDED_STATE_ON_GROUND)
        if self._taking_off:
            return int(mavlink.MAV_LANDED_STATE_TAKEOFF)
        behaviour = self.flight.behaviour
        if self.mode is CopterMode.LAND or (
            isinstance(behaviour, ReturnHome) and behaviour.landing
        ):
            return int(mavlink.MAV_LANDED_STATE_LANDING)
        return int(mavlink.MAV_LANDED_STATE_IN_AIR)

    @on_message("REQUEST_DATA_STREAM")
    def _on_data_stream(self, message: Any) -> None:
        rate_hz = float(message.req_message_rate) if message.start_stop else 0.0
        groups = ardupilot_telemetry.STREAMS
        if message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL:
            ids = [message_id for group in groups.values() for message_id in group]
        else:
            ids = list(groups.get(message.req_stream_id, ()))
        for message_id in ids:
            self.streams.set_rate(message_id, rate_hz, now_s=self.t_s)

    @on_message("SET_POSITION_TARGET_LOCAL_NED")
    def _on_local_setpoint(self, message: Any) -> None:
        if self.mode is CopterMode.GUIDED:
            self._take_setpoint(local_setpoint(message, self.state.now))

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if self.mode is CopterMode.GUIDED:
            state = self.state
            self._take_setpoint(global_setpoint(message, state.place, state.home_down_m))

    def _take_setpoint(self, wanted: Wanted | None) -> None:
        flight = self.flight
        if wanted is None or not flight.armed or flight.landed or self._taking_off:
            return
        self._setpoint_at_s = self.t_s if wanted.has_velocity else None
        self._follow.set(
            position_ned_m=wanted.position_ned_m,
            velocity_ned_m_s=wanted.velocity_ned_m_s,
            yaw_rad=wanted.yaw_rad
            if wanted.yaw_rad is not None or wanted.yaw_rate_rad_s
            else flight.controller.yaw_setpoint_rad,
            yaw_rate_rad_s=wanted.yaw_rate_rad_s,
        )
        if flight.behaviour is not self._follow:
            flight.fly(self._follow)

    # Commands.

    def is_forced(self, command: Command) -> bool:
        """Return whether param2 is ArduPilot's magic: one for arming, another for disarming."""
        return command.params[1] == (FORCE_ARM if command.params[0] == 1.0 else FORCE_DISARM)

    def set_mode(self, base_mode: int, mode: int, submode: int) -> int:
        """Change to a mode that the user wants, if it can run."""
        if not base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return DENIED
        wanted = copter_mode(mode)
        return self.choose(wanted) if wanted is not None else FAILED

    def choose(self, mode: CopterMode) -> int:
        """Switch to the user's mode if it can run."""
        if mode.needs_position and not self.position_valid:
            self.text(WARNING, f"Mode change to {mode.words} failed: requires position")
            return FAILED
        self.failsafe = False
        self.enter(mode)
        return ACCEPTED

    def arm(self, *, force: bool) -> int:
        """Arm if the checks pass; by force they are skipped."""
        if self.flight.armed:
            return ACCEPTED
        reason = self._arming_fault()
        if reason is not None and not (force and self.refusal is None):
            self.text(CRITICAL, f"Arm: {reason}")
            return FAILED
        self.flight.arm(self.t_s)
        self._setpoint_at_s = None
        if self.t_s >= boot.HOME_SET_S:
            self.state.home_ned_m = self.state.now.position_ned_m
            self.send(telemetry.gps_global_origin(self.state))
            self.send(telemetry.home_position(self.state))
        self.text(INFO, "Arming motors")
        self.enter(self.mode)
        return ACCEPTED

    def _arming_fault(self) -> str | None:
        if self.refusal is not None:
            return self.refusal
        if self.t_s < boot.INITIALISED_S:
            return "System not initialised"
        if not self.prearm_bit:
            return "Need Position Estimate"
        if not self.mode.allows_arming:
            return f"{self.mode.words} mode not armable"
        if self.mode.needs_position and not self.position_valid:
            return "Need Position Estimate"
        return None

    def disarm(self, *, force: bool) -> int:
        """Disarm on the ground, in the air only by force."""
        if not self.flight.armed:
            return ACCEPTED
        if not (self.flight.landed or force):
            return FAILED
        self._disarm()
        return ACCEPTED

    def _disarm(self) -> None:
        self.flight.disarm()
        self._taking_off = False
        self.text(INFO, "Disarming motors")

    @on_command(mavlink.MAV_CMD_NAV_TAKEOFF)
    def _take_off(self, command: Command) -> int:
        flight = self.flight
        if self.mode is not CopterMode.GUIDED or not flight.armed or not flight.landed:
            return FAILED
        if not command.z > 0.0:
            return FAILED
        self._taking_off = True
        flight.fly(
            TakeOff(
                down_m=self.state.home_down_m - command.z,
                climb_m_s=self._speeds().up,
                ramp_s=0.0,
                radius_m=0.1,
                speeds=self._speeds(),
            )
        )
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_NAV_LAND)
    def _land(self, _: Command) -> int:
        return self.choose(CopterMode.LAND)

    @on_command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    def _return(self, _: Command) -> int:
        return self.choose(CopterMode.RTL)

    @on_command(mavlink.MAV_CMD_DO_REPOSITION)
    def _reposition(self, command: Command) -> int:
        change_mode = int(command.params[1]) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if self.mode is not CopterMode.GUIDED and not change_mode:
            return DENIED
        if not (math.isfinite(command.x) and math.isfinite(command.y)):
            return DENIED
        if self.mode is not CopterMode.GUIDED and self.choose(CopterMode.GUIDED) != ACCEPTED:
            return FAILED
        state = self.state
        altitude_m = command.z
        if command.frame in RELATIVE_ALTITUDE_FRAMES:
            altitude_m += state.place.origin.altitude_m - state.home_down_m
        if not self.flight.landed:
            self._setpoint_at_s = None
            self.flight.fly(
                GoTo(
                    position_ned_m=state.place.local(command.x, command.y, altitude_m),
                    yaw_rad=state.now.euler_rad[2],
                    speeds=self._speeds(),
                    radius_m=0.3,
                )
            )
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION)
    def _terminate(self, command: Command) -> int:
        if command.params[0] > 0.5:
            self._disarm()
            return ACCEPTED
        return FAILED

    # Flying.

    def enter(self, mode: CopterMode) -> None:
        """Fly a mode from now on."""
        if mode is not self.mode:
            self._taking_off = False
        self.mode = mode
        self._setpoint_at_s = None
        if self.flight.armed:
            self.flight.fly(self._behaviour(mode))

    def _behaviour(self, mode: CopterMode) -> Behaviour:
        if mode is CopterMode.GUIDED:
            self._follow = self._new_follow()
            self._follow.stand(self.state.now)
            return self._follow
        if mode is CopterMode.LAND:
            return self._landing()
        if mode in {CopterMode.RTL, CopterMode.SMART_RTL}:
            return self._returning()
        return Hold(speeds=self._speeds(), yaw_rad=self.state.now.euler_rad[2])

    def _new_follow(self) -> Follow:
        return Follow(speeds=self._speeds(), yaw_rad=0.0, may_lift=False)

    def _landing(self) -> Land:
        p = self.parameters
        fast = p["LAND_SPD_HIGH_MS"] or p["WP_SPD_DN"]
        low_m = p["LAND_ALT_LOW_M"]
        return Land(
            profile=LandProfile(((low_m + 0.01, fast), (low_m, p["LAND_SPD_MS"]))),
            speeds=self._speeds(),
            ground_down_m=self.state.home_down_m,
        )

    def _returning(self) -> ReturnHome:
        """Return the flight home at ArduCopter's return altitude (mode_rtl.cpp)."""
        p, here = self.parameters, self.state.now.position_ned_m
        home = self.state.home_ned_m or (0.0, 0.0, 0.0)
        height_m = home[2] - here[2]
        target_m = max(height_m + max(0.0, p["RTL_CLIMB_MIN_M"]), p["RTL_ALT_M"])
        slope = p["RTL_CONE_SLOPE"]
        if slope >= 0.5:
            distance_m = math.hypot(here[0] - home[0], here[1] - home[1])
            cone_m = max(distance_m * slope, height_m + 2.5)
            target_m = max(height_m, min(target_m, cone_m))
        return ReturnHome(
            home_ned_m=home,
            return_down_m=home[2] - target_m,
            speeds=self._speeds(),
            wait_s=p["RTL_LOIT_TIME"] / 1e3,
            land=self._landing(),
        )

    def _speeds(self) -> Speeds:
        p = self.parameters
        return Speeds(p["WP_SPD"], p["WP_SPD_UP"], p["WP_SPD_DN"])

    # Supervision.

    def supervise(self) -> None:
        """Say what is due, check modes and failsafes."""
        self._boot()
        flight, t_s = self.flight, self.t_s
        self._say_phases()
        if not flight.armed:
            return
        behaviour = flight.behaviour
        if self._taking_off and behaviour is not None and behaviour.done:
            self._taking_off = False
        lost = self._setpoint_at_s is not None and (
            t_s - self._setpoint_at_s > self.parameters["GUID_TIMEOUT"]
        )
        if lost:
            self._setpoint_at_s = None
            self._follow.stand(self.state.now)
        self._disarm_when_due()

    def _boot(self) -> None:
        t_s = self.t_s
        while self._said < len(boot.TEXTS) and boot.TEXTS[self._said][0] <= t_s:
            text = boot.TEXTS[self._said][1]
            if self.never_ready and t_s >= boot.POSITION_S - 1.0:
                return
            self.text(INFO, text.format(field_m=self.state.place.origin.altitude_m))
            self._said += 1
        if self.state.home_ned_m is None and t_s >= boot.HOME_SET_S:
            self.state.home_ned_m = self.state.now.position_ned_m
            self.send(telemetry.gps_global_origin(self.state))
            self.send(telemetry.home_position(self.state))

    def _say_phases(self) -> None:
        flight, now = self.flight, self.state.now
        height_m = self.state.home_down_m - now.position_ned_m[2]
        if not self._yaw_aligned and not flight.landed and height_m > _IN_FLIGHT_YAW_HEIGHT_M:
            self._yaw_aligned = True
            for imu in (0, 1):
                self.text(INFO, f"EKF3 IMU{imu} MAG0 in-flight yaw alignment complete")
        touched = self.state.touching and not flight.landed
        if touched and not self._was_landed:
            self.text(INFO, f"SIM Hit ground at {max(0.0, now.velocity_ned_m_s[2]):f} m/s")
        if touched or flight.landed:
            self._was_landed = True
        elif not self.state.touching and height_m > 0.3:
            self._was_landed = False

    def _disarm_when_due(self) -> None:
        flight, t_s = self.flight, self.t_s
        if not flight.landed or flight.lifting:
            return
        if flight.landed_at_s is not None and (
            self.mode is CopterMode.LAND or isinstance(flight.behaviour, ReturnHome)
        ):
            if t_s - flight.landed_at_s >= 0.4:
                self._disarm()
            return
        idle_since_s = flight.landed_at_s if flight.landed_at_s is not None else flight.armed_at_s
        if 0.0 < self.parameters["DISARM_DELAY"] <= t_s - idle_since_s and not self._taking_off:
            self._disarm()

    def strike(self, thing: str) -> None:
        """Disarm: ArduCopter's crash check sees the attitude leave what was asked."""
        if self.flight.armed:
            self.text(int(mavlink.MAV_SEVERITY_EMERGENCY), f"Crash: Disarming ({thing})")
            self._disarm()
