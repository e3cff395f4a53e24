"""The emulated ArduCopter, which behaves over MAVLink as ArduCopter 4.7 in SITL does."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.copter import copter_boot as boot
from wil_campaign.plugins.ardupilot.copter import copter_telemetry
from wil_campaign.plugins.ardupilot.copter.avoidance import NO_DATA
from wil_campaign.plugins.ardupilot.copter.copter_core import FLOOR, CopterCore
from wil_campaign.plugins.ardupilot.copter.copter_failsafes import (
    CopterFailsafeInputs,
    CopterFailsafes,
)
from wil_campaign.plugins.ardupilot.copter.copter_guided import CopterGuided
from wil_campaign.plugins.ardupilot.copter.copter_modes import CopterMode
from wil_campaign.plugins.ardupilot.copter.guided_setpoints import GLOBAL_FRAMES
from wil_campaign.plugins.ardupilot.copter.simulated_wind import simulated_wind
from wil_campaign.vehicles.embedded.autopilot.aircraft import EmulatedAircraft
from wil_campaign.vehicles.embedded.autopilot.flight.flight import TiltWatch
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GuidanceBehaviour,
    ReturnHomeBehaviour,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_flight import starts_with_takeoff
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import EmulatedMissionItem
from wil_campaign.vehicles.embedded.autopilot.flight.places import is_on_globe
from wil_campaign.vehicles.embedded.autopilot.flight.sticks import sticks_of_pulses
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    ReceivedCommand,
    on_command,
    on_message,
)
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL, INFO, WARNING

_PREARM_TEXT_S = 30.0
"""PREARM_DISPLAY_PERIOD of AP_Arming.cpp."""
_IN_FLIGHT_YAW_HEIGHT_M = 2.5
"""EKF3 aligns its yaw in flight above this height (EKF3_MAG_FINAL_RESET_ALT)."""
_CRASH_TILT_RAD, _CRASH_AFTER_S = math.radians(60.0), 2.0
"""ATC_ANGLE_MAX of 30 degrees and 30 degrees of error beyond it, for 2 s (crash_check.cpp)."""
_AFTER_LANDING_S = 0.4


class ArduCopter(CopterCore):
    """The emulated ArduCopter over MAVLink: commands, missions, failsafes; its part is GUIDED."""

    def __init__(self, aircraft: EmulatedAircraft) -> None:
        super().__init__(aircraft)
        self.guided = CopterGuided(self)
        self.hub.serve(self.guided)
        self._failsafes = CopterFailsafes(self.parameters)
        self._tilt = TiltWatch(limit_rad=_CRASH_TILT_RAD, for_s=_CRASH_AFTER_S)
        self._texts_sent = 0
        self._unready_text_s = boot.PREARM_BIT_S
        self._yaw_aligned = False
        self._on_ground = True
        self._sink_m_s = 0.0
        body, parameters = aircraft.body, self.parameters
        body.blown_by(lambda: simulated_wind(parameters, lambda: -body.truth.position_ned_m[2]))

    # Messages.

    @on_message("REQUEST_DATA_STREAM")
    def _on_data_stream(self, message: Any) -> None:
        rate_hz = float(message.req_message_rate) if message.start_stop else 0.0
        groups = copter_telemetry.STREAMS
        if message.req_stream_id == mavlink.MAV_DATA_STREAM_ALL:
            ids = [message_id for group in groups.values() for message_id in group]
        else:
            ids = list(groups.get(message.req_stream_id, ()))
        for message_id in ids:
            self.streams.set_rate(message_id, rate_hz, now_s=self.t_s)

    def _is_own_gcs(self, heartbeat: Any) -> bool:
        # GCS::sysid_is_gcs(): whatever its type.
        return bool(heartbeat.get_srcSystem() == self.parameters["MAV_GCS_SYSID"])

    @on_message("RC_CHANNELS_OVERRIDE")
    def _on_override(self, message: Any) -> None:
        pulses_us = (message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw)
        self._take_sticks(sticks_of_pulses(pulses_us, self.fresh_sticks(), at_s=self.t_s))

    @on_message("OBSTACLE_DISTANCE")
    def _on_obstacles(self, message: Any) -> None:
        self.avoidance.obstacle_distance(message, self.t_s)

    @on_message("DISTANCE_SENSOR")
    def _on_distance(self, message: Any) -> None:
        self.avoidance.distance_sensor(message, self.t_s)

    # Commands.

    def _begin_flight(self) -> None:
        super()._begin_flight()
        self._failsafes.reset()

    def _arming_fault(self, *, force: bool) -> str | None:
        fault = super()._arming_fault(force=force)
        if fault is None and not force and self._failsafes.has_low_battery:
            return "Arm: Battery failsafe"
        if fault is None and not force and self._broken_fences():
            return "Arm: vehicle outside fence"
        return fault

    @on_command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION)
    def _terminate(self, command: ReceivedCommand) -> int:
        if command.params[0] <= 0.5:
            return FAILED
        self.stop_motors("command")
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_DO_SET_HOME)
    def _set_home(self, command: ReceivedCommand) -> int:
        if self._sets_home_here(command):
            return super()._set_home(command)
        if command.params[0] != 0.0 or not is_on_globe(command.x, command.y):
            return FAILED
        if command.frame is not None and command.frame not in GLOBAL_FRAMES:
            return DENIED
        return super()._set_home(command)

    def _sets_home_here(self, command: ReceivedCommand) -> bool:
        return command.params[0] == 1.0 or (command.x == 0.0 and command.y == 0.0)

    @on_command(mavlink.MAV_CMD_DO_FENCE_ENABLE)
    def _enable_fence(self, command: ReceivedCommand) -> int:
        self.parameters.set("FENCE_ENABLE", 1.0 if command.params[0] == 1.0 else 0.0)
        return ACCEPTED

    # Flying.

    def choose(self, mode: CopterMode) -> int:
        """Switch ArduCopter to the user's mode if it can run; AUTO needs a mission."""
        flown = self.flight.armed and mode is not self.mode
        if flown and mode is CopterMode.AUTO and not self._can_begin_mission():
            self.outbox.send_text(WARNING, "Mode change to AUTO failed: init failed")
            return FAILED
        return super().choose(mode)

    def _can_begin_mission(self) -> bool:
        """Return whether ArduCopter has a mission, with a takeoff on the ground."""
        items = self.missions.items[1:]
        if self.flight.landed and not starts_with_takeoff(items):
            self.outbox.send_text(CRITICAL, "Auto: Missing Takeoff Cmd")
            return False
        return bool(items)

    def enter(self, mode: CopterMode) -> None:
        """Enter an ArduCopter mode; a pause and a region of interest end."""
        self.guided.end()
        super().enter(mode)

    def lift(self, down_m: float) -> GuidanceBehaviour | None:  # noqa: ARG002 - PX4 climbs to it
        """Return None: ArduCopter flies to a waypoint from the ground as it is."""
        return None

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Point ArduCopter's nose at a place; at 0, 0 no longer."""
        self.guided.look_at(latitude_deg, longitude_deg)

    def _go_to_item(self, item: EmulatedMissionItem) -> int:
        return self.guided.go_to_item(item)

    @on_command(mavlink.MAV_CMD_MISSION_START)
    def _start_mission(self, command: ReceivedCommand) -> int:
        """Fly ArduCopter's mission; a first or last item is refused."""
        if command.params[0] != 0.0 or command.params[1] != 0.0:
            return DENIED
        return self.choose(CopterMode.AUTO)

    def _behaviour(self, mode: CopterMode) -> GuidanceBehaviour:
        if mode is CopterMode.AUTO:
            return self.missions.begin()
        return super()._behaviour(mode)

    # Supervision.

    def supervise(self) -> None:
        """Send ArduCopter's due texts; check modes and failsafes."""
        self._boot()
        self._report_phases()
        flight, t_s = self.flight, self.t_s
        if not flight.armed:
            return
        if self.taking_off and flight.behaviour is not None and flight.behaviour.done:
            self.taking_off = False
        timeout_s = self.parameters["GUID_TIMEOUT"]
        if self.velocity_at_s is not None and t_s - self.velocity_at_s > timeout_s:
            self.velocity_at_s = None
            self.follow.stand(self.state.now)
        self.missions.watch()
        self.guided.face_roi()
        self._check_failsafes()
        if self._tilt.tumbling(self.state.now, t_s):
            self.strike("tumbling")
        self._disarm_when_due()

    def _boot(self) -> None:
        while self._texts_sent < len(boot.TEXTS):
            due_s, text = boot.TEXTS[self._texts_sent]
            if due_s > self.t_s or (self.never_ready and due_s >= boot.POSITION_S):
                break
            field_m = self.state.frame.altitude_m
            self.outbox.send_text(INFO, text.format(field_m=field_m))
            self._texts_sent += 1
        if self.state.home_ned_m is None and self.t_s >= boot.HOME_SET_S:
            self.set_home()
        if self.t_s >= self._unready_text_s and not self.flight.armed:
            if self.avoidance.lacks_data(self.t_s):
                self.outbox.send_text(CRITICAL, f"PreArm: {NO_DATA}")
            self._unready_text_s = self.t_s + _PREARM_TEXT_S

    def _report_phases(self) -> None:
        flight, now = self.flight, self.state.now
        height_m = self.state.home_down_m - now.position_ned_m[2]
        if not self._yaw_aligned and not flight.landed and height_m > _IN_FLIGHT_YAW_HEIGHT_M:
            self._yaw_aligned = True
            for imu in (0, 1):
                self.outbox.send_text(INFO, f"EKF3 IMU{imu} MAG0 in-flight yaw alignment complete")
        touching = self.state.touching
        if touching and not self._on_ground:
            sink_m_s = max(0.0, self._sink_m_s)
            self.outbox.send_text(INFO, f"SIM Hit ground at {sink_m_s:f} m/s")
        if not touching:
            self._sink_m_s = now.velocity_ned_m_s[2]
        if touching or height_m > 0.3:
            self._on_ground = touching

    def _check_failsafes(self) -> None:
        view = CopterFailsafeInputs(
            t_s=self.t_s,
            gcs_age_s=self.t_s - self.gcs_last_received_s,
            automatic=self.mode.is_autopilot or self.flight.landed,
            charge=self.state.charge,
            broken_fences=self._broken_fences(),
        )
        decision = self._failsafes.check(view)
        if decision is None:
            return
        for text in decision.texts:
            self.outbox.send_text(WARNING, text)
        if decision.mode is None:
            return
        if self.flight.landed:
            self.stop_motors("failsafe")
        elif self.mode is not CopterMode.LAND:
            self.fail(decision.mode)

    def _broken_fences(self) -> tuple[str, ...]:
        """Return the names of ArduCopter's fences breached here; none when off."""
        broken = self.fences_broken_at(self.state.now.position_ned_m)
        return tuple(name for name in broken if not (name == FLOOR and self.flight.landed))

    def _system_status(self) -> int:
        if self._failsafes.triggered:
            return int(mavlink.MAV_STATE_CRITICAL)
        return super()._system_status()

    def _stays_armed(self) -> bool:
        return self.taking_off

    def _disarm_delay_s(self, *, after_flight: bool) -> float:
        lands = self.mode in {CopterMode.LAND, CopterMode.AUTO} or isinstance(
            self.flight.behaviour, ReturnHomeBehaviour
        )
        return _AFTER_LANDING_S if after_flight and lands else self.parameters["DISARM_DELAY"]
