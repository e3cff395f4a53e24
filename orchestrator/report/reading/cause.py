"""Why a run is no PASS, and the moment that its page is about; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from orchestrator.model.results import RunResult
from orchestrator.report.model import Cause, LogEvent, Moment
from orchestrator.report.words import NOTHING, limit_text, number_text, time_text
from safety.model.oracle_results import OracleResult
from safety.oracles import registry


@dataclass(frozen=True, slots=True)
class NearestPass:
    """When the vehicle was nearest to the first gate or the place of its goal, and how near."""

    t_s: float
    distance_m: float


def cause_of(
    result: RunResult,
    events: Sequence[LogEvent],
    *,
    goal_s: float | None,
    passed: NearestPass | None,
) -> Cause | None:
    """Return what was violated, when and by how much; None for a PASS.

    passed: where the vehicle was nearest to what it should have reached; None where not known.
    """
    if result.verdict == "PASS":
        return None
    oracle = deciding_oracle(result)
    at_s = _decided_s(result, oracle, events)
    facts = [] if oracle is None else _oracle_facts(oracle)
    facts.append(("when", time_text(at_s, goal_s) if at_s is not None else "at the end of the run"))
    if at_s is None and passed is not None:
        facts.append(("nearest", _nearest_text(passed, goal_s)))
    if result.note:
        facts.append(("last note", result.note))
    facts += [("also", f"{one.verdict}: {one.reason}") for one in result.also[:3]]
    return Cause(
        violated=_violated(result, oracle),
        sentence=result.reason,
        facts=tuple(facts),
        at_s=at_s,
        oracle="" if oracle is None else oracle.name,
        vehicle="" if oracle is None else oracle.vehicle,
    )


def deciding_oracle(result: RunResult) -> OracleResult | None:
    """Return the oracle that made the verdict; None where something else did."""
    named = (one for one in result.oracles if f"{one.name}/{one.vehicle}" == result.decided_by)
    failed = (
        one
        for one in result.oracles
        if not result.decided_by and one.required and one.verdict != "PASS"
    )
    return next(named, None) or next(failed, None)


def _violated(result: RunResult, oracle: OracleResult | None) -> str:
    if oracle is not None:
        word = ": cannot be judged" if oracle.verdict == "INVALID" else ""
        return f"{oracle.name} of {oracle.vehicle}{word}"
    source = f" ({result.decided_by})" if result.decided_by else ""
    return {
        "FAIL": f"the run failed{source}",
        "INVALID": f"the flight proves nothing{source}",
        "ERROR": f"the infrastructure failed{source}",
        "ABORTED": f"the run was aborted{source}",
    }[result.verdict]


def _nearest_text(passed: NearestPass, goal_s: float | None) -> str:
    distance = number_text(passed.distance_m, "m", digits=2)
    return f"{distance} from the goal's first gate or place, {time_text(passed.t_s, goal_s)}"


def _oracle_facts(oracle: OracleResult) -> list[tuple[str, str]]:
    kind = registry.get(oracle.name)
    rule = NOTHING if kind is None else f"{oracle.vehicle} {kind.summary}"
    worst, limit = number_text(oracle.actual, oracle.unit), limit_text(oracle)
    if worst == NOTHING != limit:
        worst = "not measured"
    found = [("rule", rule)]
    if oracle.margin == 0.0:
        # A worst value, a limit and a distance of 0 m each would say it three times.
        found.append(("by how much", f"{worst}: reaching the limit is a violation already"))
    else:
        found += [("at worst", worst), ("limit", limit)]
        if oracle.margin is not None:
            found.append(("by how much", _margin_text(oracle)))
    if oracle.detail:
        found.append(("where", oracle.detail))
    return [(name, text) for name, text in found if text != NOTHING]


def _margin_text(oracle: OracleResult) -> str:
    margin = oracle.margin or 0.0
    if margin > 0.0:
        return f"{number_text(margin, oracle.unit)} inside of the limit"
    return f"{number_text(-margin, oracle.unit)} beyond the limit"


def _decided_s(
    result: RunResult, oracle: OracleResult | None, events: Sequence[LogEvent]
) -> float | None:
    if oracle is not None and oracle.at_s is not None:
        flagged = [
            one.t_s
            for one in events
            if one.kind == "flag" and one.subject == oracle.vehicle and oracle.name in one.text
        ]
        # Where it was worst may be later than where it failed.
        return min([oracle.at_s, *flagged])
    decisive = (
        one.t_s for one in events if one.kind == "decisive" and result.bare_reason in one.text
    )
    return next(decisive, None)


def moment_of(
    result: RunResult | None,
    cause: Cause | None,
    *,
    stages: dict[str, float],
    passed: NearestPass | None,
    end_s: float | None,
) -> Moment | None:
    """Return the time that the page of a run shows; None where nothing was recorded.

    passed: where the vehicle was nearest to what it should have reached.
    """
    if cause is not None and cause.at_s is not None:
        return Moment(cause.at_s, cause.violated)
    if cause is not None and cause.oracle == "reached" and passed is not None:
        return Moment(passed.t_s, "nearest to what was to be reached")
    if result is not None and cause is None:
        tight = _tightest(result)
        if tight is not None and tight.at_s is not None:
            return Moment(tight.at_s, f"smallest margin: {tight.name}, {tight.detail or 'kept'}")
    for stage in ("done", "land", "goal", "takeoff"):
        if stage in stages:
            return Moment(stages[stage], f"stage {stage}")
    return None if end_s is None else Moment(end_s, "the last that was recorded")


def _tightest(result: RunResult) -> OracleResult | None:
    """Return the required oracle with the smallest margin in metres, which shows in an image."""
    near = [
        one
        for one in result.oracles
        if one.vehicle == result.subject
        and one.required
        and one.unit == "m"
        and one.margin is not None
        and one.name != "altitude"
    ]
    return min(near, key=lambda one: one.margin or 0.0, default=None)
