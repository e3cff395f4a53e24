"""Modes, arming, setpoints and missions, as far as both firmwares have them alike."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.autopilot.emulated_autopilot import EmulatedAutopilot
from vehicles.embedded.autopilot.flight.autopilot_state import Identity
from vehicles.embedded.autopilot.flight.guidance import Behaviour, Follow, Wanted
from vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from vehicles.embedded.autopilot.flight.mission_flight import FlyMission, steps_of
from vehicles.embedded.autopilot.flight.parameter_table import load_parameters
from vehicles.embedded.autopilot.flight.setpoint_targets import (
    RELATIVE_ALTITUDE_FRAMES,
    global_setpoint,
)
from vehicles.embedded.autopilot.services import mission_service
from vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    Command,
    on_command,
    on_message,
    on_request,
)
from vehicles.embedded.autopilot.services.outbox import CRITICAL
from vehicles.embedded.physics.airframe import Airframe
from vehicles.embedded.physics.battery import Charge
from worlds.frames import Vec3

Mode = TypeVar("Mode")


class StandardModes(NamedTuple, Generic[Mode]):
    """Which of a firmware's modes do what commands ask for."""

    mission: Mode
    return_home: Mode
    land: Mode


class FlyingAutopilot(EmulatedAutopilot, Generic[Mode]):
    """An autopilot with modes of one kind."""

    parameter_file: ClassVar[Path]
    mav_autopilot: ClassVar[int]
    first_mission_item: ClassVar[int]
    """Of the user's: ArduPilot's item 0 is home."""
    refused: ClassVar[int]
    """MAV_RESULT of an arm or disarm command that the checks refuse."""
    standard: StandardModes[Mode]
    manoeuvres: Manoeuvres
    follow: Follow

    def __init__(
        self,
        *,
        identity: Identity,
        airframe: Airframe,
        dt_s: float,
        charge: Charge,
        overrides: Mapping[str, float],
        rates_hz: Mapping[int, float],
        mode: Mode,
    ) -> None:
        super().__init__(
            identity=identity,
            airframe=airframe,
            dt_s=dt_s,
            charge=charge,
            parameters=load_parameters(
                self.parameter_file, bytewise=self.is_px4, overrides=overrides
            ),
            rates_hz=rates_hz,
        )
        self.mode = mode
        self.failsafe = False

    # What each firmware does in its own way.

    @abstractmethod
    def choose(self, mode: Mode) -> int:
        """Switch to the user's mode if it can run; return a MAV_RESULT."""

    @abstractmethod
    def stop_motors(self, by: str) -> None:
        """Disarm now, and say by what."""

    @abstractmethod
    def _behaviour(self, mode: Mode) -> Behaviour:
        """Return what a mode flies from here."""

    @abstractmethod
    def _arming_fault(self, *, force: bool) -> str | None:
        """Return why it does not arm, in the firmware's words; None when it does."""

    @abstractmethod
    def _begin_flight(self) -> None:
        """Do what follows arming, before the mode is flown: home, texts, failsafes."""

    @abstractmethod
    def _take_setpoint(self, wanted: Wanted | None) -> None:
        """Fly a setpoint that came, if the mode does."""

    @abstractmethod
    def _base_mode(self) -> int:
        """Return the flags of the HEARTBEAT, without the armed one."""

    @abstractmethod
    def _system_status(self) -> int:
        """Return the MAV_STATE of the HEARTBEAT."""

    @abstractmethod
    def _disarm_delay_s(self, *, after_flight: bool) -> float:
        """Return how long it stays armed on the ground; 0 for ever."""

    # What it says of itself.

    @on_request(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    def _heartbeat(self) -> Any:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.flight.armed else 0
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR,
            self.mav_autopilot,
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
        """Fly a mode from now on."""
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
        """Arm if the checks pass; how far force goes is each firmware's."""
        if self.flight.armed:
            return ACCEPTED
        fault = self._arming_fault(force=force)
        if fault is not None:
            self.outbox.say(CRITICAL, fault)
            return self.refused
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
            self._say_not_landed()
            return self.refused
        self.stop_motors("external command")
        return ACCEPTED

    def _say_not_landed(self) -> None:
        """Say why it is not disarmed; ArduCopter says nothing."""

    def _stays_armed(self) -> bool:
        """Return whether it is about to leave the ground."""
        return self.flight.lifting

    def _disarm_when_due(self) -> None:
        flight = self.flight
        if not flight.armed or not flight.landed or self._stays_armed():
            return
        landed_at_s = flight.landed_at_s
        since_s = flight.armed_at_s if landed_at_s is None else landed_at_s
        if 0.0 < self._disarm_delay_s(after_flight=landed_at_s is not None) <= self.t_s - since_s:
            self.stop_motors("auto preflight disarming" if landed_at_s is None else "landing")

    # Setpoints and places.

    def _takes_global_setpoints(self) -> bool:
        return True

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if self._takes_global_setpoints():
            state = self.state
            self._take_setpoint(global_setpoint(message, state.frame, state.home_down_m))

    def _place_of(self, command: Command) -> Vec3:
        """Return where a command's place is, local; what is not finite is the present."""
        state = self.state
        here = state.frame.to_geodetic(state.now.position_ned_m)
        altitude_m = command.z
        if command.frame in RELATIVE_ALTITUDE_FRAMES:
            altitude_m += state.frame.altitude_m - state.home_down_m
        return state.frame.to_ned(
            command.x if math.isfinite(command.x) else here.latitude_deg,
            command.y if math.isfinite(command.y) else here.longitude_deg,
            altitude_m if math.isfinite(altitude_m) else here.altitude_m,
        )

    # Missions.

    def _mission(self) -> Behaviour | None:
        """Return the flight of the uploaded mission; None when nothing in it is flown."""
        state = self.state
        items = self.missions.items(mission_service.MISSION)
        first = max(self.first_mission_item, state.mission_seq)
        steps = steps_of(
            items,
            first=first,
            state=state,
            manoeuvres=self.manoeuvres,
            go_home=self._return_home,
        )
        return FlyMission(steps=steps, reached=self._reached) if steps else None

    def _return_home(self) -> Behaviour:
        return self.manoeuvres.go_home()

    def _reached(self, seq: int) -> None:
        self.outbox.send(mavlink.MAVLink_mission_item_reached_message(seq))
        self.state.mission_seq = min(seq + 1, self.state.mission_total - 1)
