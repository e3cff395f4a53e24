"""Flying an uploaded mission: its items one after the other."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from vehicles.embedded.autopilot.flight.autopilot_state import State
from vehicles.embedded.autopilot.flight.guidance import Behaviour
from vehicles.embedded.autopilot.flight.manoeuvres import Manoeuvres
from vehicles.embedded.autopilot.flight.mission_items import Item
from vehicles.embedded.autopilot.flight.setpoint_targets import RELATIVE_ALTITUDE_FRAMES
from vehicles.embedded.physics.controller import Target
from vehicles.embedded.physics.states import Motion
from worlds.frames import Vec3

FLOWN = {
    mavlink.MAV_CMD_NAV_WAYPOINT,
    mavlink.MAV_CMD_NAV_TAKEOFF,
    mavlink.MAV_CMD_NAV_LAND,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    mavlink.MAV_CMD_NAV_LOITER_TIME,
}
"""Commands of a mission that are flown; others are taken and passed over at once."""


class Step(NamedTuple):
    """One item to fly: its place in the mission, and how long to stay."""

    seq: int
    make: Callable[[], Behaviour]
    stay_s: float


class FlyMission(Behaviour):
    """Fly steps in order; after the last one stay. `reached` is told each seq."""

    def __init__(self, *, steps: tuple[Step, ...], reached: Callable[[int], None]) -> None:
        super().__init__()
        self._steps = steps
        self._reached = reached
        self._at = 0
        self._current = steps[0].make()
        self._arrived_s: float | None = None

    @property
    def seq(self) -> int:
        """Return the item being flown."""
        return self._steps[self._at].seq

    @property
    def lifts(self) -> bool:
        """Return whether the present item does."""
        return self._current.lifts

    @property
    def descends(self) -> bool:
        """Return whether the present item does."""
        return self._current.descends

    def update(self, now: Motion, t_s: float) -> Target:
        """Return the target of the present item, going on to the next when it is done."""
        target = self._current.update(now, t_s)
        if self._current.done and not self.done:
            if self._arrived_s is None:
                self._arrived_s = t_s
            if t_s - self._arrived_s >= self._steps[self._at].stay_s:
                self._next()
        return target

    def _next(self) -> None:
        self._reached(self.seq)
        self._arrived_s = None
        if self._at + 1 < len(self._steps):
            self._at += 1
            self._current = self._steps[self._at].make()
        else:
            self.done = True


def steps_of(
    items: tuple[Item, ...],
    *,
    first: int,
    state: State,
    manoeuvres: Manoeuvres,
    go_home: Callable[[], Behaviour],
) -> tuple[Step, ...]:
    """Return the steps of a mission from item `first` on; items that are not flown are left out."""

    def behaviour(item: Item) -> Behaviour:
        if item.command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return go_home()
        if item.command == mavlink.MAV_CMD_NAV_LAND:
            return manoeuvres.land()
        north, east, down = _place(item, state)
        if item.command == mavlink.MAV_CMD_NAV_TAKEOFF:
            return manoeuvres.take_off(down)
        return manoeuvres.waypoint((north, east, down))

    return tuple(
        Step(seq, partial(behaviour, item), stay_s(item))
        for seq, item in enumerate(items)
        if seq >= first and item.command in FLOWN
    )


def _place(item: Item, state: State) -> Vec3:
    """Return where an item is; latitude and longitude of zero mean the present place."""
    altitude_m = item.z
    if item.frame in RELATIVE_ALTITUDE_FRAMES:
        altitude_m += state.frame.altitude_m - state.home_down_m
    north, east, down = state.frame.to_ned(item.x * 1e-7, item.y * 1e-7, altitude_m)
    if item.x == 0 and item.y == 0:
        north, east, _ = state.now.position_ned_m
    return (north, east, down)


def stay_s(item: Item) -> float:
    """Return how long to stay at an item: param1 of waypoints and of loiter by time."""
    timed = {mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LOITER_TIME}
    stay = item.params[0]
    return stay if item.command in timed and stay > 0.0 else 0.0
