"""Flies one order in a worker process: looks up what it names, flies, writes the result."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2

from orchestrator.campaign.folder.campaign_folder import OutputError, held, make_run_folder
from orchestrator.campaign.workers.limited_loading import limited_loading
from orchestrator.campaign.workers.run_output import kept_output
from orchestrator.model.attempts import after_attempts
from orchestrator.model.document_writer import sync_files, to_json, write_whole
from orchestrator.model.operator_command import Inbox
from orchestrator.model.progress import Report
from orchestrator.model.results import RunResult
from orchestrator.run.stages.return_flight import return_setup
from orchestrator.state.run_setup import RunOrder, RunSetup
from worlds.files.references import forget_loaded


@contextmanager
def _unflown(folder: Path) -> Iterator[None]:
    """Raise OutputError where a held folder has a result: who ordered the run has given it up."""
    if (folder / "result.json").exists():
        raise OutputError(f"{folder} has a result already: the run was given up, and is not flown")
    yield


def fly_order(order: RunOrder, report: Report, inbox: Inbox) -> RunResult:
    """Fly the run of an order and write its result.json; return the result once on the disk.

    The run's folder is held meanwhile: who takes the campaign up waits until this has landed, also
    when whoever ordered it has died.
    """
    # The run server has it, and who only sends orders to it does without.
    from orchestrator.run.flight.run import fly  # noqa: PLC0415

    cv2.setNumThreads(1)  # runs share the cores by processes
    forget_loaded()  # else the runs that a worker flew before this one could tell
    make_run_folder(order.folder, order.plan.name)
    with held(order.folder), _unflown(order.folder), kept_output(order.folder):
        with limited_loading():
            setup = RunSetup.of(order)
        if order.back is not None:
            setup = return_setup(setup, order.back)
        result = after_attempts(fly(setup, report, inbox), order.attempts)
        order.folder.mkdir(parents=True, exist_ok=True)  # somebody may have removed it in flight
        sync_files(order.folder)
        write_whole(order.folder / "result.json", to_json(result))
    return result
