"""Why a run passed: what had to hold, how much room was left, and where it was tightest; pure."""

from collections.abc import Iterator, Sequence

from wil_campaign.orchestrator.model.results import RunResult
from wil_campaign.orchestrator.report.model import Margin, Success
from wil_campaign.orchestrator.report.reading.cause import tightest_in_view
from wil_campaign.orchestrator.report.words import limit_text, number_text, short_time
from wil_campaign.safety.model.oracle_results import OracleResult

_MOST = 6


def success_of(result: RunResult, *, goal_s: float | None) -> Success | None:
    """Return why a run passed; None for other verdicts."""
    if result.verdict != "PASS":
        return None
    required = [one for one in result.oracles if one.required]
    measured = [one for one in required if one.margin is not None and one.actual is not None]
    measured.sort(key=lambda one: (one.unit != "m", one.margin or 0.0))
    is_one = len(required) == 1
    sentence = (
        "The required check held." if is_one else f"All {len(required)} required checks held."
    )
    tight = tightest_in_view(result)
    if tight is not None:
        sentence += " " + _tightest_text(tight, goal_s)
    return Success(sentence, tuple(_margins(measured[:_MOST])))


def _tightest_text(oracle: OracleResult, goal_s: float | None) -> str:
    margin = number_text(oracle.margin, oracle.unit, 2)
    when = "" if oracle.at_s is None else f", at {short_time(oracle.at_s, goal_s)}"
    where = f", {oracle.detail}" if oracle.detail else ""
    return f"The tightest was {oracle.name}, with {margin} to spare{when}{where}."


def _margins(oracles: Sequence[OracleResult]) -> Iterator[Margin]:
    for one in oracles:
        yield Margin(
            name=one.name,
            measured=number_text(one.actual, one.unit, 2),
            limit=limit_text(one),
            margin=number_text(one.margin, one.unit, 2),
            at_s=one.at_s,
        )
