"""Acceptance of a campaign, and its exit code, from the results of its runs; pure.

Equal runs: runs that measured the same are one observation, flown several times.
"""

from collections.abc import Iterable, Iterator, Sequence

from wil_campaign.campaigns.values.acceptance import (
    PassRequirement,
    PassShare,
    RequirementStanding,
    requirement_standings,
)
from wil_campaign.orchestrator.run_results.run_result import NOT_ARMED, RunResult, Stop

_PROVEN = frozenset({"PASS", "FAIL"})


def standings_of(
    runs: Iterable[RunResult], requirements: Iterable[PassRequirement]
) -> tuple[RequirementStanding, ...]:
    """Return how far run results meet each requirement of the campaign."""
    return requirement_standings(
        requirements,
        (
            (run.case, run.mode, run.verdict == "PASS" if run.verdict in _PROVEN else None)
            for run in runs
            if run.control is None
        ),
    )


def is_campaign_accepted(
    runs: Sequence[RunResult],
    requirements: Sequence[PassRequirement],
    *,
    stopped: Stop | None = None,
    broken: bool = False,
    controls_due: int = 0,
    missing: int = 0,
) -> bool | None:
    """Return whether results make the campaign accepted; None without a required run.

    With required runs a campaign is accepted exactly if it ends with exit code 0; the arguments are
    those of `exit_code`. A share such as 4/5 forgives a FAIL, never an ERROR, INVALID or ABORTED,
    which prove nothing, nor a run that was not flown. A campaign is not accepted either with a
    control that was not flown or did not end as expected: its PASS would mean nothing.
    """
    if any(run.control is not None and not run.control.met for run in runs):
        return False
    if not any(run.required for run in runs):
        return None
    code = exit_code(
        runs,
        requirements,
        stopped=stopped,
        broken=broken,
        controls_due=controls_due,
        missing=missing,
    )
    return code == 0


def requirement_shortfalls(
    runs: Iterable[RunResult], requirements: Iterable[PassRequirement]
) -> tuple[RequirementStanding, ...]:
    """Return the requirements that are not met, or have a required run that proves nothing.

    runs: all of them; controls and runs that are only reported are ignored.
    """
    required = [run for run in runs if run.required and run.control is None]
    unproven = {(run.case, run.mode) for run in required if run.verdict not in _PROVEN}
    return tuple(
        standing
        for standing in standings_of(required, _all_wanted(required, requirements))
        if not standing.met or (standing.requirement.case, standing.requirement.mode) in unproven
    )


def _short(
    required: Sequence[RunResult], requirements: Iterable[PassRequirement]
) -> list[RequirementStanding]:
    """Return the requirements that results do not meet; uncovered runs must pass by themselves."""
    wanted = _all_wanted(required, requirements)
    return [standing for standing in standings_of(required, wanted) if not standing.met]


def _all_wanted(
    required: Sequence[RunResult], requirements: Iterable[PassRequirement]
) -> list[PassRequirement]:
    """Return the requirements, and one of all passes for each case and mode without one."""
    wanted = list(requirements)
    covered = {(requirement.case, requirement.mode) for requirement in wanted}
    for run in required:
        if (run.case, run.mode) not in covered:
            covered.add((run.case, run.mode))
            count = sum((r.case, r.mode) == (run.case, run.mode) for r in required)
            wanted.append(PassRequirement(run.case, run.mode, PassShare(count, count)))
    return wanted


def is_rehearsed(run: RunResult) -> bool:
    """Return whether a run stopped before arming, as --no-arm requests, without an error after it.

    Such an ERROR may be a vehicle that still has the parameters or the fence of the run.
    """
    stopped_there = run.verdict == "ABORTED" and run.reason == NOT_ARMED
    return (
        stopped_there and not run.exceptions and all(also.verdict != "ERROR" for also in run.also)
    )


def rehearsal_code(runs: Sequence[RunResult]) -> int:
    """Return the exit code of results without arming (--no-arm): 5 when all works.

    A run that was aborted for another reason gives 4.
    """
    if any(run.verdict == "ABORTED" and run.reason != NOT_ARMED for run in runs):
        return 4
    return 5 if all(map(is_rehearsed, runs)) else 3


def exit_code(
    runs: Sequence[RunResult],
    requirements: Sequence[PassRequirement],
    *,
    stopped: Stop | None = None,
    broken: bool = False,
    controls_due: int = 0,
    missing: int = 0,
) -> int:
    """Return the exit code of a campaign's results; the first of 130, 4, 3, 1, 5, 0.

    stopped: what ended the campaign early. broken: an exception reached the orchestrator, or a
    vehicle, port or broker was unavailable; then it is never 0. An ABORTED run counts as an
    operator's command whether or not it was required. Required runs (missing: how many) and
    controls that were not flown although nobody stopped the campaign are 3, whatever share of the
    required runs may FAIL.

    A control that did not end as expected is 3 for ERROR or INVALID, which prove nothing, and else
    1, like a required run that FAILed: all was flown, and something is wrong.
    """
    if stopped == "signal":
        return 130
    if stopped == "command" or any(run.verdict == "ABORTED" for run in runs):
        return 4
    broken = broken or any(run.exceptions for run in runs)
    if broken or missing:
        return 3
    return _code_of(runs, requirements, controls_due)


def _code_of(
    runs: Sequence[RunResult], requirements: Sequence[PassRequirement], controls_due: int
) -> int:
    required = [run for run in runs if run.required]
    unmet = [run for run in runs if run.control is not None and not run.control.met]
    if any(run.verdict in {"ERROR", "INVALID"} for run in (*required, *unmet)):
        return 3
    if sum(run.control is not None for run in runs) < controls_due:
        return 3
    if not required:
        return 1 if unmet else 5
    short = _short(required, requirements)
    if not all(standing.is_complete for standing in short):
        return 3
    return 1 if short or unmet else 0


def measured_values_of_run(run: RunResult) -> tuple[object, ...]:
    """Return what a run measured, to compare runs by."""
    oracles = tuple(
        (oracle.name, oracle.vehicle, oracle.actual, oracle.at_s) for oracle in run.oracles
    )
    return (run.verdict, run.duration_s, oracles)


def are_runs_equal(runs: Sequence[RunResult]) -> bool:
    """Return whether there are several runs and all of them measured the same."""
    return len(runs) > 1 and len({measured_values_of_run(run) for run in runs}) == 1


def equal_run_texts(
    runs: Sequence[RunResult], requirements: Iterable[PassRequirement]
) -> Iterator[str]:
    """Yield the caveat of each pass rate that a sequential test decided on equal runs."""
    for standing in standings_of(
        runs, [requirement for requirement in requirements if requirement.test is not None]
    ):
        wanted = standing.requirement
        proven = [
            run
            for run in runs
            if (run.case, run.mode) == (wanted.case, wanted.mode)
            and run.verdict in {"PASS", "FAIL"}
        ]
        if standing.decision != "undecided" and are_runs_equal(proven):
            yield (
                f"{wanted.case}/{wanted.mode}: the {len(proven)} runs that decided its pass rate "
                "measured the same, and are one observation: let something vary with the seed, "
                "such as wind or noise"
            )
