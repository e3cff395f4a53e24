"""The objective of a search: the smallest of the oracles' normalised margins; pure.

Margins of different units would mask each other: each is divided by its oracle's limit, or by half
of the width between two limits. So 1 is a margin as large as the limit.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from wil_campaign.campaigns.schema import Mode
from wil_campaign.plugins.search.exploration.model import FlightOutcome, FlownVerdict
from wil_campaign.safety.evaluation.judge import OracleUse
from wil_campaign.safety.model.oracle_results import Limit, OracleResult
from wil_campaign.safety.oracles.registry import oracle_kinds

_EVENTS: Mapping[str, str] = {
    "landed": "",
    "vehicle_fault": "",
    "estimator": "max_unsound_s",
    "modes": "max_changes",
    "twin_divergence": "max_m",
}
"""Kinds of oracles that judge events, and the parameter that nevertheless gives one a margin."""


def lacks_margin(use: OracleUse) -> str:
    """Return why an oracle has no margin; "" where it has one."""
    key = _EVENTS.get(use.kind)
    if key is None or (key and getattr(use.parameters, key)):
        return ""
    remedy = f"give it {key}" if key else "name one that has a limit"
    return f"oracle '{use.name}' judges an event and has no margin: {remedy}"


def fails_no_flight(use: OracleUse, flying: Mapping[Mode, Sequence[str]]) -> str:
    """Return why an oracle cannot fail a flight in one of the modes; "" where it can in all.

    flying: the vehicles that fly in each mode, the subject first.
    """
    given = use.parameters
    if not given.required:
        return f"oracle '{use.name}' is not required and fails no flight: give it required: true"
    for mode, vehicles in flying.items():
        if given.vehicle not in {None, vehicles[0]}:
            return (
                f"oracle '{use.name}' judges {given.vehicle} alone, and mode {mode} is judged by "
                f"{vehicles[0]}: remove its vehicle, or {mode} from the budget"
            )
        if oracle_kinds()[use.kind].needs_pair(given) and len(vehicles) < 2:
            return (
                f"oracle '{use.name}' compares real and twin, and in mode {mode} only "
                f"{vehicles[0]} flies: remove {mode} from the budget"
            )
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchObjective:
    """The objective of a search. oracles: by name. scale: of a margin, in its oracle's unit."""

    oracles: tuple[str, ...]
    scale: Mapping[str, float]

    def value(self, results: Sequence[OracleResult], *, vehicle: str) -> float | None:
        """Return the smallest normalised margin of the vehicle's oracles; None without any."""
        values = [
            result.margin / (self.scale.get(result.name) or margin_divisor(result.limit))
            for result in results
            if result.name in self.oracles
            and result.vehicle == vehicle
            and result.margin is not None
        ]
        return min(values, default=None)

    def outcome(
        self,
        *,
        verdict: FlownVerdict,
        results: Iterable[OracleResult],
        vehicle: str,
        cause: str,
        reason: str,
        duration_s: float,
        wall_s: float,
    ) -> FlightOutcome:
        """Return the outcome of a flight; the value of a failure is 0 at most, whatever failed."""
        value = self.value(tuple(results), vehicle=vehicle)
        if verdict == "FAIL":
            value = 0.0 if value is None else min(value, 0.0)
        elif verdict != "PASS":
            value = None
        return FlightOutcome(
            verdict=verdict,
            value=value,
            cause=cause,
            reason=reason,
            duration_s=duration_s,
            wall_s=wall_s,
        )


def margin_divisor(limit: Limit) -> float:
    """Return the divisor of a margin to a limit; 1 where the limit is 0 or missing."""
    if isinstance(limit, tuple):
        low, high = limit
        if low is not None and high is not None:
            return (high - low) / 2.0 or 1.0
        limit = high if low is None else low
    return abs(limit) if limit else 1.0
