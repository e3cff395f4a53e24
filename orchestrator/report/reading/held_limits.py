"""The limits of a campaign's oracles and when they hold, from the campaign file as flown; pure.

Only limits that must hold throughout an interval, as each kind of oracle says them (`limits`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from wil_campaign.foundation.files.documents import Data
from wil_campaign.orchestrator.report.model import PlotLimit, Point
from wil_campaign.safety.oracles.oracle import OracleSpec, SignalLimit
from wil_campaign.safety.oracles.registry import oracle_kinds, own_oracle_keys


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
        keys = (kind for key, kind in own_oracle_keys().items() if key in part)
        spec = oracle_kinds().get(next(keys, str(part.get("use", name))))
        span_s = None if spec is None else _window(spec, part, stages, end_s)
        if spec is not None and span_s is not None:
            vehicle, air_s = str(part.get("vehicle") or subject), _in_the_air(span_s, stages)
            for limit in spec.limits(part):
                found += [
                    replace(held_limit, vehicle=vehicle)
                    for held_limit in _place_limit(name, limit, span_s, air_s)
                ]
    return tuple(found)


def _window(
    spec: OracleSpec, part: Mapping[str, Data], stages: Mapping[str, float], end_s: float
) -> Point | None:
    """Return the window of an oracle; None where it never began."""
    begin_s = stages.get(str(part.get("from") or spec.window.first))
    last_s = stages.get(str(part.get("to") or spec.window.last), end_s)
    return None if begin_s is None or last_s <= begin_s else (begin_s, last_s)


def _in_the_air(span_s: Point, stages: Mapping[str, float]) -> Point | None:
    """Return the part of a window in which lower limits hold: from at_height to the landing."""
    begin_s = max(span_s[0], stages.get("at_height", span_s[0]))
    last_s = min(span_s[1], stages.get("land", span_s[1]))
    return (begin_s, last_s) if last_s > begin_s else None


def _place_limit(
    name: str, held: SignalLimit, span_s: Point, air_s: Point | None
) -> Iterator[HeldLimit]:
    """Yield a limit with its span; none where it holds nowhere. air_s: where the vehicle is up."""
    from_s, until_s = held.from_s, held.until_s
    begin_s = span_s[0] + from_s
    end_s = span_s[1] if until_s is None else min(span_s[1], span_s[0] + until_s)
    within_s = air_s if held.in_the_air else (begin_s, end_s)
    if within_s is not None and end_s > begin_s:
        yield HeldLimit(
            oracle=name,
            signal=held.signal,
            value=held.value,
            is_upper=held.is_upper,
            span_s=within_s,
            is_whole=from_s == 0.0 and until_s is None,
            text=held.text,
        )
