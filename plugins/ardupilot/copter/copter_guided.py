"""ArduCopter's GUIDED, a part of it: setpoints, places, headings, pauses."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.copter import guided_setpoints
from wil_campaign.plugins.ardupilot.copter.copter_core import CopterCore
from wil_campaign.plugins.ardupilot.copter.copter_modes import CopterMode
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GuidanceBehaviour,
    WantedMotion,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_flight import (
    FlyMission,
    mission_item_position,
)
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import (
    EmulatedMissionItem,
    mission_item_fault,
)
from wil_campaign.vehicles.embedded.autopilot.flight.places import is_altitude
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    global_setpoint,
    local_setpoint,
)
from wil_campaign.vehicles.embedded.autopilot.services import mission_service
from wil_campaign.vehicles.embedded.autopilot.services.command_registry import (
    ACCEPTED,
    DENIED,
    FAILED,
    UNSUPPORTED,
    ReceivedCommand,
    on_command,
    on_message,
)
from wil_campaign.worlds.frames import Vec3

_ROI_NEAR_M = 0.5
"""The heading ignores a region of interest that is nearer than this."""


class CopterGuided:
    """ArduCopter's GUIDED, and what a client changes in AUTO: pauses and regions of interest."""

    def __init__(self, copter: CopterCore) -> None:
        self._copter = copter
        self._state = copter.state
        self._flight = copter.flight
        self._manoeuvres = copter.manoeuvres
        self.paused: GuidanceBehaviour | None = None
        """The behaviour to resume after a pause."""
        self._roi: tuple[float, float] | None = None
        """A region of interest, m north and east."""

    @property
    def _is_on(self) -> bool:
        return self._copter.mode is CopterMode.GUIDED

    def end(self) -> None:
        """End a pause and a region of interest: a mode is entered."""
        self.paused = self._roi = None

    def _fly_guided(self, behaviour: GuidanceBehaviour) -> None:
        """Fly a behaviour of GUIDED; during a pause, after it."""
        if self.paused is None:
            self._flight.fly(behaviour)
        else:
            self.paused = behaviour

    # Setpoints.

    @on_message("SET_POSITION_TARGET_LOCAL_NED")
    def _on_local_setpoint(self, message: Any) -> None:
        if self._is_on:
            flies = guided_setpoints.is_flown_local_setpoint(message)
            self._receive_setpoint(local_setpoint(message, self._state.now) if flies else None)

    @on_message("SET_POSITION_TARGET_GLOBAL_INT")
    def _on_global_setpoint(self, message: Any) -> None:
        if self._is_on:
            state, flies = self._state, guided_setpoints.is_flown_global_setpoint(message)
            place = global_setpoint(message, state.frame, state.home_down_m) if flies else None
            self._receive_setpoint(place)

    def _receive_setpoint(self, wanted: WantedMotion | None) -> None:
        """Fly a setpoint in the air, or stop for None; on the ground it only ends a takeoff."""
        flight = self._flight
        if wanted is not None and self._is_outside(wanted.position_ned_m):
            return
        self._end_takeoff()
        if not flight.armed or flight.landed:
            return
        self._roi = None
        if wanted is None:
            self._stop()
            return
        self._copter.velocity_at_s = self._copter.t_s if wanted.has_velocity else None
        self._copter.follow.set(
            wanted,
            keep_yaw_rad=flight.law.yaw_setpoint_rad,
            faces_from_m_s=None if wanted.has_heading else self._manoeuvres.faces_from_m_s(),
        )
        if self._copter.follow not in {flight.behaviour, self.paused}:
            self._fly_guided(self._copter.follow)

    def _end_takeoff(self) -> None:
        """End a takeoff: a destination has replaced it (SubMode of mode_guided.cpp)."""
        if self._copter.taking_off:
            self._copter.taking_off = False
            self._stop()

    def _stop(self) -> None:
        """Stop ArduCopter and follow nothing; a pause ends (ModeGuided::init)."""
        self.paused = self._copter.velocity_at_s = None
        self._copter.follow.stand(self._state.now)
        self._flight.fly(self._copter.follow)

    # Places.

    @on_command(mavlink.MAV_CMD_NAV_TAKEOFF)
    def _take_off(self, command: ReceivedCommand) -> int:
        flight = self._flight
        if not self._is_on or not flight.armed or not flight.landed:
            return FAILED
        if command.frame not in {None, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT}:
            return DENIED
        down_m = self._state.home_down_m - command.z
        higher = down_m < self._state.now.position_ned_m[2]
        if not (command.z > 0.0 and higher and is_altitude(command.z)):
            return FAILED
        self.paused = None
        flight.fly(self._manoeuvres.take_off(down_m))
        self._copter.taking_off = True
        return ACCEPTED

    @on_command(mavlink.MAV_CMD_DO_REPOSITION)
    def _reposition(self, command: ReceivedCommand) -> int:
        if command.frame is None:
            return UNSUPPORTED
        change_mode = command.whole(1) & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        nowhere = command.x == 0.0 and command.y == 0.0
        if nowhere or not command.has_place or command.frame not in guided_setpoints.GLOBAL_FRAMES:
            return DENIED
        if self._is_outside(self._copter.place_of(command)):
            return FAILED
        if not self._is_on:
            if not change_mode:
                return DENIED
            if self._copter.choose(CopterMode.GUIDED) != ACCEPTED:
                return FAILED
        self._fly_to(self._copter.place_of(command))
        return ACCEPTED

    def go_to_item(self, item: EmulatedMissionItem) -> int:
        """Fly ArduCopter to a guided item, in GUIDED and in the air."""
        rules = self._copter.firmware.item_rules
        placed = (
            mission_item_fault(mission_service.MISSION, item, rules) == mission_service.ACCEPTED
        )
        if not placed or item.command != mavlink.MAV_CMD_NAV_WAYPOINT:
            return int(mavlink.MAV_MISSION_INVALID)
        if not self._is_on:
            return int(mavlink.MAV_MISSION_ERROR)
        place = mission_item_position(item, self._state)
        if self._is_outside(place):
            return int(mavlink.MAV_MISSION_ERROR)
        self._fly_to(place)
        return mission_service.ACCEPTED

    def _is_outside(self, place: tuple[float | None, float | None, float | None]) -> bool:
        """Return whether a destination is outside of a fence: it is refused, or ignored."""
        north, east, down = place
        if north is None or east is None or down is None:
            return False
        return bool(self._copter.fences_broken_at((north, east, down)))

    def _fly_to(self, position_ned_m: Vec3) -> None:
        """Fly ArduCopter to a place in GUIDED; on the ground it only ends a takeoff."""
        self._end_takeoff()
        if self._flight.armed and not self._flight.landed:
            self._roi = None
            self._copter.velocity_at_s = None
            self._fly_guided(self._manoeuvres.go_to(position_ned_m, radius_m=0.3))

    # Headings.

    @on_command(mavlink.MAV_CMD_CONDITION_YAW)
    def _turn(self, command: ReceivedCommand) -> int:
        """Turn ArduCopter to a heading (param1, degrees), relative when param4 is 1."""
        angle_deg, _, direction, relative = command.params
        if not self._is_on or not math.isfinite(angle_deg):
            return FAILED
        if relative not in {0.0, 1.0} or direction not in {-1.0, 0.0, 1.0}:
            return DENIED
        yaw_rad = math.radians(math.fmod(angle_deg, 360.0))
        if relative == 1.0:
            yaw_rad = self._state.now.euler_rad[2] + (direction or 1.0) * abs(yaw_rad)
        self._roi = None
        self._face(yaw_rad)
        return ACCEPTED

    def _face(self, yaw_rad: float) -> None:
        """Turn the flown behaviour to a heading."""
        for each in (self._flight.behaviour, self.paused):
            if each is not None:
                each.face(yaw_rad)

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Point ArduCopter's nose at a place; at 0, 0 no longer."""
        if latitude_deg == 0.0 and longitude_deg == 0.0:
            self._roi = None
            return
        frame = self._state.frame
        self._roi = frame.to_ned(latitude_deg, longitude_deg, frame.altitude_m)[:2]

    def face_roi(self) -> None:
        """Keep ArduCopter's nose pointed at the region of interest, if there is one."""
        if self._roi is None or self._copter.mode not in {CopterMode.GUIDED, CopterMode.AUTO}:
            return
        here = self._state.now.position_ned_m
        north, east = self._roi[0] - here[0], self._roi[1] - here[1]
        if math.hypot(north, east) > _ROI_NEAR_M:
            self._face(math.atan2(east, north))

    # Pauses.

    @on_command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE)
    def _pause_continue(self, command: ReceivedCommand) -> int:
        """Pause in AUTO on the way to a waypoint, or in GUIDED (param1 0); continue (1)."""
        if command.params[0] == 0.0:
            return self._pause()
        return self._resume() if command.params[0] == 1.0 else DENIED

    def _pause(self) -> int:
        behaviour = self._flight.behaviour
        if not self._flight.armed or behaviour is None or self.paused is not None:
            return ACCEPTED if self.paused is not None else FAILED
        on_mission = isinstance(behaviour, FlyMission) and behaviour.is_under_way
        if not (self._is_on or (self._copter.mode is CopterMode.AUTO and on_mission)):
            return FAILED
        self.paused = behaviour
        self._flight.fly(self._manoeuvres.hold())
        return ACCEPTED

    def _resume(self) -> int:
        if self._copter.mode not in {CopterMode.GUIDED, CopterMode.AUTO} or not self._flight.armed:
            return FAILED
        if self.paused is not None:
            self._flight.fly(self.paused)
            self.paused = None
        return ACCEPTED
