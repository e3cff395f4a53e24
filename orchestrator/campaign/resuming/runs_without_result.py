"""Runs that began and have no result: how they count, and which are flown again."""

from collections.abc import Callable
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run_results.attempts import failed_too_text
from wil_campaign.orchestrator.run_results.run_result import RunResult, result_without_parts
from wil_campaign.orchestrator.state.run_log import read_cut_log
from wil_campaign.safety.model.verdict import EXCEPTION, DecisiveEvent, decide_verdict

_AFTER_LOG_S = 0.001
"""What decided at the last time of the log came before the loss."""

IsReal = Callable[[RunPlan], bool]
"""Whether a run has a real vehicle, and so is flown again only when a person orders it."""


def real_runs(campaign: Campaign, hardware: str) -> IsReal:
    """Return which runs of a campaign fly a vehicle that a person has to inspect after a loss.

    These are runs with attached vehicles: on a bench always, otherwise where `hardware` names any.
    hardware: in words, the vehicles that are no simulation; empty for none.
    """
    if not (campaign.benches or hardware) or not attached_vehicles(campaign):
        return lambda _: False

    def is_real(plan: RunPlan) -> bool:
        flown = campaign.setups[plan.case].flown_in(plan.mode)
        return any(one.attached is not None for one in flown)

    return is_real


def killed_program_text(run: str, what: str, *, failure: str = "") -> str:
    """Return why a run without a result is not flown again.

    what: what is known about it. failure: that its subject had failed by then; "" for a run that a
    real vehicle flew.
    """
    if failure:
        return f"its program was killed, and {what}; {failure}, so it is not flown again"
    return (
        f"its program was killed, and {what}; it has a real vehicle, so it is not flown again "
        f"automatically: inspect the vehicle, then use --resume --again {run}"
    )


def lost_result(plan: RunPlan, lost: WorkerLost, folder: Path) -> RunResult:
    """Return the result of a run whose worker process was lost: an ERROR with the reason.

    folder: of its files. What decided the run before, by its log, stays its verdict, and the loss
    is in `also`. A process that ended or hung after the goal, while the autonomy was called, is a
    FAIL: it is what is under test. Where it ended so outside of a call, it is not flown again: the
    autonomy's threads are in it, too.
    """
    log = read_cut_log(folder / "log.jsonl")
    # Called without a stage: its log is not here, for a call is later than the first stage.
    # Nor need the line of its goal be there: a disk takes it when it has time.
    has_goal = "goal" in log.stages or lost.has_goal or bool(lost.called and not log.stages)
    flew = lost.is_own_end and has_goal
    is_subject = flew and bool(lost.called)
    text = f"the run was lost: {lost.reason}"
    if is_subject:
        text = f"the autonomy of {lost.called} did not return from a call: {lost.reason}"
    source = f"autonomy/{lost.called}" if is_subject else ""
    decided = [
        decisive_event for decisive_event in log.decisive if decisive_event.kind != "ABORTED"
    ]
    # A run whose campaign is lost aborts itself: the loss came before that.
    aborted_s = (
        decisive_event.t_s for decisive_event in log.decisive if decisive_event.kind == "ABORTED"
    )
    lost_s = min(aborted_s, default=log.end_s + _AFTER_LOG_S)
    loss = DecisiveEvent(lost_s, "FAIL" if is_subject else "ERROR", text, source)
    decision = decide_verdict((*decided, loss), (), end_s=lost_s)
    failures = (
        decisive_event.text for decisive_event in decision.also if decisive_event.kind == "FAIL"
    )
    no_retry = next(map(failed_too_text, failures), lost.no_retry)
    if flew and not is_subject and not no_retry:
        no_retry = "its process ended after the goal was given, with the autonomy in it"
    faults = [
        decisive_event.text for decisive_event in log.decisive if decisive_event.source == EXCEPTION
    ]
    exceptions = (*faults, lost.fault.text) if lost.details else tuple(faults)
    return result_without_parts(
        plan, decision, wall_s=0.0, exceptions=exceptions, no_retry=no_retry
    )
