"""What a campaign may set of the gate autonomy."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from campaigns.api import NAMED_COLORS


@dataclass(frozen=True, slots=True)
class GateParameters:
    """The parameters of the gate autonomy: what may stand under `with`.

    speed_m_s, acceleration_m_s2: ahead. side_speed_m_s: most that is asked sideways, up and down;
    kp, ki, kd: their controllers. past_m: how far behind the gate to stop. color: of the gate.
    lost_s: without a sight of the gate it stops after this time; search_timeout_s: then it says
    that it gave up, and hovers. cone: how far beside the line it may be at full speed, per metre
    to the gate (and its width). commit_widths: how far at most when it enters. camera_stabilized:
    a gimbal keeps the camera level.
    """

    speed_m_s: float = 0.8
    acceleration_m_s2: float = 0.8
    side_speed_m_s: float = 0.5
    kp: float = 1.2
    ki: float = 0.06
    kd: float = 0.15
    past_m: float = 0.6
    color: str = "orange"
    lost_s: float = 0.5
    search_timeout_s: float = 15.0
    cone: float = 0.12
    commit_widths: float = 0.15
    camera_stabilized: bool = False


_MAY_BE_ZERO = {"ki", "kd"}


def parse_parameters(given: Mapping[str, object]) -> GateParameters:
    """Return the gate autonomy's parameters. Raises ValueError listing unknown or wrong ones."""
    known = {field.name: field.type for field in fields(GateParameters)}
    faults = [
        f"unknown parameter '{name}' (known: {', '.join(known)})"
        for name in given
        if name not in known
    ]
    faults += [
        fault
        for name, value in given.items()
        if name in known and (fault := _fault(name, value, known[name]))
    ]
    if faults:
        raise ValueError("gate autonomy: " + "; ".join(faults))
    return GateParameters(**given)  # type: ignore[arg-type]  # checked above, name by name


def parse_goal(goal: Mapping[str, object]) -> float:
    """Return the altitude (m) of the gate autonomy's search. Raises ValueError without one."""
    altitude_m = goal.get("altitude_m")
    if fault := _fault("altitude_m", altitude_m, float):
        raise ValueError(f"gate autonomy: goal: {fault}")
    return float(altitude_m)  # type: ignore[arg-type]  # checked above


def _fault(name: str, value: object, kind: object) -> str:
    """Return what is wrong with the value of a gate parameter; "" when nothing is."""
    if kind is bool:
        return "" if isinstance(value, bool) else f"{name} must be true or false, is {value!r}"
    if kind is str:
        known = ", ".join(NAMED_COLORS)
        return "" if value in NAMED_COLORS else f"{name} must be one of {known}, is {value!r}"
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return f"{name} must be a number, is {value!r}"
    least = "at least 0" if name in _MAY_BE_ZERO else "greater than 0"
    return "" if value > 0 or (value == 0 and name in _MAY_BE_ZERO) else f"{name} must be {least}"
