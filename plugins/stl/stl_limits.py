"""The limits that a formula holds: comparisons of a signal with a number, under `always` and `and`.

A condition that may hold at some time has no limit.
"""

from collections.abc import Iterator, Mapping

from wil_campaign.plugins.stl.arithmetic import limit_side, written
from wil_campaign.plugins.stl.formula import (
    Comparison,
    Formula,
    Junctor,
    Name,
    Number,
    StlError,
    Temporal,
)
from wil_campaign.plugins.stl.parser import parse_stl
from wil_campaign.safety.oracles.oracle import SignalLimit
from wil_campaign.worlds.files.documents import Data


def limits_of_formula(part: Mapping[str, Data]) -> Iterator[SignalLimit]:
    """Yield the limits that the formula of an oracle's parameters holds; none for a bad one."""
    try:
        formula = parse_stl(str(part.get("stl")))
    except (StlError, RecursionError):
        return
    for comparison, from_s, until_s in _always(formula, 0.0, 0.0):
        measured, limit = limit_side(comparison)
        if isinstance(measured, Name) and isinstance(limit, Number):
            is_left = measured is comparison.left
            yield SignalLimit(
                signal=measured.name,
                value=limit.value,
                is_upper=(comparison.comparator in {"<=", "<"}) == is_left,
                from_s=from_s,
                until_s=until_s,
                text=written(comparison),
            )


def _always(
    formula: Formula, from_s: float, until_s: float | None
) -> Iterator[tuple[Comparison, float, float | None]]:
    """Yield comparisons that must hold, with the interval in the window; None: to its end."""
    match formula:
        case Comparison():
            yield formula, from_s, until_s
        case Temporal("always", interval, inner):
            is_open = until_s is None or interval.until_s is None
            last_s = None if is_open else (until_s or 0.0) + (interval.until_s or 0.0)
            yield from _always(inner, from_s + interval.from_s, last_s)
        case Junctor("and", left, right):
            yield from _always(left, from_s, until_s)
            yield from _always(right, from_s, until_s)
        case _:
            pass
