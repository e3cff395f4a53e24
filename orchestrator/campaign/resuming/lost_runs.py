"""Runs that were begun and came to no result: what they count as, and which are flown again."""

from collections.abc import Callable

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.model.control_results import control_result
from orchestrator.model.results import RunResult, SyncResult

IsReal = Callable[[RunPlan], bool]
"""Whether a run is one that nobody but a person has flown again."""


def real_runs(campaign: Campaign, hardware: str) -> IsReal:
    """Return which runs of a campaign have a vehicle in them that a person has to look at first.

    On a bench that is its vehicle, whatever it is; otherwise an attached one where hardware says
    that there is any. hardware: in words, the vehicles that are no simulation; empty for none.
    """
    if not (campaign.benches or hardware) or not attached_vehicles(campaign):
        return lambda _: False

    def is_real(plan: RunPlan) -> bool:
        flown = campaign.setups[plan.case].flown_in(plan.mode)
        return any(one.attached is not None for one in flown)

    return is_real


def killed_program_text(run: str, what: str) -> str:
    """Return why a run that has no result is not flown again. what: what is known of it."""
    return (
        f"its program was killed, and {what}; a real vehicle was in it, so it is not flown again "
        f"by itself: look at the vehicle, then --resume --again {run}"
    )


def lost_result(plan: RunPlan, lost: WorkerLost) -> RunResult:
    """Return the result of a run whose worker process was lost: an ERROR with the reason."""
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict="ERROR",
        reason=f"the run was lost: {lost.reason}",
        also=(),
        required=plan.required,
        duration_s=None,
        wall_s=0.0,
        oracles=(),
        sync=SyncResult(),
        mixing=None,
        control=control_result(
            plan.control, verdict="ERROR", reason=lost.reason, decided_by="", subject=""
        ),
        exceptions=(lost.fault.text,) if lost.details else (),
    )
