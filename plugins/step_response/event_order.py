"""Compares the order of modes, arming, takeoff and landing with the firmware's; pure.

The expected order is that of the reference traces of both firmwares (see docs/vehicle.md).
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import Autopilot, FlightMode, MavlinkTarget
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

_LANDED = {
    mavlink.MAV_LANDED_STATE_ON_GROUND: "on the ground",
    mavlink.MAV_LANDED_STATE_TAKEOFF: "taking off",
    mavlink.MAV_LANDED_STATE_IN_AIR: "in the air",
    mavlink.MAV_LANDED_STATE_LANDING: "landing",
}
_ARMED, _DISARMED = "armed", "disarmed"
_ACKNOWLEDGED = "acknowledged"
_MODES: dict[str, tuple[FlightMode, ...]] = {
    "px4": (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.GUIDED, FlightMode.LAND),
    "ardupilot": (FlightMode.GUIDED, FlightMode.LAND),
}
"""While armed. PX4 holds when its takeoff is over; ArduCopter takes off in GUIDED."""
_LANDED_STATES = ("on the ground", "taking off", "in the air", "landing", "on the ground")
_ARM = frozenset({mavlink.MAV_CMD_COMPONENT_ARM_DISARM})
_TAKEOFF = frozenset({mavlink.MAV_CMD_NAV_TAKEOFF})
_MODE = frozenset({mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_NAV_LAND})


class EventOccurrence(NamedTuple):
    """An event of a vehicle: the arrival time of its message, and its name.

    command: of an acknowledgement; 0 otherwise.
    """

    t_s: float
    name: str
    command: int = 0


class OrderRow(NamedTuple):
    """An order of events: of the firmware, and of this vehicle."""

    name: str
    firmware: tuple[str, ...]
    flown: tuple[str, ...]

    @property
    def beyond(self) -> bool:
        """Return whether the vehicle's order differs."""
        return self.firmware != self.flown


class EventTrace:
    """Collects a vehicle's events out of the bytes of its link."""

    def __init__(self, *, autopilot: Autopilot, target: MavlinkTarget) -> None:
        self._autopilot = autopilot
        self._target = target
        self._codec = MavlinkCodec(system_id=target.system, component_id=target.component)
        self._last: dict[str, str] = {}
        self.events: list[EventOccurrence] = []

    def receive(self, data: bytes, t_s: float) -> None:
        """Take bytes of the link that arrived at a time."""
        for message in self._codec.parse(data):
            source = (message.get_srcSystem(), message.get_srcComponent())
            if source == (self._target.system, self._target.component):
                self.receive_message(message, t_s)

    def receive_message(self, message: Any, t_s: float) -> None:
        """Take a message of the vehicle."""
        match message.get_type():
            case "HEARTBEAT":
                armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
                self._append_change("armed", _ARMED if armed else _DISARMED, t_s)
                self._append_change("mode", self._autopilot.mode_of(message.custom_mode).value, t_s)
            case "EXTENDED_SYS_STATE":
                if message.landed_state in _LANDED:
                    self._append_change("landed", _LANDED[message.landed_state], t_s)
            case "COMMAND_ACK":
                if message.result == mavlink.MAV_RESULT_ACCEPTED:
                    self.events.append(EventOccurrence(t_s, _ACKNOWLEDGED, message.command))

    def _append_change(self, kind: str, name: str, t_s: float) -> None:
        if self._last.get(kind) != name:
            self._last[kind] = name
            self.events.append(EventOccurrence(t_s, name))


def order_rows(events: Sequence[EventOccurrence], autopilot: str) -> list[OrderRow]:
    """Return the orders of a flight from before its arming to after its disarming."""
    modes = tuple(mode.value for mode in _MODES[autopilot])
    guided, land = FlightMode.GUIDED.value, FlightMode.LAND.value
    return [
        OrderRow("modes", modes, _modes(events, autopilot)),
        OrderRow("landed states", _LANDED_STATES, _landed_states(events)),
        _effect_order("arming", events, _ARM, _ARMED),
        _effect_order("takeoff", events, _TAKEOFF, "taking off"),
        _effect_order(guided, events, _MODE, guided),
        _effect_order(land, events, _MODE, land),
        _end_order(events),
    ]


def _modes(events: Sequence[EventOccurrence], autopilot: str) -> tuple[str, ...]:
    """Return the modes that the vehicle was in while armed, without PX4's hold before takeoff."""
    names = {mode.value for mode in FlightMode}
    mode, seen, armed = "", [], False
    for event in events:
        if event.name in {_ARMED, _DISARMED}:
            armed = event.name == _ARMED
            seen += [mode] if armed and mode else []
        elif event.name in names:
            mode = event.name
            seen += [mode] if armed else []
    # This program arms a PX4 in Hold; in the traces the takeoff was commanded before arming.
    if autopilot == "px4" and seen[:1] == [FlightMode.HOLD.value]:
        del seen[0]
    return tuple(seen)


def _landed_states(events: Iterable[EventOccurrence]) -> tuple[str, ...]:
    return tuple(event.name for event in events if event.name in _LANDED.values())


def _effect_order(
    name: str, events: Sequence[EventOccurrence], commands: frozenset[int], effect: str
) -> OrderRow:
    """Return the order of a command's acknowledgement and the first sign of its effect."""
    expected = (_ACKNOWLEDGED, effect)
    done_s = next((event.t_s for event in events if event.name == effect), None)
    acknowledged = [event.t_s for event in events if event.command in commands]
    if done_s is None or not acknowledged:
        there = ((_ACKNOWLEDGED,) if acknowledged else ()) + ((effect,) if done_s else ())
        return OrderRow(name, expected, there)
    nearest_s = min(acknowledged, key=lambda t_s: abs(t_s - done_s))
    return OrderRow(name, expected, expected if nearest_s <= done_s else expected[::-1])


def _end_order(events: Sequence[EventOccurrence]) -> OrderRow:
    expected = ("on the ground", _DISARMED)
    last: dict[str, int] = {
        event.name: place for place, event in enumerate(events) if event.name in expected
    }
    return OrderRow("end", expected, tuple(sorted(last, key=lambda name: last[name])))
