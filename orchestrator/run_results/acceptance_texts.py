"""Texts about the acceptance of a campaign, shared by terminal and report; pure."""

from collections.abc import Iterable, Sequence
from typing import Literal

from wil_campaign.campaigns.values.acceptance import PassRequirement, RequirementStanding
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.exit_codes import requirement_shortfalls
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.model.oracle_results import Verdict

_PROVEN = frozenset({"PASS", "FAIL"})
_BY_DECISION: dict[str, Verdict] = {"at least": "PASS", "below": "FAIL"}
"""The verdict by the decision of a sequential test."""
_MOST_NAMED = 12


def required_text(summary: Summary, requirements: Iterable[PassRequirement]) -> str:
    """Return in words how many of the required runs passed; those never flown are counted too.

    Of a case and mode with a sequential test, which may end before its last run, only the flown.
    """
    wanted = {(wanted.case, wanted.mode): wanted.test is not None for wanted in requirements}
    required = [run for run in summary.runs if run.required]
    is_tested = dict.fromkeys(((run.case, run.mode) for run in required), False) | wanted
    missing = [is_tested.get(place_of(name), True) for name in summary.not_flown].count(False)
    count = len(required) + missing
    if not count:
        return "no required run was flown" if wanted else "no run was required"
    runs_word = "run" if count == 1 else "runs"
    passed = sum(run.verdict == "PASS" for run in required)
    return f"{passed} of the {count} required {runs_word} passed"


def place_of(name: str) -> tuple[str, str]:
    """Return case and mode of a run by its name, as large/wil/1."""
    case, _, rest = name.partition("/")
    return case, rest.partition("/")[0]


def row_verdict(
    standing: RequirementStanding, runs: Iterable[RunResult]
) -> Verdict | Literal["undecided"]:
    """Return the verdict on a required case and mode: PASS only if by itself it is accepted.

    runs: those of the case and mode. A run that proves nothing or had an internal exception
    outweighs what passed and failed. ERROR is also for runs that were not flown and could decide.
    undecided is a sequential test without a decision after its last flight: not accepted either.
    """
    flown = list(runs)
    for run in flown:
        if run.verdict not in _PROVEN:
            return run.verdict
        if run.exceptions:
            return "ERROR"
    share = standing.requirement.share
    if standing.decision in _BY_DECISION:
        return _BY_DECISION[standing.decision]
    if standing.decision:
        return "undecided" if standing.is_complete else "ERROR"
    if standing.met and standing.is_complete:
        return "PASS"
    too_many = standing.flown - standing.passed > share.runs - share.passes
    return "FAIL" if too_many and not standing.met else "ERROR"


def shortfall_texts(
    runs: Sequence[RunResult], requirements: Sequence[PassRequirement]
) -> tuple[str, ...]:
    """Return each requirement that is not met, with what it needs."""
    return tuple(
        _shortfall_text(shortfall, runs) for shortfall in requirement_shortfalls(runs, requirements)
    )


def _shortfall_text(standing: RequirementStanding, runs: Iterable[RunResult]) -> str:
    wanted = standing.requirement
    place = f"{wanted.case}/{wanted.mode}"
    text = f"{place} is {standing.passed}/{standing.flown} (needs {wanted})"
    if standing.decision:
        text = f"{text[:-1]}: {standing.decision})"
    counted = (run for run in runs if (run.case, run.mode) == (wanted.case, wanted.mode))
    unproven = [run.verdict for run in counted if run.verdict not in _PROVEN]
    counts = (f"{unproven.count(word)} {word}" for word in dict.fromkeys(unproven))
    return ", ".join([text, *counts])


def stand_in_text(summary: Summary) -> str:
    """Return a sentence that no hardware flew as `real`; empty where it did, or for sim alone."""
    if all(run.mode == "sim" for run in (*summary.runs, *summary.controls)):
        return ""
    if summary.surrogate or summary.real_kind == "embedded":
        return "No hardware flew: 'real' is the embedded surrogate, a simulation in this program."
    if summary.real_kind == "sitl":
        return "No hardware flew: 'real' is a simulator of its autopilot (SITL)."
    return "" if summary.real_kind == "hardware" else "It is not known whether 'real' is hardware."


def left_out_names(summary: Summary) -> str:
    """Return what is required and was left out, by name; of many the first."""
    names = ", ".join(summary.left_out[:_MOST_NAMED])
    more = len(summary.left_out) - _MOST_NAMED
    return f"{names} and {more} more" if more > 0 else names


def left_out_text(summary: Summary) -> str:
    """Return sentences about what is required and was left out; empty for nothing."""
    if not summary.left_out:
        return ""
    text = f"Required but left out: {left_out_names(summary)}."
    if any("control" in one for one in summary.left_out):
        text += " Controls are runs that must not pass: they show that the campaign can fail."
    return f"{text} The verdict covers only what was flown."
