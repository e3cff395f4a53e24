"""Read the parameters of an autonomy into a dataclass of numbers, switches and texts, checked."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar, cast

Kind = TypeVar("Kind")


def read_autonomy_parameters(
    kind: type[Kind],
    given: Mapping[str, object],
    owner: str,
    *,
    may_be_zero: frozenset[str] = frozenset(),
    choices: Mapping[str, Sequence[str]] | None = None,
) -> Kind:
    """Return parameters of a dataclass whose fields have defaults.

    owner: the autonomy's name in messages. may_be_zero: numbers that need not be positive. choices:
    allowed texts by parameter. Raises ValueError listing unknown and wrong parameters.
    """
    known = {field.name: field.default for field in fields(cast("Any", kind))}
    allowed = choices or {}
    faults: list[str] = []
    for name, value in given.items():
        if name not in known:
            faults.append(f"unknown parameter '{name}' (known: {', '.join(known)})")
        elif name in allowed and value not in allowed[name]:
            faults.append(f"{name} must be one of {', '.join(allowed[name])}, is {value!r}")
        elif fault := _fault(value, known[name], is_zero_allowed=name in may_be_zero):
            faults.append(f"{name} must be {fault}, is {value!r}")
    if faults:
        raise ValueError(f"{owner}: " + "; ".join(faults))
    chosen: dict[str, Any] = dict(given)
    return kind(**chosen)


def goal_altitude_m(goal: Mapping[str, object], owner: str) -> float:
    """Return the altitude (m) of a goal. Raises ValueError without one."""
    altitude_m = goal.get("altitude_m")
    if _fault(altitude_m, 1.0, is_zero_allowed=False):
        raise ValueError(f"{owner}: goal: altitude_m must be greater than 0, is {altitude_m!r}")
    return float(str(altitude_m))


def _fault(value: object, default: object, *, is_zero_allowed: bool) -> str:
    """Return what a parameter's value must be; "" where it is valid."""
    if isinstance(default, bool):
        return "" if isinstance(value, bool) else "true or false"
    if isinstance(default, str):
        return "" if isinstance(value, str) else "a text"
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return "a number"
    if value < 0.0 or (value == 0.0 and not is_zero_allowed):
        return "at least 0" if is_zero_allowed else "greater than 0"
    return ""
