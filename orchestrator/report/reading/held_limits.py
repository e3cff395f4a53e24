"""The limits of a campaign's oracles and when they hold, from the campaign file as flown; pure.

Only limits that must hold throughout an interval: of a formula the comparisons of a signal with a
number under `always` and `and`. A condition that may hold at some time has no limit line.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from orchestrator.report.model import PlotLimit, Point
from safety.oracles import registry
from safety.stl.arithmetic import limit_side, written
from safety.stl.formula import Comparison, Formula, Junctor, Name, Number, StlError, Temporal
from safety.stl.parser import parse_stl
from worlds.files.documents import Data

_SPEEDS = {
    "total": "speed_m_s",
    "horizontal": "ground_speed_m_s",
    "vertical": "vertical_speed_m_s",
}


@dataclass(frozen=True, slots=True)
class HeldLimit:
    """A limit of an oracle. signal: its name in formulas; text: the comparison of a formula.

    span_s: when it holds, run clock. is_whole: whether that is the oracle's whole window. vehicle:
    the judged one.
    """

    oracle: str
    signal: str
    value: float
    is_upper: bool
    span_s: Point
    is_whole: bool = True
    text: str = ""
    vehicle: str = ""

    @property
    def line(self) -> PlotLimit:
        """Return the limit as a plot draws it."""
        return PlotLimit(self.value, self.is_upper, self.span_s)

    def excess(self, value: float) -> float:
        """Return by how much a value is beyond the limit; negative inside."""
        return value - self.value if self.is_upper else self.value - value


def held_limits(
    oracles: Mapping[str, Data], stages: Mapping[str, float], end_s: float, subject: str
) -> tuple[HeldLimit, ...]:
    """Return the limits of the campaign file's oracles.

    stages: when each was reached. subject: the vehicle of oracles that name none.
    """
    found: list[HeldLimit] = []
    for name, given in oracles.items():
        part = given if isinstance(given, dict) else {}
        kind = "stl" if "stl" in part else str(part.get("use", name))
        span_s = _window(kind, part, stages, end_s)
        if span_s is not None:
            vehicle = str(part.get("vehicle") or subject)
            held = _limits(name, kind, part, span_s, _in_the_air(span_s, stages))
            found += [replace(one, vehicle=vehicle) for one in held]
    return tuple(found)


def _window(
    kind: str, part: Mapping[str, Data], stages: Mapping[str, float], end_s: float
) -> Point | None:
    """Return the window of an oracle; None where it never began, or its kind is not known."""
    spec = registry.get(kind)
    if spec is None:
        return None
    begin_s = stages.get(str(part.get("from") or spec.window.first))
    last_s = stages.get(str(part.get("to") or spec.window.last), end_s)
    return None if begin_s is None or last_s <= begin_s else (begin_s, last_s)


def _in_the_air(span_s: Point, stages: Mapping[str, float]) -> Point | None:
    """Return the part of a window in which lower limits hold: from at_height to the landing."""
    begin_s = max(span_s[0], stages.get("at_height", span_s[0]))
    last_s = min(span_s[1], stages.get("land", span_s[1]))
    return (begin_s, last_s) if last_s > begin_s else None


def _limits(
    name: str, kind: str, part: Mapping[str, Data], span_s: Point, air_s: Point | None
) -> Iterator[HeldLimit]:
    if kind == "stl":
        yield from _limits_of_formula(name, str(part.get("stl")), span_s)
        return
    signal, low, high = _band(kind, part)
    if signal and high is not None:
        yield HeldLimit(name, signal, high, is_upper=True, span_s=span_s)
    # During takeoff and landing a vehicle is below its lower limits.
    low_s = span_s if kind == "distance" else air_s
    if signal and low is not None and low_s is not None:
        yield HeldLimit(name, signal, low, is_upper=False, span_s=low_s)


def _band(kind: str, part: Mapping[str, Data]) -> tuple[str, float | None, float | None]:
    """Return the signal that an oracle of a kind judges, and its lower and upper limit."""
    match kind:
        case "altitude":
            return "up_m", _number(part, "min_m"), _number(part, "max_m")
        case "speed":
            signal = _SPEEDS.get(str(part.get("axis", "total")), "")
            return signal, _number(part, "min_m_s"), _number(part, "max_m_s")
        case "distance":
            return (
                f"distance to {part.get('object')}",
                _number(part, "min_m"),
                _number(part, "max_m"),
            )
        case "clearance":
            return "clearance_m", _number(part, "min_m"), None
        case "geofence":
            return "fence_margin_m", 0.0, None
    return "", None, None


def _number(part: Mapping[str, Data], key: str) -> float | None:
    value = part.get(key)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number and isinstance(value, int | float) else None


def _limits_of_formula(name: str, text: str, window_s: Point) -> Iterator[HeldLimit]:
    try:
        formula = parse_stl(text)
    except (StlError, RecursionError):
        return
    for comparison, from_s, until_s in _always(formula, 0.0, 0.0):
        measured, limit = limit_side(comparison)
        begin_s = window_s[0] + from_s
        end_s = window_s[1] if until_s is None else min(window_s[1], window_s[0] + until_s)
        if isinstance(measured, Name) and isinstance(limit, Number) and end_s > begin_s:
            is_left = measured is comparison.left
            yield HeldLimit(
                oracle=name,
                signal=measured.name,
                value=limit.value,
                is_upper=(comparison.comparator in {"<=", "<"}) == is_left,
                span_s=(begin_s, end_s),
                is_whole=from_s == 0.0 and until_s is None,
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
