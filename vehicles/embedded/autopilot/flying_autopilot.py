"""Modes, arming, sticks and setpoints, as far as both firmwares handle them alike."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.emulated_autopilot import Aircraft, EmulatedAutopilot
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import Behaviour, Follow, Wanted
from wil_campaign.vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import load_parameters
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    RELATIVE_ALTITUDE_FRAMES,
    global_setpoint,
)
from wil_campaign.vehicles.embedded.autopilot.flight.sticks import (
    FlyBySticks,
    StickLimits,
    Sticks,
    sticks_of_manual,
)
from wil_campaign.vehicles.embedded.autopilot.services import discovery
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    Command,
    on_command,
    on_message,
    on_request,
)
from wil_campaign.vehicles.embedded.autopilot.services.outbox import CRITICAL
from wil_campaign.worlds.frames import Vec3


class FlownMode(Protocol):
    """A firmware's flight mode (protocol)."""

    @property
    def is_manual(self) -> bool:
        """Return whether a pilot's sticks fly the mode."""


Mode = TypeVar("Mode", bound=FlownMode)


class StandardModes(NamedTuple, Generic[Mode]):
    """A flying autopilot's modes for common commands: mission, return, land."""

    mission: Mode
    return_home: Mode
    land: Mode


class FlyingAutopilot(EmulatedAutopilot, Generic[Mode]):
    """A flying emulated autopilot with modes of one kind: modes, arming, sticks."""

    standard: StandardModes[Mode]
    manoeuvres: Manoeuvres
    follow: Follow

    def __init__(self, aircraft: Aircraft, *, rates_hz: Mapping[int, float], mode: Mode) -> None:
        firmware = self.firmware
        parameters = load_parameters(
            firmware.parameter_file, bytewise=firmware.bytewise, overrides=aircraft.overrides
        )
        super().__init__(aircraft, parameters=parameters, rates_hz=rates_hz)
        self.mode = mode
        self.failsafe = False
        self.sticks: Sticks | None = None

    # What differs between the firmwares.

    @abstractmethod
    def choose(self, mode: Mode) -> int:
        """Switch the autopilot to the user's mode if it can run; return a MAV_RESULT."""

    @abstractmethod
    def stop_motors(self, by: str) -> None:
        """Disarm the flying autopilot now, and report why."""

    @abstractmethod
    def _behaviour(self, mode: Mode) -> Behaviour:
        """Return the behaviour that a mode flies from here."""

    @abstractmethod
    def _arming_fault(self, *, force: bool) -> str | None:
        """Return the autopilot's STATUSTEXT for why it does not arm; None when it does."""

    @abstractmethod
    def _begin_flight(self) -> None:
        """Set home, send texts and reset failsafes after arming, before the mode is flown."""

    @abstractmethod
    def _receive_setpoint(self, wanted: Wanted | None) -> None:
        """Fly a received setpoint, if the mode does."""

    @abstractmethod
    def _base_mode(self) -> int:
        """Return the flags of the HEARTBEAT, without the armed one."""

    @abstractmethod
    def _system_status(self) -> int:
        """Return the MAV_STATE of the HEARTBEAT."""

    @abstractmethod
    def _disarm_delay_s(self, *, after_flight: bool) -> float:
        """Return how long it stays armed on the ground; 0 means forever."""

    @abstractmethod
    def _stick_limits(self) -> StickLimits:
        """Return the demand of fully deflected sticks."""

    @abstractmethod
    def _sticks_last_s(self) -> float:
        """Return how long received sticks are valid."""

    # Reported state.

    @on_request(discovery.CURRENT_MODE)
    def _current_mode(self) -> Any:
        return discovery.current_mode(self.firmware.mode_entries, self._custom_mode())

    @on_request(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    def _heartbeat(self) -> Any:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.flight.armed else 0
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            self.firmware.mav_autopilot,
            self._base_mode() | armed,
            self._custom_mode(),
            self._system_status(),
            3,
        )

    @abstractmethod
    def _custom_mode(self) -> int:
        """Return the mode's number in the HEARTBEAT."""

    # Modes.

    def enter(self, mode: Mode) -> None:
        """Enter a mode and fly it."""
        if mode != self.mode:
            self.manoeuvres.forget_speeds()
        self.mode = mode
        if self.flight.armed:
            self.flight.fly(self._behaviour(mode))

    @on_command(mavlink.MAV_CMD_NAV_LAND)
    def _land(self, _: Command) -> int:
        return self.choose(self.standard.land)

    @on_command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    def _return(self, _: Command) -> int:
        return self.choose(self.standard.return_home)

    @on_command(mavlink.MAV_CMD_MISSION_START)
    def _start_mission(self, _: Command) -> int:
        return self.choose(self.standard.mission)

    # Arming.

    def arm(self, *, force: bool) -> int:
        """Arm if the checks pass; the firmware decides which checks `force` skips."""
        if self.flight.armed:
            return ACCEPTED
        fault = self._arming_fault(force=force)
        if fault is not None:
            self.outbox.send_text(CRITICAL, fault)
            return self.firmware.refused
        self.flight.arm(self.t_s)
        self.failsafe = False
        self._begin_flight()
        self.enter(self.mode)
        return ACCEPTED

    def disarm(self, *, force: bool) -> int:
        """Disarm on the ground, in the air only by force."""
        if not self.flight.armed:
            return ACCEPTED
        if not (self.flight.landed or force):
            self._report_not_landed()
            return self.firmware.refused
        self.stop_motors("external command")
        return ACCEPTED

    def _report_not_landed(self) -> None:
        """Send a text that it is not disarmed in flight; ArduCopter sends none."""

    def _stays_armed(self) -> bool:
        """Return whether the vehicle is about to leave the ground."""
        return self.flight.takeoff_detected

    def _disarm_when_due(self) -> None:
        flight = self.flight
        if not flight.armed or not flight.landed or self._stays_armed():
            return
        landed_at_s = flight.landed_at_s
        since_s = flight.armed_at_s if landed_at_s is None else landed_at_s
        if 0.0 < self._disarm_delay_s(after_flight=landed_at_s is not None) <= self.t_s - since_s:
            self.stop_motors("auto preflight disarming" if landed_at_s is None else "landing")

    # Sticks.

    def fresh_sticks(self) -> Sticks | None:
        """Return the pilot's sticks; None when there are none, or they are stale."""
        sticks = self.sticks
        if sticks is None or self.t_s - sticks.at_s > self._sticks_last_s():
            return None
        return sticks

    @on_message("MANUAL_CONTROL")
    def _on_manual_control(self, message: Any) -> None:
        if message.target in {0, self.identity.system_id}:
            self._take_sticks(
                sticks_of_manual(message.x, message.y, message.z, message.r, at_s=self.t_s)
            )

    def _take_sticks(self, sticks: Sticks | None) -> None:
        self.sticks = sticks
        flown = isinstance(self.flight.behaviour, FlyBySticks)
        if self.flight.armed and self.mode.is_manual and not flown:
            self.flight.fly(self._by_sticks())

    def _by_sticks(self) -> Behaviour:
        return FlyBySticks(
            sticks=self.fresh_sticks,
            limits=self._stick_limits(),
            yaw_rad=self.state.now.euler_rad[2],
        )

    # Setpoints and places.

    def _takes_global_setpoints(self) -> bool:
        return True

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if self._takes_global_setpoints():
            state = self.state
            self._receive_setpoint(global_setpoint(message, state.frame, state.home_down_m))

    def _place_of(self, command: Command) -> Vec3:
        """Return a command's position, local; values that are not finite mean the present ones."""
        state = self.state
        here = state.frame.to_geodetic(state.now.position_ned_m)
        altitude_m = command.z
        if command.frame in RELATIVE_ALTITUDE_FRAMES and self.firmware.heights_relative:
            altitude_m += state.frame.altitude_m - state.home_down_m
        return state.frame.to_ned(
            command.x if math.isfinite(command.x) else here.latitude_deg,
            command.y if math.isfinite(command.y) else here.longitude_deg,
            altitude_m if math.isfinite(altitude_m) else here.altitude_m,
        )

    def _return_home(self) -> Behaviour:
        return self.manoeuvres.go_home()
