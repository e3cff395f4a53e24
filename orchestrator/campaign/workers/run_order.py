"""Flies one order in a worker process: loads its files, flies, writes the result."""

from pathlib import Path

from orchestrator.campaign.folder.campaign_folder import OutputError, held_run, make_run_folder
from orchestrator.campaign.workers.limited_loading import limited_loading
from orchestrator.campaign.workers.run_output import kept_output
from orchestrator.model.attempts import after_attempts
from orchestrator.model.document_writer import sync_files, to_json, write_whole
from orchestrator.model.operator_command import Inbox
from orchestrator.model.progress import Report
from orchestrator.model.results import RunResult
from orchestrator.model.results_reader import ResultError, read_result
from orchestrator.state.run_setup import RunOrder, RunSetup
from worlds.files.references import forget_loaded

_RESULT = "result.json"


def _require_unflown(folder: Path) -> None:
    """Raise OutputError where a run's folder has a result: the campaign gave the run up."""
    if (folder / _RESULT).exists():
        raise OutputError(f"{folder} has a result already: the campaign gave this run up")


def fly_order(order: RunOrder, report: Report, inbox: Inbox) -> RunResult:
    """Fly the run of an order and write its result.json; return the result once on the disk.

    The run's folder is locked meanwhile: a resumed campaign waits until this has landed, also
    when the campaign that ordered it has died.
    """
    # Only the run server imports these; a process that only sends orders does not need them.
    import cv2  # noqa: PLC0415

    from orchestrator.run.flight.run import fly  # noqa: PLC0415
    from orchestrator.run.stages.return_flight import return_setup  # noqa: PLC0415

    cv2.setNumThreads(1)  # runs share the cores by processes
    forget_loaded()  # an earlier run of this process must not affect this one
    make_run_folder(order.folder, order.plan.name)
    with held_run(order.folder):
        _require_unflown(order.folder)
        with kept_output(order.folder):
            with limited_loading():
                setup = RunSetup.of(order)
            if order.back is not None:
                setup = return_setup(setup, order.back)
            result = after_attempts(fly(setup, report, inbox), order.attempts)
            order.folder.mkdir(parents=True, exist_ok=True)  # it may have been removed in flight
            sync_files(order.folder)
            _require_unflown(order.folder)  # a file system may have no locks
            write_whole(order.folder / _RESULT, to_json(result))
    return result


def completed_run(order: RunOrder) -> RunResult | None:
    """Return the result that the run of an order wrote before its process was lost, or None."""
    try:
        result = read_result(order.folder / _RESULT)
    except ResultError:
        return None
    plan = order.plan
    flown = (result.case, result.mode, result.rep, result.seed)
    return result if flown == (plan.case, plan.mode, plan.repetition, plan.seed) else None
