"""Which runs a campaign flies, and which of them count by its sequential test; pure.

Runs are counted in the order of their repetitions, not of their ends, so that the decision does not
depend on how many flew at once.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.orchestrator.run_results.run_result import RunResult


def runs_planned(campaign: Campaign, *, arm: bool) -> tuple[RunPlan, ...]:
    """Return the campaign's runs to fly, then its controls.

    Without arming: one run of each case and mode, none of them required, and no control.
    """
    if arm:
        return campaign.plans
    return tuple(replace(run, required=False) for run in campaign.runs if run.repetition == 1)


def runs_due(
    plans: Iterable[RunPlan], test: SequentialTest | None, results: Mapping[str, RunResult]
) -> list[RunPlan]:
    """Return the plans that count: all but repetitions after their test has decided."""
    given = list(plans)
    if test is None:
        return given
    groups: dict[tuple[str, str], list[RunPlan]] = {}
    for plan in given:
        if plan.control is None:
            groups.setdefault((plan.case, plan.mode), []).append(plan)
    last = {cell: _last_counted(group, test, results) for cell, group in groups.items()}
    return [
        plan
        for plan in given
        if plan.control is not None or plan.repetition <= last[plan.case, plan.mode]
    ]


def _last_counted(
    plans: Iterable[RunPlan], test: SequentialTest, results: Mapping[str, RunResult]
) -> int:
    """Return the repetition with which the test decided; the last planned one until then.

    A run without PASS or FAIL is skipped: the test continues with the next one.
    """
    ordered = sorted(plans, key=lambda one: one.repetition)
    passes: list[bool] = []
    for plan in ordered:
        result = results.get(plan.name)
        if result is None:
            break
        if result.verdict in {"PASS", "FAIL"}:
            passes.append(result.verdict == "PASS")
        if test.decided_after(passes)[0] != "undecided":
            return plan.repetition
    return ordered[-1].repetition
