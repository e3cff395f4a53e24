"""Texts of numbers, limits, times and positions; pure."""

import math

from wil_campaign.safety.model.oracle_results import Limit, OracleResult
from wil_campaign.worlds.frames import Vec3

NOTHING = "\N{EN DASH}"
MODES = {
    "sim": "the twin alone, in the virtual world",
    "wil": "the real vehicle and its twin; the autonomy perceives the mixture of their readings",
    "real": "the real vehicle alone, in the real world",
}
"""The vehicles and worlds of each mode."""


def number_text(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a number with its unit; a dash for none.

    Metres of two digits keep theirs, as in the terminal's table: 0.10 m.
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    if abs(value) >= 1e6 or 0.0 < abs(value) < 10.0**-digits:
        text = f"{value:.3g}"
    else:
        text = f"{value:.{1 if abs(value) >= 100.0 and digits else digits}f}"
        if "." in text and (unit, digits) != ("m", 2):
            text = text.rstrip("0").rstrip(".")
    return f"{text} {unit}".rstrip()


def limit_text(result: OracleResult) -> str:
    """Return the limit of an oracle: at most, at least, or between; a dash for none."""
    unit, limit = result.unit, result.limit
    if limit is None:
        return NOTHING
    if isinstance(limit, tuple):
        low, high = limit
        if low is None:
            return f"at most {number_text(high, unit)}"
        if high is None:
            return f"at least {number_text(low, unit)}"
        return f"{number_text(low)} to {number_text(high, unit)}"
    return f"{_direction(result, limit)}{number_text(limit, unit)}"


def _direction(result: OracleResult, limit: Limit) -> str:
    """Return whether a single limit is upper or lower, derived from the margin's sign."""
    actual, margin = result.actual, result.margin
    if actual is None or margin is None or not isinstance(limit, float) or actual == limit:
        return ""
    return "at most " if (actual < limit) == (margin > 0.0) else "at least "


def time_text(t_s: float | None, goal_s: float | None) -> str:
    """Return a time relative to the moment when the goal was given."""
    if t_s is None or not math.isfinite(t_s):
        return NOTHING
    if goal_s is None:
        return f"{t_s:.2f} s on the run clock"
    since_s = t_s - goal_s
    word = "after" if since_s >= 0.0 else "before"
    return f"{abs(since_s):.2f} s {word} the goal was given"


def short_time(t_s: float | None, goal_s: float | None) -> str:
    """Return a signed time relative to the goal, for tables."""
    if t_s is None or not math.isfinite(t_s):
        return NOTHING
    return f"{t_s:.2f} s" if goal_s is None else f"{t_s - goal_s:+.2f} s"


def run_count_text(count: int) -> str:
    """Return a number of runs."""
    return f"{count} run" if count == 1 else f"{count} runs"


def place_text(position_ned_m: Vec3 | None) -> str:
    """Return a position by its axes."""
    if position_ned_m is None:
        return NOTHING
    north_m, east_m, down_m = position_ned_m
    axes = (("north", north_m), ("east", east_m), ("up", -down_m))
    return ", ".join(f"{name} {_unsigned_zero(value):.2f} m" for name, value in axes)


def velocity_text(velocity_ned_m_s: Vec3 | None) -> str:
    """Return a velocity by its axes."""
    if velocity_ned_m_s is None:
        return NOTHING
    north, east, down = velocity_ned_m_s
    axes = (("north", north), ("east", east), ("up", -down))
    return ", ".join(f"{name} {_unsigned_zero(value):+.2f}" for name, value in axes) + " m/s"


def _unsigned_zero(value: float) -> float:
    """Return a number without the sign of a rounded zero."""
    return 0.0 if abs(value) < 0.005 else value
