"""Checks what oracles return: those of plugins may return anything."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, get_args

from wil_campaign.safety.model.oracle_results import Flag, OracleResult, OracleVerdict
from wil_campaign.safety.oracles.oracle import Oracle

_VERDICTS: tuple[str, ...] = get_args(OracleVerdict)


def checked_result(oracle: Oracle, result: Any) -> OracleResult:
    """Return the result of an oracle, perhaps of a plugin, as results files hold it.

    With Python's numbers, INVALID where its value, margin or time is not finite. Raises TypeError
    and ValueError for a result of another form, or of another oracle.
    """
    if not isinstance(result, OracleResult):
        raise TypeError(f"its result is a {type(result).__name__}, not an OracleResult")
    of = (result.name, result.vehicle, result.required)
    if of != (oracle.name, oracle.vehicle, oracle.required):
        raise ValueError(f"its result is of another oracle: name, vehicle, required are {of}")
    if result.verdict not in _VERDICTS:
        raise ValueError(f"its verdict is {result.verdict!r}, not one of {', '.join(_VERDICTS)}")
    if not (isinstance(result.detail, str) and isinstance(result.unit, str)):
        raise TypeError("its detail or unit is no text")
    actual, margin, at_s = map(_number, (result.actual, result.margin, result.at_s))
    limit = result.limit
    low, high = map(_number, limit) if isinstance(limit, tuple) else (None, _number(limit))
    if not all(math.isfinite(one) for one in (low, high) if one is not None):
        raise ValueError(f"its limit {limit} is not finite; None stands for no limit")
    if not all(math.isfinite(one) for one in (actual, margin, at_s) if one is not None):
        return oracle.invalid(
            f"it got a value that is not finite (value {actual}, margin {margin})"
        )
    shown = (low, high) if isinstance(limit, tuple) else high
    return replace(result, actual=actual, margin=margin, at_s=at_s, limit=shown)


def checked_flags(flags: Iterable[Any]) -> list[Flag]:
    """Return the flags of an oracle, perhaps of a plugin. Raises TypeError, ValueError."""
    if not isinstance(flags, Iterable):
        raise TypeError(f"it returned a {type(flags).__name__}, not a sequence of flags")
    found = list(flags)
    for flag in found:
        if not isinstance(flag, Flag) or not isinstance(flag.text, str):
            raise TypeError(f"it returned {flag!r}, not a Flag with a text")
        if not math.isfinite(flag.t_s):
            raise ValueError(f"its flag {flag.text!r} is of {flag.t_s} s")
    return found


def _number(value: Any) -> float | None:
    """Return a number of an oracle as Python's, which results files hold. Raises TypeError."""
    if value is None or type(value) in {int, float, bool}:
        return value  # type: ignore[no-any-return]
    if isinstance(value, str | bytes):
        raise TypeError(f"its result has {value!r} in place of a number")
    return float(value)
