"""The cause of a run's verdict, what held if it passed, and the moment its page shows; pure."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from wil_campaign.orchestrator.report.model import (
    CheckMargin,
    LogEvent,
    ReportMoment,
    RunSuccess,
    VerdictCause,
)
from wil_campaign.orchestrator.report.words import (
    NOTHING,
    limit_text,
    number_text,
    short_time,
    time_text,
)
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.oracles.registry import oracle_kinds

_CONTACT = "contact/"
_COLLISION = "collision"
_MOST_EVENTS = 8
SAME_MOMENT_S = 0.05


@dataclass(frozen=True, slots=True)
class ContactFacts:
    """A contact: the vehicle's speed at its start, and its end; None where not known.

    recorded_s: the last recorded time of the vehicle; None without a recording.
    """

    speed_m_s: float | None = None
    until_s: float | None = None
    recorded_s: float | None = None


ContactAt = Callable[[str, float], ContactFacts]
"""Returns the contact of a vehicle that began at a time."""


@dataclass(frozen=True, slots=True)
class NearestPass:
    """Time and distance of the vehicle's nearest pass of its goal's first gate or position."""

    t_s: float
    distance_m: float


def verdict_cause_of(
    result: RunResult,
    events: Sequence[LogEvent],
    *,
    goal_s: float | None,
    passed: NearestPass | None,
    formulas: Mapping[str, str] = MappingProxyType({}),
    outcome: tuple[tuple[float, str], ...] = (),
    contact_at: ContactAt | None = None,
) -> VerdictCause | None:
    """Return what was violated, when and by how much; None for a PASS.

    passed: the nearest pass of the target; None where not known. formulas: by oracle. outcome: how
    the flight continued and ended, with times.
    """
    if result.verdict == "PASS":
        return None
    oracle = deciding_oracle(result)
    at_s = _decided_s(result, oracle, events)
    contact = ContactFacts()
    if oracle is not None and _is_contact(oracle) and at_s is not None and contact_at is not None:
        contact = contact_at(oracle.vehicle, at_s)
    facts = []
    if oracle is not None:
        facts = _oracle_facts(oracle, formulas.get(oracle.name, ""), _contact_text(contact, at_s))
    is_formula = oracle is not None and oracle.name in formulas
    facts += _time_facts(oracle, at_s, goal_s, first="crossed" if is_formula else "when")
    if at_s is None and passed is not None:
        facts.append(("nearest", _nearest_text(passed, goal_s)))
    if result.note:
        facts.append(("last note", result.note))
    return VerdictCause(
        violated=_violated(result, oracle),
        sentence=result.reason,
        facts=tuple(facts),
        at_s=at_s,
        oracle="" if oracle is None else oracle.name,
        vehicle="" if oracle is None else oracle.vehicle,
        sequence=_sequence(result, at_s, outcome),
    )


def _contact_text(contact: ContactFacts, at_s: float | None) -> str:
    """Return speed and duration of a contact, as far as they were recorded."""
    text = "contact"
    if contact.speed_m_s is not None:
        text += f" at {number_text(contact.speed_m_s, 'm/s', digits=2)}"
    if contact.until_s is not None and at_s is not None:
        text += f" for {number_text(contact.until_s - at_s, 's', digits=2)}"
    elif contact.recorded_s is not None and at_s is not None:
        text += (
            f" to the end of the recording, {number_text(contact.recorded_s - at_s, 's', digits=2)}"
        )
    return f"{text}: any contact is a violation"


def _sequence(
    result: RunResult, at_s: float | None, outcome: Iterable[tuple[float, str]]
) -> tuple[tuple[float, str], ...]:
    """Return the decisive events in order of time; empty for a single one."""
    found = [(also.at_s, f"{also.verdict}: {also.reason}") for also in result.also[:_MOST_EVENTS]]
    if at_s is None or not found:
        return ()
    found += [(at_s, f"{result.verdict}: {result.bare_reason}"), *outcome]
    return tuple(sorted(found))


def _time_facts(
    oracle: OracleResult | None, at_s: float | None, goal_s: float | None, *, first: str
) -> list[tuple[str, str]]:
    """Return when a limit was crossed, and the time of the worst value where it differs.

    first: the title of a single time.
    """
    if at_s is None:
        # An oracle without a time judged the whole flight; any other event has one in log.jsonl.
        return [("when", "not known" if oracle is None else "at the end of the run")]
    worst_s = None if oracle is None else oracle.at_s
    if worst_s is not None and worst_s - at_s > SAME_MOMENT_S:
        return [("crossed", time_text(at_s, goal_s)), ("worst", time_text(worst_s, goal_s))]
    return [(first, time_text(at_s, goal_s))]


def verdict_notes_of(
    result: RunResult, *, at_s: float | None, goal_s: float | None
) -> tuple[str, ...]:
    """Return facts that did not decide the verdict: evidence, the twin's end, reported oracles.

    at_s: time of the decisive event; None for a PASS, or where it is not known.
    """
    found = []
    if result.doubt:
        found.append(f"{result.doubt[0].upper()}{result.doubt[1:]}")
    left = None if result.twin is None else result.twin.dropped_out
    if left is not None:
        text = f"The twin dropped out {time_text(left.at_s, goal_s)}"
        if at_s is not None:
            word = "before" if left.at_s < at_s else "after"
            text += f", {abs(at_s - left.at_s):.2f} s {word} the decisive event"
        found.append(f"{text}: {left.reason}")
    reported = [
        f"{oracle.name} of {oracle.vehicle} {oracle.verdict}"
        f"{f' ({oracle.detail})' if oracle.detail else ''}"
        for oracle in result.oracles
        if not oracle.required and oracle.verdict != "PASS"
    ]
    if reported:
        found.append(f"Reported only, without a say in the verdict: {'; '.join(reported)}")
    return tuple(found)


def _is_contact(oracle: OracleResult) -> bool:
    return oracle.name.startswith("collision") and oracle.verdict == "FAIL"


def deciding_oracle(result: RunResult) -> OracleResult | None:
    """Return the oracle that decided the verdict; None where something else did.

    A physical contact alone fails a run; the oracle that judged the same contact explains it.
    """
    if result.decided_by.startswith(_CONTACT):
        vehicle = result.decided_by.removeprefix(_CONTACT)
        return next((o for o in result.oracles if o.vehicle == vehicle and _is_contact(o)), None)
    named = (
        oracle
        for oracle in result.oracles
        if f"{oracle.name}/{oracle.vehicle}" == result.decided_by
    )
    failed = (
        oracle
        for oracle in result.oracles
        if not result.decided_by and oracle.required and oracle.verdict == result.verdict != "PASS"
    )
    return next(named, None) or next(failed, None)


def _violated(result: RunResult, oracle: OracleResult | None) -> str:
    if oracle is not None:
        word = ": cannot be judged" if oracle.verdict == "INVALID" else ""
        return f"{oracle.name} of {oracle.vehicle}{word}"
    if result.verdict == "ERROR" and not result.decided_by:
        return result.bare_reason.partition(";")[0]
    if result.verdict == "FAIL" and result.decided_by.startswith("guard.fence/"):
        return f"the geofence of {result.decided_by.partition('/')[2]}: the guard took over"
    source = f" ({result.decided_by})" if result.decided_by else ""
    return {
        "FAIL": f"the run failed{source}",
        "INVALID": f"the flight proves nothing{source}",
        "ERROR": f"the infrastructure failed{source}",
        "ABORTED": f"the run was aborted{source}",
    }[result.verdict]


def _nearest_text(passed: NearestPass, goal_s: float | None) -> str:
    distance = number_text(passed.distance_m, "m", digits=2)
    return f"{distance} from the goal's first gate or position, {time_text(passed.t_s, goal_s)}"


def _oracle_facts(oracle: OracleResult, formula: str, contact: str) -> list[tuple[str, str]]:
    kind = oracle_kinds().get(_COLLISION if oracle.name.startswith(_COLLISION) else oracle.name)
    worst, limit = number_text(oracle.actual, oracle.unit), limit_text(oracle)
    rule = NOTHING if kind is None else f"{oracle.vehicle} {kind.summary}"
    if isinstance(oracle.limit, float) and "max_m" not in rule:
        rule = rule.replace("min_m", number_text(oracle.limit, oracle.unit))
    if worst == NOTHING != limit:
        worst = "not measured"
    # Without an interval a formula has no seconds that a reader had to be told of.
    counted = f"{formula} (seconds since its window opened)" if "[" in formula else formula
    found = [("rule", counted or rule)]
    if _is_contact(oracle) and oracle.margin == 0.0:
        found.append(("by how much", contact))
    elif oracle.margin == 0.0:
        # Worst value, limit and distance of 0 m would repeat the same fact.
        found.append(("by how much", f"{worst}: reaching the limit is a violation"))
    else:
        found += [("at worst", worst), ("limit", limit)]
        if oracle.margin is not None:
            found.append(("by how much", _margin_text(oracle)))
    part, is_formula, _ = oracle.detail.partition(" is violated")
    if is_formula and formula:
        # The figures are listed above; this is the part of the formula that they belong to.
        found.append(("broken part", part))
    elif oracle.detail:
        found.append(("where", oracle.detail))
    return [(name, text) for name, text in found if text != NOTHING]


def _margin_text(oracle: OracleResult) -> str:
    margin = oracle.margin or 0.0
    if margin > 0.0:
        return f"{number_text(margin, oracle.unit)} inside the limit"
    return f"{number_text(-margin, oracle.unit)} beyond the limit"


def _decided_s(
    result: RunResult, oracle: OracleResult | None, events: Sequence[LogEvent]
) -> float | None:
    if oracle is not None and oracle.at_s is not None:
        flagged = [
            event.t_s
            for event in events
            if event.kind == "flag"
            and (event.oracle, event.subject) == (oracle.name, oracle.vehicle)
        ]
        # The worst value may come after the violation.
        return min([oracle.at_s, *flagged])
    reason = result.bare_reason
    decisive = (
        event.t_s
        for event in events
        if event.kind == "decisive" and (reason in event.text or reason.startswith(event.text))
    )
    return next(decisive, None)


def report_moment_of(
    result: RunResult | None,
    cause: VerdictCause | None,
    *,
    stages: dict[str, float],
    passed: NearestPass | None,
    end_s: float | None,
) -> ReportMoment | None:
    """Return the time that the page of a run shows; None where nothing was recorded."""
    if cause is not None and cause.at_s is not None:
        return ReportMoment(cause.at_s, cause.violated)
    if cause is not None and cause.oracle == "reached" and passed is not None:
        return ReportMoment(passed.t_s, "nearest pass of the target")
    if result is not None and cause is None:
        tight = tightest_in_view(result)
        if tight is not None and tight.at_s is not None:
            return ReportMoment(
                tight.at_s, f"smallest margin: {tight.name}, {tight.detail or 'kept'}"
            )
    for stage in ("done", "land", "goal", "takeoff"):
        if stage in stages:
            return ReportMoment(stages[stage], f"stage {stage}")
    return None if end_s is None else ReportMoment(end_s, "the end of the recording")


def tightest_in_view(result: RunResult) -> OracleResult | None:
    """Return the required oracle with the smallest margin in metres, which an image can show."""
    near = [
        oracle
        for oracle in result.oracles
        if oracle.vehicle == result.subject
        and oracle.required
        and oracle.unit == "m"
        and oracle.margin is not None
        and oracle.name != "altitude"
    ]
    return min(near, key=lambda one: one.margin or 0.0, default=None)


def run_success_of(result: RunResult, *, goal_s: float | None) -> RunSuccess | None:
    """Return why a run passed; None for other verdicts."""
    if result.verdict != "PASS":
        return None
    required = [oracle for oracle in result.oracles if oracle.required]
    # Those in metres first, then other units; last those that measure nothing, such as `landed`.
    listed = sorted(
        required,
        key=lambda one: (
            one.margin is None or one.actual is None,
            one.unit != "m",
            one.margin or 0.0,
        ),
    )
    is_one = len(required) == 1
    sentence = (
        "The required check held." if is_one else f"All {len(required)} required checks held."
    )
    tight = tightest_in_view(result)
    if tight is not None:
        sentence += " " + _tightest_text(tight, goal_s)
    return RunSuccess(sentence, tuple(_margins(listed)))


def _tightest_text(oracle: OracleResult, goal_s: float | None) -> str:
    margin = number_text(oracle.margin, oracle.unit, 2)
    when = "" if oracle.at_s is None else f", at {short_time(oracle.at_s, goal_s)}"
    where = f", {oracle.detail}" if oracle.detail else ""
    return f"The tightest was {oracle.name}, with {margin} to spare{when}{where}."


def _margins(oracles: Sequence[OracleResult]) -> Iterator[CheckMargin]:
    for oracle in oracles:
        yield CheckMargin(
            name=oracle.name,
            measured=number_text(oracle.actual, oracle.unit, 2),
            limit=limit_text(oracle),
            margin=number_text(oracle.margin, oracle.unit, 2),
            at_s=oracle.at_s,
        )
