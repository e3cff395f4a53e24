"""Flies an uploaded mission: its items in order, with jumps and changes of speed."""

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.autopilot_state import AutopilotState
from wil_campaign.vehicles.embedded.autopilot.flight.guidance import (
    GoToBehaviour,
    GuidanceBehaviour,
    GuidanceSpeeds,
    LandBehaviour,
    ReturnHomeBehaviour,
)
from wil_campaign.vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from wil_campaign.vehicles.embedded.autopilot.flight.mission_items import EmulatedMissionItem
from wil_campaign.vehicles.embedded.autopilot.flight.places import int32_of_float
from wil_campaign.vehicles.embedded.autopilot.flight.setpoint_targets import (
    RELATIVE_ALTITUDE_FRAMES,
)
from wil_campaign.vehicles.embedded.control.target import ControlTarget
from wil_campaign.vehicles.embedded.physics.states import BodyMotion
from wil_campaign.worlds.frames import Vec3

_TO_PLACES = {
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM,
    mavlink.MAV_CMD_NAV_LOITER_TURNS,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT,
}
_KEEP_HEIGHT = _TO_PLACES - {mavlink.MAV_CMD_NAV_LOITER_TO_ALT}
FLOWN = {
    *_TO_PLACES,
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mavlink.MAV_CMD_NAV_DELAY,
}
"""Commands of a mission that are flown; of the others, only DO_JUMP, DO_CHANGE_SPEED and `LOOKS`
have an effect."""
LOOKS = (
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
    mavlink.MAV_CMD_DO_SET_ROI,
    mavlink.MAV_CMD_DO_SET_ROI_NONE,
)
"""Regions of interest: by place, by the older command, and the end of one."""
_STAYS = {
    mavlink.MAV_CMD_NAV_WAYPOINT: 1.0,
    mavlink.MAV_CMD_NAV_LOITER_TIME: 1.0,
    mavlink.MAV_CMD_NAV_DELAY: 1.0,
    mavlink.MAV_CMD_NAV_LOITER_TURNS: 18.0,
}
"""Seconds to stay per unit of param1: a turn takes 18 s at CIRCLE_RATE of 20 degrees/s."""
_MAX_STEPS = 2000
"""After so many items without one that is flown, the mission jumps in circles: it ends."""


class MissionEvents(Protocol):
    """The events that a flown mission reports to its autopilot (protocol)."""

    def begin_item(self, seq: int) -> None:
        """Report that this mission item is now flown."""

    def reach_item(self, seq: int) -> None:
        """Report that a mission item is reached."""

    def finish_mission(self) -> None:
        """Report that the mission's last item is reached."""

    def look_at(self, latitude_deg: float, longitude_deg: float) -> None:
        """Look at a region of interest from now on; at 0, 0 there is none."""


class MissionMakers(NamedTuple):
    """How a firmware flies mission items. lift: the climb before an item on the ground, or None."""

    manoeuvres: Manoeuvres
    go_home: Callable[[], GuidanceBehaviour]
    lift: Callable[[float], GuidanceBehaviour | None]


class FlyMission(GuidanceBehaviour):
    """The behaviour that flies mission items in order from `first` on; then it stays."""

    def __init__(
        self,
        *,
        items: tuple[EmulatedMissionItem, ...],
        first: int,
        state: AutopilotState,
        makers: MissionMakers,
        events: MissionEvents,
    ) -> None:
        super().__init__()
        self._items = items
        self._state = state
        self._makers = makers
        self._events = events
        self._jumps: dict[int, int] = {}
        self._seq = first
        self._arrived_s: float | None = None
        self._current: GuidanceBehaviour = makers.manoeuvres.hold()
        self._next: GuidanceBehaviour | None = None
        self._advance_to(first)

    @property
    def seq(self) -> int:
        """Return the mission item being flown."""
        return self._seq

    @property
    def lifts(self) -> bool:
        """Return whether the present mission item takes off."""
        return self._current.lifts

    @property
    def descends(self) -> bool:
        """Return whether the present mission item lands."""
        return self._current.descends

    def update(self, now: BodyMotion, t_s: float) -> ControlTarget:
        """Return the present mission item's target; begin the next item when it is done."""
        target = self._current.update(now, t_s)
        if not self._current.done or self.done:
            return target
        if self._next is not None:
            self._current, self._next = self._next, None
            return target
        if self._arrived_s is None:
            self._arrived_s = t_s
        if t_s - self._arrived_s >= mission_stay_s(self._items[self._seq]):
            self._reach()
        return target

    def receive_landing(self) -> None:
        """Continue the mission after the landing of the present item."""
        if not self.done and isinstance(self._current, LandBehaviour | ReturnHomeBehaviour):
            self._reach()

    def jump_to(self, seq: int) -> None:
        """Continue the mission with this item."""
        self.done = False
        self._advance_to(seq)

    def change_speeds(self, speeds: GuidanceSpeeds) -> None:
        """Fly the present mission item at other speeds."""
        self._current.change_speeds(speeds)

    def face(self, yaw_rad: float) -> None:
        """Turn to a heading while flying the present mission item."""
        self._current.face(yaw_rad)

    @property
    def is_under_way(self) -> bool:
        """Return whether the mission flies to a position that is not reached yet."""
        return not self.done and isinstance(self._current, GoToBehaviour) and not self._current.done

    def _reach(self) -> None:
        self._events.reach_item(self._seq)
        self._advance_to(self._seq + 1)

    def _advance_to(self, seq: int) -> None:
        """Begin the mission's first flown item from `seq` on; execute the items before it."""
        self._arrived_s = None
        for _ in range(_MAX_STEPS):
            if seq >= len(self._items):
                break
            if self._items[seq].command in FLOWN:
                self._begin(seq)
                return
            seq = self._execute(seq)
        self.done = True
        self._events.finish_mission()

    def _begin(self, seq: int) -> None:
        self._seq = seq
        self._events.begin_item(seq)
        item = self._items[seq]
        self._current, self._next = self._behaviour(item), None
        first: GuidanceBehaviour | None = None
        if item.command in _TO_PLACES:
            first = self._makers.lift(self._position(item)[2])
        elif isinstance(self._current, LandBehaviour) and (item.x, item.y) != (0, 0):
            first = self._flight_to_landing(self._current, item)
        if first is not None:
            self._current, self._next = first, self._current

    def _flight_to_landing(
        self, landing: LandBehaviour, item: EmulatedMissionItem
    ) -> GuidanceBehaviour:
        """Aim a landing at its item's place; return the flight there, at the present height.

        PX4's Mission::do_need_move_to_land, ArduCopter's ModeAuto::do_land.
        """
        north, east, _ = mission_item_position(item, self._state)
        landing.aim(north, east)
        down = self._state.now.position_ned_m[2]
        return self._makers.manoeuvres.waypoint((north, east, down), yaw_deg=item.params[3])

    def _position(self, item: EmulatedMissionItem) -> Vec3:
        """Return a mission item's position, with what the firmware does for a height of zero."""
        north, east, down = mission_item_position(item, self._state)
        keeps = self._makers.manoeuvres.zero_keeps_height and item.command in _KEEP_HEIGHT
        return (north, east, self._state.now.position_ned_m[2] if keeps and not item.z else down)

    def _execute(self, seq: int) -> int:
        """Execute a mission item that is not flown; return the index of the next one."""
        item = self._items[seq]
        if item.command == mavlink.MAV_CMD_DO_JUMP:
            target, times = int32_of_float(item.params[0]), int32_of_float(item.params[1])
            done = self._jumps.get(seq, 0)
            if 0 <= target < len(self._items) and (times < 0 or done < times):
                self._jumps[seq] = done + 1
                return target
        elif item.command == mavlink.MAV_CMD_DO_CHANGE_SPEED:
            self._makers.manoeuvres.change_speed(item.params[0], item.params[1])
        elif item.command in LOOKS:
            none = item.command == mavlink.MAV_CMD_DO_SET_ROI_NONE
            x, y = (0, 0) if none else (item.x, item.y)
            self._events.look_at(x * 1e-7, y * 1e-7)
        return seq + 1

    def _behaviour(self, item: EmulatedMissionItem) -> GuidanceBehaviour:
        manoeuvres = self._makers.manoeuvres
        if item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return self._makers.go_home()
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            return manoeuvres.land()
        if item.command == mavlink.MAV_CMD_NAV_DELAY:
            return manoeuvres.hold()
        position = self._position(item)
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            return manoeuvres.take_off(position[2])
        if item.command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            return manoeuvres.stay_at(position, yaw_deg=item.params[3])
        return manoeuvres.waypoint(position, yaw_deg=_yaw_deg(item))


def starts_with_takeoff(items: tuple[EmulatedMissionItem, ...]) -> bool:
    """Return whether the mission's first flown item is a takeoff."""
    flown = (item.command for item in items if item.command in FLOWN)
    return bool(next(flown, None) == mavlink.MAV_CMD_NAV_TAKEOFF)


def mission_item_position(item: EmulatedMissionItem, state: AutopilotState) -> Vec3:
    """Return a mission item's position; latitude and longitude of zero mean the present ones."""
    altitude_m = item.z
    if item.frame in RELATIVE_ALTITUDE_FRAMES:
        altitude_m += state.frame.altitude_m - state.home_down_m
    latitude_deg, longitude_deg = item.x * 1e-7, item.y * 1e-7
    if item.x == 0 and item.y == 0:
        here = state.frame.to_geodetic(state.now.position_ned_m)
        latitude_deg, longitude_deg = here.latitude_deg, here.longitude_deg
    return state.frame.to_ned(latitude_deg, longitude_deg, altitude_m)


def _yaw_deg(item: EmulatedMissionItem) -> float:
    """Return the heading that a mission item asks for, degrees; NaN for none."""
    has_yaw = item.command != mavlink.MAV_CMD_NAV_LOITER_TO_ALT
    return item.params[3] if has_yaw else math.nan


def mission_stay_s(item: EmulatedMissionItem) -> float:
    """Return how long to stay at a mission item, by its first parameter."""
    stay = item.params[0] * _STAYS.get(item.command, 0.0)
    return max(0.0, stay)
