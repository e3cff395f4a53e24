"""Decides the verdict of a run from its decisive events and the results of its oracles."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from wil_campaign.safety.model.oracle_results import OracleResult, Verdict
from wil_campaign.worlds.figures import distinct_value_text

GOAL_TIMEOUT = "goal"
"""The source of the event that the autonomy was not done within the time of its goal."""

EXCEPTION = "exception"
"""The source of the event that an internal exception is. One that comes at the time of what was
decided before it is no cause of that: whoever hears of a decision may raise."""

NEVER_BEGAN = "faults"
"""The source of the event that an injected fault never began: any other event counts before it."""

PARTS = (
    *("actor", "autonomy", "contact", "evidence", "guard", "machine", "operator", "sync", "video"),
)
"""The words with which the sources of events begin that are of a part of a run, not of an oracle:
"sync/twin", "guard.lost/real". No oracle may have such a name."""

_LOSS_S = 4.0
"""A guard reports a vehicle as lost 3 s after its last heartbeat, which comes once a second."""

DecisiveKind = Literal["ERROR", "INVALID", "FAIL", "ABORTED"]

_Rank = tuple[float, bool, int]

_ORDER: dict[DecisiveKind, int] = {"ERROR": 0, "INVALID": 1, "FAIL": 2, "ABORTED": 3}
"""Which of several decisive events of the same time decides the verdict."""


@dataclass(frozen=True, slots=True)
class DecisiveEvent:
    """An event that alone decides the run's verdict, if none did before.

    source: where it comes from: "collision/real" for an oracle's flag (its result is then not
    reported again). note: the last note of the judged vehicle's autonomy at that time. trace: a
    traceback, where there is one.
    """

    t_s: float
    kind: DecisiveKind
    text: str
    source: str = ""
    note: str = ""
    trace: str = ""


@dataclass(frozen=True, slots=True)
class RunDecision:
    """The decision: the verdict, its reason in a sentence (empty for PASS), and later events.

    source, note, trace: of the event that decided; empty for PASS, and where it has none. at_s:
    when that happened; infinite for PASS.
    """

    verdict: Verdict
    reason: str
    also: tuple[DecisiveEvent, ...] = ()
    source: str = ""
    note: str = ""
    trace: str = ""
    at_s: float = math.inf


def event_source_of(oracle: str, vehicle: str) -> str:
    """Return the source of an oracle's events in the verdict."""
    return f"{oracle}/{vehicle}"


def decide_verdict(
    events: Iterable[DecisiveEvent],
    results: Iterable[OracleResult],
    *,
    end_s: float,
    completed: bool = True,
    timeouts: Collection[str] = (),
    worst: Mapping[str, str] = MappingProxyType({}),
) -> RunDecision:
    """Return the verdict: the first decisive event wins, PASS only when there is none.

    A required oracle's FAIL or INVALID is an event at its `at_s`, at `end_s` when it has none, and
    no event when its flag already is one. `completed`: the flight went from takeoff to the end of
    its landing; if not, it is an ERROR unless an event gives another reason. timeouts: the sources
    of events that only report that the time is up. The cause of those is what was not reached by
    then: an oracle whose failure is known at the end only comes before them. worst: what the
    worst value of an oracle was, by the source of its events: a flag has the first value alone.
    """
    known = [_with_worst(event, worst) for event in events]
    reported = {event.source for event in known if event.source}
    failed = [r for r in results if r.required and r.verdict != "PASS"]
    known += [
        _event_of(r, end_s) for r in failed if event_source_of(r.name, r.vehicle) not in reported
    ]
    if not known and not completed:
        known.append(DecisiveEvent(end_s, "ERROR", "the flight was not completed"))
    if not known:
        return RunDecision("PASS", "")
    # A failure that is known at the end only is later than events of the same time.
    at_end = {
        event_source_of(oracle_result.name, oracle_result.vehicle)
        for oracle_result in failed
        if oracle_result.at_s is None
    } - reported
    losses = {event.source: event.t_s for event in known if event.source.startswith("guard.lost/")}
    ranks: list[_Rank] = []
    for event in known:
        rank = _rank(event, event.source in at_end, losses)
        if event.source == EXCEPTION:
            rank = max([rank, *(before for before in ranks if before[0] == rank[0])])
        ranks.append(rank)
    ordered = [known[index] for index in sorted(range(len(known)), key=ranks.__getitem__)]
    at_s = ordered[0].t_s
    if ordered[0].source in timeouts and (cause := _first_unreached(failed, timeouts)):
        time_is_up = ordered[0].text
        ordered.sort(key=lambda event: event.source != cause)
        ordered[0] = replace(ordered[0], text=f"{ordered[0].text}; {time_is_up}")
    first, *later = ordered
    return RunDecision(
        first.kind, first.text, tuple(later), first.source, first.note, first.trace, at_s
    )


def _with_worst(event: DecisiveEvent, worst: Mapping[str, str]) -> DecisiveEvent:
    """Return an event of an oracle with the worst value that followed."""
    text = worst.get(event.source, "") if event.kind == "FAIL" else ""
    return replace(event, text=f"{event.text}; {text}") if text else event


def _first_unreached(failed: Iterable[OracleResult], timeouts: Collection[str]) -> str | None:
    """Return the source of the first oracle that failed at the end only; None without one."""
    waited = (
        oracle_result
        for oracle_result in failed
        if oracle_result.verdict == "FAIL" and oracle_result.at_s is None
    )
    sources = (
        event_source_of(oracle_result.name, oracle_result.vehicle) for oracle_result in waited
    )
    return next((source for source in sources if source not in timeouts), None)


def _rank(event: DecisiveEvent, is_of_the_end: bool, losses: Mapping[str, float]) -> _Rank:
    """Return the rank of a decisive event for the verdict: time, end, kind.

    losses: when each lost vehicle was reported as lost, by the source of that event.
    """
    # NaN must not make the order depend on the previous order.
    is_last = math.isnan(event.t_s) or event.source == NEVER_BEGAN
    at_s = math.inf if is_last else event.t_s
    if event.source.startswith("evidence/"):
        lost_s = losses.get(f"guard.lost/{event.source.rpartition('/')[2]}", -math.inf)
        if lost_s - _LOSS_S <= at_s <= lost_s:
            at_s = lost_s
    return (at_s, is_of_the_end, _ORDER[event.kind])


def _event_of(result: OracleResult, end_s: float) -> DecisiveEvent:
    at_s = end_s if result.at_s is None else min(result.at_s, end_s)
    kind: DecisiveKind = "INVALID" if result.verdict == "INVALID" else "FAIL"
    outcome = "cannot be judged" if kind == "INVALID" else "failed"
    text = f"{result.name} of {result.vehicle} {outcome}"
    if result.detail:
        text += f": {result.detail}"
    elif result.actual is not None:
        shown = distinct_value_text(result.actual, _exceeded(result), digits=3)
        text += f": {shown} {result.unit} against {_limit(result)} {result.unit}"
    return DecisiveEvent(at_s, kind, text, event_source_of(result.name, result.vehicle))


def _exceeded(result: OracleResult) -> float:
    """Return the limit that an oracle's result exceeds; NaN without one."""
    if not isinstance(result.limit, tuple):
        return math.nan if result.limit is None else result.limit
    low, high = result.limit
    is_below = low is not None and result.actual is not None and result.actual < low
    found = low if is_below or high is None else high
    return math.nan if found is None else found


def _limit(result: OracleResult) -> str:
    if not isinstance(result.limit, tuple):
        return "no limit" if result.limit is None else f"{result.limit:g}"
    low, high = ("open" if x is None else f"{x:g}" for x in result.limit)
    return f"[{low}, {high}]"
