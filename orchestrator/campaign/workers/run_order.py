"""Flies one order in a worker process: loads its files, flies, writes the result.

Ends a run whose user files hang while they are loaded, with the place where they hang.
"""

import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.foundation.files.document_writer import sync_files, to_json, write_atomically
from wil_campaign.foundation.files.documents import Document
from wil_campaign.foundation.files.user_modules import all_user_files, forget_user_modules
from wil_campaign.foundation.processes.linux import processor_wait_s
from wil_campaign.hooks import recording_formats
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    OutputError,
    locked_run_folder,
    make_run_folder,
)
from wil_campaign.orchestrator.campaign.folder.named_files import document_place
from wil_campaign.orchestrator.campaign.workers.run_output import redirected_run_output
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report, RunProgressReport
from wil_campaign.orchestrator.run_results.attempts import after_attempts
from wil_campaign.orchestrator.run_results.evidence_files import evidence_digests
from wil_campaign.orchestrator.run_results.result_reader import ResultError, read_result
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup

LONGEST_LOADING_S = 30.0
_GRACE_S = 5.0
"""After so much more the process ends: the exception was swallowed, or native code hangs."""
_LEAST_S = 0.001
"""A timer set to 0 is off."""


class LoadingTimeoutError(Exception):
    """A run's files were not loaded in time; the traceback shows where they hang."""


@contextmanager
def limited_loading(limit_s: float = LONGEST_LOADING_S) -> Iterator[None]:
    """Raise LoadingTimeoutError in the context when it takes longer; only in the main thread.

    Time for which this process is ready to run but has no processor does not count.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    end_s = time.monotonic() + limit_s - processor_wait_s(os.getpid())
    is_over = False

    def expire(*_: object) -> None:
        if is_over:
            return  # else the process would end in flight, or the rest of the clean-up be skipped
        left_s = end_s + processor_wait_s(os.getpid()) - time.monotonic()
        if left_s > _LEAST_S:
            limit(left_s)
            return
        raise LoadingTimeoutError(
            f"loading the campaign's files took more than {limit_s:g} s: the autonomy or a recipe "
            "step blocks when it is imported or constructed"
        )

    def limit(left_s: float) -> None:
        signal.setitimer(signal.ITIMER_REAL, left_s)
        if _has_stderr():
            faulthandler.dump_traceback_later(left_s + _GRACE_S, exit=True)

    before = signal.signal(signal.SIGALRM, expire)
    limit(limit_s)
    try:
        yield
    finally:
        is_over = True  # first: an alarm may come between any two of the calls below
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _has_stderr() -> bool:
    try:
        sys.stderr.fileno()
    except (AttributeError, OSError, ValueError):
        return False
    return True


_RESULT = "result.json"


def resolve_order(order: RunOrder) -> RunOrder:
    """Return an order in which every path is absolute.

    So it means the same on a node, and after an autonomy's os.chdir.
    """
    resolved = map_documents(order, lambda one: replace(one, path=document_place(one.path)))
    campaign = None if order.campaign is None else order.campaign.absolute()
    return replace(resolved, folder=order.folder.absolute(), campaign=campaign)


def map_documents(order: RunOrder, change: Callable[[Document], Document]) -> RunOrder:
    """Return an order with each document of its case changed."""
    files = order.plan.files
    changed = CaseFiles(
        campaign=change(files.campaign),
        world=None if files.world is None else change(files.world),
        recipe=None if files.recipe is None else change(files.recipe),
        fences={name: change(fence) for name, fence in files.fences.items()},
    )
    return replace(order, plan=replace(order.plan, files=changed))


def _require_unflown(folder: Path) -> None:
    """Raise OutputError where a run's folder has a result: the campaign gave the run up."""
    if (folder / _RESULT).exists():
        raise OutputError(f"{folder} has a result already: the campaign gave this run up")


def fly_order(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Fly the run of an order and write its result.json; return the result once on the disk.

    The run's folder is locked meanwhile: a resumed campaign waits until this has landed, also
    when the campaign that ordered it has died. A video is made last: whatever becomes of it, the
    result is there.
    """
    # Only the run server imports these; a process that only sends orders does not need them.
    import cv2  # noqa: PLC0415

    from wil_campaign.orchestrator.recording import run_video  # noqa: PLC0415
    from wil_campaign.orchestrator.run.flight.run import fly_one_run  # noqa: PLC0415
    from wil_campaign.orchestrator.run.stages.return_flight import return_setup  # noqa: PLC0415

    order = resolve_order(order)
    cv2.setNumThreads(1)  # runs share the cores by processes
    forget_user_modules()  # an earlier run of this process must not affect this one
    make_run_folder(order.folder, order.plan.name)
    with locked_run_folder(order.folder):
        _require_unflown(order.folder)
        with redirected_run_output(order.folder):
            with limited_loading():
                setup = RunSetup.of(order)
            if order.back is not None:
                setup = return_setup(setup, order.back)
            result = after_attempts(fly_one_run(setup, report, inbox), order.attempts)
            order.folder.mkdir(parents=True, exist_ok=True)  # it may have been removed in flight
            sync_files(order.folder)
            digests = evidence_digests(order.folder)
            result = replace(result, code=_imported_code(order), evidence_files=digests)
            _require_unflown(order.folder)  # a file system may have no locks
            write_atomically(order.folder / _RESULT, to_json(result))
            if _is_filmed(setup, result):
                result = _with_file(order, result, report, run_video.FILE_NAME, _film)
            for name in setup.case.record.also:
                made = load_plugin_object(plugin_additions(recording_formats)[name].write)
                result = _with_file(order, result, report, f"the recording as {name}", made)
    return result


def _is_filmed(setup: RunSetup, result: RunResult) -> bool:
    """Return whether the campaign wants a video of a run."""
    wanted = setup.case.record.video
    if wanted == "failed":
        return result.went_wrong or result.rep == 1
    return wanted == "always"


def _film(folder: Path, passed: Callable[[], None]) -> str:
    """Make a run's video; return its name, "" without images to show."""
    from wil_campaign.orchestrator.recording import run_video  # noqa: PLC0415 - as above

    return run_video.FILE_NAME if run_video.make_video(folder, passed=lambda _: passed()) else ""


def _with_file(
    order: RunOrder,
    result: RunResult,
    report: Report,
    text: str,
    make: Callable[[Path, Callable[[], None]], str],
) -> RunResult:
    """Make a file of a run; return the result with it. Without one the run's output says why.

    text: the file, in words.
    """

    def passed() -> None:
        # A process that sends nothing for long is taken for one that hangs.
        run = (result.case, result.mode, result.rep)
        verdict = result.verdict
        progress = RunProgressReport(
            *run, "end", result.duration_s or 0.0, verdict_so_far=verdict, text=f"{text} is made"
        )
        report(progress)

    try:
        name = make(order.folder, passed)
        if not name:
            return result
        files = tuple(sorted({*result.artifacts, name}))
        extended = replace(result, artifacts=files)
        write_atomically(order.folder / _RESULT, to_json(extended))
    except (Exception, SystemExit) as error:  # noqa: BLE001 - worth less than the result
        sys.stderr.write(f"{text} was not made: {type(error).__name__}: {error}\n")
        return result
    return extended


def _imported_code(order: RunOrder) -> dict[str, str]:
    """Return the files of the user's code that this run imported, by path, with SHA-256."""
    home = order.plan.files.campaign.path.resolve().parent
    named = {os.path.relpath(path, home): digest for path, digest in all_user_files().items()}
    return dict(sorted(named.items()))


def flies_processes(order: RunOrder) -> bool:
    """Return whether the vehicles of an order's run are processes."""
    return order.clock != "virtual"


def completed_run(order: RunOrder) -> RunResult | None:
    """Return the result that the run of an order wrote before its process was lost, or None."""
    try:
        result = read_result(order.folder / _RESULT)
    except ResultError:
        return None
    plan = order.plan
    flown = (result.case, result.mode, result.rep, result.seed)
    return result if flown == (plan.case, plan.mode, plan.repetition, plan.seed) else None
