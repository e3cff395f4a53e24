"""Runs that began and have no result: how they count, and which are flown again."""

from collections.abc import Callable

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.campaign.resuming.attached_vehicles import attached_vehicles
from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.model.control_results import control_result
from orchestrator.model.results import RunResult, SyncResult

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


def killed_program_text(run: str, what: str) -> str:
    """Return why a run without a result is not flown again. what: what is known about it."""
    return (
        f"its program was killed, and {what}; it has a real vehicle, so it is not flown again "
        f"automatically: inspect the vehicle, then use --resume --again {run}"
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
