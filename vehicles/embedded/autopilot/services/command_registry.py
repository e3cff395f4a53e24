"""COMMAND_LONG and COMMAND_INT as one type, and decorators that register their handlers."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.places import (
    int32_of_float,
    is_altitude,
    is_on_globe,
)

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
TEMPORARILY_REJECTED: int = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED: int = mavlink.MAV_RESULT_DENIED
UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED
FAILED: int = mavlink.MAV_RESULT_FAILED

FORCE_ARM = 2989.0
"""ArduPilot's param2 of an arm command that skips the checks (AP_Arming)."""
FORCE_DISARM = 21196.0
"""param2 that disarms in flight (common.xml); ArduPilot accepts it for forced arming as well."""

_INT_UNSET = 2**31 - 1


class ReceivedCommand(NamedTuple):
    """A received MAVLink command; x, y: degrees for a global position, NaN when not given."""

    number: int
    params: tuple[float, float, float, float]
    x: float
    y: float
    z: float
    frame: int | None
    """MAV_FRAME of a COMMAND_INT; None of a COMMAND_LONG."""
    from_system: int
    from_component: int

    def whole(self, index: int) -> int:
        """Return a command's parameter (0 to 3) as the integer that a firmware casts it to."""
        return int32_of_float(self.params[index])

    @property
    def has_place(self) -> bool:
        """Return whether the command's x, y, z are latitude, longitude and altitude."""
        return is_on_globe(self.x, self.y) and is_altitude(self.z)


def command_from_long(message: Any) -> ReceivedCommand:
    """Return the command in a COMMAND_LONG."""
    return ReceivedCommand(
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        message.param5,
        message.param6,
        message.param7,
        None,
        message.get_srcSystem(),
        message.get_srcComponent(),
    )


def command_from_int(message: Any) -> ReceivedCommand:
    """Return the command in a COMMAND_INT."""
    return ReceivedCommand(
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        math.nan if message.x == _INT_UNSET else message.x * 1e-7,
        math.nan if message.y == _INT_UNSET else message.y * 1e-7,
        message.z,
        message.frame,
        message.get_srcSystem(),
        message.get_srcComponent(),
    )


Handler = TypeVar("Handler", bound=Callable[..., Any])


def on_command(*numbers: int) -> Callable[[Handler], Handler]:
    """Register a method of a part of an autopilot as the handler of these commands."""

    def mark(handler: Handler) -> Handler:
        handler.__dict__["mav_commands"] = numbers
        return handler

    return mark


def on_message(*names: str) -> Callable[[Handler], Handler]:
    """Register a method of a part of an autopilot as the handler of these messages."""

    def mark(handler: Handler) -> Handler:
        handler.__dict__["mav_messages"] = names
        return handler

    return mark


def on_request(*message_ids: int) -> Callable[[Handler], Handler]:
    """Register a method of a part of an autopilot as the builder of these requested messages."""

    def mark(handler: Handler) -> Handler:
        handler.__dict__["mav_requests"] = message_ids
        return handler

    return mark


def registered_handlers(part: object, mark: str) -> dict[Any, Callable[..., Any]]:
    """Return the registered methods of a part, bound, by what they handle."""
    return {key: getattr(part, name) for key, name in marked_methods(type(part), mark).items()}


def marked_methods(kind: type, mark: str) -> dict[Any, str]:
    """Return the registered methods of a class and its bases: key to name of the method.

    A subclass overrides by marking the same key. Raises ValueError when one class marks a key
    twice.
    """
    methods: dict[Any, str] = {}
    for base in reversed(kind.__mro__):
        own: dict[Any, str] = {}
        for name, member in vars(base).items():
            for key in getattr(member, "__dict__", {}).get(mark, ()):
                if key in own:
                    raise ValueError(f"{base.__name__} handles {key} twice: {own[key]}, {name}")
                own[key] = name
        methods.update(own)
    return methods
