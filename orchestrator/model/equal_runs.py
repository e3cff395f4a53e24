"""Equal runs: runs that measured the same are one observation, flown several times; pure."""

from collections.abc import Iterable, Iterator, Sequence

from wil_campaign.campaigns.values.acceptance import Requirement
from wil_campaign.orchestrator.model.exit_codes import standings_of
from wil_campaign.orchestrator.model.results import RunResult


def measured(run: RunResult) -> tuple[object, ...]:
    """Return what a run measured, to compare runs by."""
    oracles = tuple(
        (oracle.name, oracle.vehicle, oracle.actual, oracle.at_s) for oracle in run.oracles
    )
    return (run.verdict, run.duration_s, oracles)


def are_equal(runs: Sequence[RunResult]) -> bool:
    """Return whether there are several runs and all of them measured the same."""
    return len(runs) > 1 and len({measured(run) for run in runs}) == 1


def equal_run_texts(
    runs: Sequence[RunResult], requirements: Iterable[Requirement]
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
        if standing.decision != "undecided" and are_equal(proven):
            yield (
                f"{wanted.case}/{wanted.mode}: the {len(proven)} runs that decided its pass rate "
                "measured the same, and are one observation: let something vary with the seed, "
                "such as wind or noise"
            )
