"""ArduCopter's GUIDED mode: setpoints, positions, headings, regions of interest, pauses."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.copter import guided_setpoints
from wil_campaign.plugins.ardupilot.copter.copter_core import CopterCore
from wil_campaign.plugins.ardupilot.copter.copter_modes import CopterMode
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import Behaviour, TakeOff, Wanted
from wil_campaign.vehicles.embedded.autopilot.flight.mission_flight import FlyMission, place_of
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import Item, item_fault
from wil_campaign.vehicles.embedded.autopilot.flight.places import is_altitude
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import local_setpoint
from wil_campaign.vehicles.embedded.autopilot.services import mission_service
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    UNSUPPORTED,
    Command,
    on_command,
    on_message,
)
from wil_campaign.worlds.frames import Vec3

_ROI_NEAR_M = 0.5
"""The heading ignores a region of interest that is nearer than this."""


class CopterGuided(CopterCore):
    """ArduCopter's GUIDED, and what a client changes in AUTO: pauses and regions of interest."""

    paused: Behaviour | None = None
    """The behaviour to resume after a pause."""
    _roi: tuple[float, float] | None = None
    """A region of interest, m north and east."""

    def enter(self, mode: CopterMode) -> None:
        """Enter an ArduCopter mode; a pause and a region of interest end."""
        self.paused = self._roi = None
        super().enter(mode)

    def _fly_guided(self, behaviour: Behaviour) -> None:
        """Fly a behaviour of GUIDED; during a pause, after it."""
        if self.paused is None:
            self.flight.fly(behaviour)
        else:
            self.paused = behaviour

    # Setpoints.

    @on_message("SET_POSITION_TARGET_LOCAL_NED")
    def _on_local_setpoint(self, message: Any) -> None:
        if self.mode is CopterMode.GUIDED:
            flies = guided_setpoints.flies_local(message)
            self._receive_setpoint(local_setpoint(message, self.state.now) if flies else None)

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if guided_setpoints.flies_global(message):
            super()._on_global_setpoint(message)
        elif self._takes_global_setpoints():
            self._receive_setpoint(None)

    def _takes_global_setpoints(self) -> bool:
        return self.mode is CopterMode.GUIDED

    def _receive_setpoint(self, wanted: Wanted | None) -> None:
        """Fly a setpoint in the air; None stops ArduCopter."""
        flight = self.flight
        if not flight.armed or flight.landed or self.taking_off:
            return
        self._roi = None
        if wanted is None:
            self._stop()
            return
        self.velocity_at_s = self.t_s if wanted.has_velocity else None
        self.follow.set(wanted, keep_yaw_rad=flight.law.yaw_setpoint_rad)
        if self.follow not in {flight.behaviour, self.paused}:
            self._fly_guided(self.follow)

    def _stop(self) -> None:
        """Stop ArduCopter and follow nothing; a pause ends (ModeGuided::init)."""
        self.paused = self.velocity_at_s = None
        self.follow.stand(self.state.now)
        self.flight.fly(self.follow)

    # Places.

    @on_command(mavlink.MAV_CMD_NAV_TAKEOFF)
    def _take_off(self, command: Command) -> int:
        flight = self.flight
        if self.mode is not CopterMode.GUIDED or not flight.armed or not flight.landed:
            return FAILED
        if not (command.z > 0.0 and is_altitude(command.z)):
            return FAILED
        down_m = self.state.home_down_m - command.z
        self.paused = None
        flight.fly(self.manoeuvres.take_off(down_m))
        self.taking_off = True
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_DO_REPOSITION)
    def _reposition(self, command: Command) -> int:
        if command.frame is None:
            return UNSUPPORTED
        change_mode = command.whole(1) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if not command.has_place:
            return DENIED
        if self.mode is not CopterMode.GUIDED:
            if not change_mode:
                return DENIED
            if self.choose(CopterMode.GUIDED) != ACCEPTED:
                return FAILED
        self._fly_to(self._place_of(command))
        return ACCEPTED

    def _go_to_item(self, item: Item) -> int:
        """Fly ArduCopter to a guided item, in GUIDED and in the air."""
        rules = self.firmware.item_rules
        placed = item_fault(mission_service.MISSION, item, rules) == mission_service.ACCEPTED
        if not placed or item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return int(mavlink.MAV_MISSION_INVALID)
        if self.mode is not CopterMode.GUIDED:
            return int(mavlink.MAV_MISSION_ERROR)
        self._fly_to(place_of(item, self.state))
        return mission_service.ACCEPTED

    def _fly_to(self, position_ned_m: Vec3) -> None:
        """Fly ArduCopter to a place in GUIDED; ignored on the ground."""
        if self.flight.armed and not self.flight.landed:
            self._roi = None
            self.velocity_at_s = None
            self._fly_guided(self.manoeuvres.go_to(position_ned_m, radius_m=0.3))

    # Headings.

    @on_command(mavlink.MAV_CMD_CONDITION_YAW)
    def _turn(self, command: Command) -> int:
        """Turn ArduCopter to a heading (param1, degrees), relative when param4 is 1."""
        angle_deg, _, direction, relative = command.params
        if self.mode is not CopterMode.GUIDED or not math.isfinite(angle_deg):
            return FAILED
        if relative not in {0.0, 1.0} or direction not in {-1.0, 0.0, 1.0}:
            return DENIED
        yaw_rad = math.radians(math.fmod(angle_deg, 360.0))
        if relative == 1.0:
            yaw_rad = self.state.now.euler_rad[2] + (direction or 1.0) * abs(yaw_rad)
        self._roi = None
        self._face(yaw_rad)
        return ACCEPTED

    def _face(self, yaw_rad: float) -> None:
        """Turn the flown behaviour to a heading; a takeoff keeps its own until its end."""
        behaviour = self.flight.behaviour
        if isinstance(behaviour, TakeOff) and behaviour.done:
            behaviour = self.manoeuvres.go_to(behaviour.goal_ned_m, radius_m=0.3)
            self.flight.fly(behaviour)
        for each in (behaviour, self.paused):
            if each is not None:
                each.face(yaw_rad)

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Point ArduCopter's nose at a place; at 0, 0 no longer."""
        if latitude_deg == 0.0 and longitude_deg == 0.0:
            self._roi = None
            return
        frame = self.state.frame
        self._roi = frame.to_ned(latitude_deg, longitude_deg, frame.altitude_m)[:2]

    def _look_at_roi(self) -> None:
        """Keep ArduCopter's nose pointed at the region of interest, if there is one."""
        if self._roi is None or self.mode not in {CopterMode.GUIDED, CopterMode.AUTO}:
            return
        here = self.state.now.position_ned_m
        north, east = self._roi[0] - here[0], self._roi[1] - here[1]
        if math.hypot(north, east) > _ROI_NEAR_M:
            self._face(math.atan2(east, north))

    # Pauses.

    @on_command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE)
    def _pause_continue(self, command: Command) -> int:
        """Pause in AUTO on the way to a waypoint, or in GUIDED (param1 0); continue (1)."""
        if command.params[0] == 0.0:
            return self._pause()
        return self._resume() if command.params[0] == 1.0 else DENIED

    def _pause(self) -> int:
        behaviour = self.flight.behaviour
        if not self.flight.armed or behaviour is None or self.paused is not None:
            return ACCEPTED if self.paused is not None else FAILED
        on_mission = isinstance(behaviour, FlyMission) and behaviour.is_under_way
        if not (self.mode is CopterMode.GUIDED or (self.mode is CopterMode.AUTO and on_mission)):
            return FAILED
        self.paused = behaviour
        self.flight.fly(self.manoeuvres.hold())
        return ACCEPTED

    def _resume(self) -> int:
        if self.mode not in {CopterMode.GUIDED, CopterMode.AUTO} or not self.flight.armed:
            return FAILED
        if self.paused is not None:
            self.flight.fly(self.paused)
            self.paused = None
        return ACCEPTED
