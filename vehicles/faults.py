"""Injected faults of a vehicle and of its signals: their kinds, times and text form.

Campaigns (`faults:`), `wil-campaign vehicle --fault` and `mock_vehicle` have these in common.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar, cast, get_args

T = TypeVar("T")

FaultKind = Literal["stop", "freeze"]
"""What happens to a signal. stop: no value is passed; freeze: its last value is repeated."""
FaultName = Literal["kill", "mute", "unmute", "motor", "pose_source", "estimate", "camera"]

LATEST_S = 86_400
"""The latest begin of a fault, after its reference time."""
LONGEST_S = 3600
"""The longest duration of a temporary fault."""

_SIGNALS = frozenset({"pose_source", "estimate", "camera"})
_FOR_GOOD = frozenset({"kill", "unmute"})
_MOTORS = 4
_MOST_THRUST = 2.0
_MOMENT = re.compile(r"([0-9.]+)(?:\+([0-9.]+))?")
_THERE_ARE = (
    "there are kill, mute, unmute, motor [0..3 [0.0..2.0]], pose_source stop|freeze, estimate "
    "stop|freeze, camera stop|freeze; NAME@AFTER_S begins it later (0 to 86400 s), "
    "NAME@AFTER_S+FOR_S ends it as well (up to 3600 s; not kill, unmute)"
)

Restamp = Callable[[T, T], T]
"""Returns an old value with the times and number of a new one."""


class FaultTextError(ValueError):
    """A text is not a fault to inject; says which there are."""


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """A fault to inject into a vehicle.

    motor: 0 to 3, PX4's order. factor: the remaining fraction of its thrust. kind: of a signal's
    fault. after_s: how long after the injection it begins. for_s: how long it lasts; None: for
    good.
    """

    name: FaultName
    motor: int = 0
    factor: float = 0.0
    kind: FaultKind | None = None
    after_s: float = 0.0
    for_s: float | None = None

    def __str__(self) -> str:
        """Return the fault as a text that `parse_fault` reads."""
        what: str = self.name
        if self.name == "motor":
            what += f" {self.motor} {self.factor}"
        elif self.kind is not None:
            what += f" {self.kind}"
        if self.for_s is not None:
            return f"{what}@{_digits(self.after_s)}+{_digits(self.for_s)}"
        return f"{what}@{_digits(self.after_s)}" if self.after_s else what


def parse_fault(text: str) -> InjectedFault:
    """Return the fault in a text: "kill", "mute@5+2", "motor 2 0.5@12". Raises FaultError."""
    what, at, moment = text.partition("@")
    name, *rest = what.split() or [""]
    after_s, for_s = _parse_moment(text, moment.strip()) if at else (0.0, None)
    if for_s is not None and name in _FOR_GOOD:
        raise _unknown_fault(text)
    if name == "motor":
        motor, factor = _parse_motor(text, rest)
        return InjectedFault("motor", motor, factor, after_s=after_s, for_s=for_s)
    if name in _SIGNALS and len(rest) == 1 and rest[0] in get_args(FaultKind):
        kind = cast("FaultKind", rest[0])
        return InjectedFault(cast("FaultName", name), kind=kind, after_s=after_s, for_s=for_s)
    if name in get_args(FaultName) and name not in _SIGNALS and not rest:
        return InjectedFault(cast("FaultName", name), after_s=after_s, for_s=for_s)
    raise _unknown_fault(text)


def _parse_motor(text: str, rest: list[str]) -> tuple[int, float]:
    """Return motor and factor of a fault's words: the first motor, stopped, without them."""
    try:
        motor = int(rest[0]) if rest else 0
        factor = float(rest[1]) if len(rest) > 1 else 0.0
    except ValueError:
        raise _unknown_fault(text) from None
    if len(rest) > 2 or not (0 <= motor < _MOTORS and 0.0 <= factor <= _MOST_THRUST):
        raise _unknown_fault(text)
    return motor, factor


def _parse_moment(text: str, moment: str) -> tuple[float, float | None]:
    """Return after_s and for_s of a fault's moment. Raises FaultError."""
    match = _MOMENT.fullmatch(moment)
    try:
        after_s = float(match[1]) if match else math.nan
        for_s = float(match[2]) if match and match[2] else None
    except ValueError:
        raise _unknown_fault(text) from None
    if not after_s <= LATEST_S or not (for_s is None or 0.0 < for_s <= LONGEST_S):
        raise _unknown_fault(text)
    return after_s, for_s


def _unknown_fault(text: str) -> FaultTextError:
    return FaultTextError(f"{text!r} is not a fault; {_THERE_ARE}")


def _digits(seconds: float) -> str:
    return f"{seconds:.9f}".rstrip("0").rstrip(".")


class FaultySignal(Generic[T]):
    """Passes the values of a signal, except while it is stopped or frozen; pure."""

    def __init__(self, restamp: Restamp[T]) -> None:
        self._restamp = restamp
        self._last: T | None = None
        self.fault: FaultKind | None = None
        """The present fault of the signal."""

    def passed(self, value: T) -> T | None:
        """Return the value to pass on in place of a value; None for none."""
        if self.fault is None:
            self._last = value
            return value
        if self.fault == "stop" or self._last is None:
            return None
        return self._restamp(self._last, value)
