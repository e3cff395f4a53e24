"""Flies a campaign: its folder, its runs over worker processes, its summary."""

import asyncio
import signal
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.campaigns.setup.case_setup import FLIES
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.foundation.files.limited_json import read_limited_json
from wil_campaign.foundation.files.problems import printable_problem
from wil_campaign.foundation.processes.interrupts import signals_call
from wil_campaign.foundation.tasks import TaskAccount, raising_first_task_error
from wil_campaign.orchestrator.campaign.between_runs import BetweenRuns
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    FolderTakenError,
    OutputError,
    locked_campaign_folder,
    make_campaign_folder,
    set_run_folder_aside,
    write_campaign_document,
)
from wil_campaign.orchestrator.campaign.folder.flown_files import FlownFiles
from wil_campaign.orchestrator.campaign.folder.manifest import (
    campaign_manifest,
    files_read_by_campaign,
    maybe_written_files,
)
from wil_campaign.orchestrator.campaign.folder.repetitions import runs_due, runs_planned
from wil_campaign.orchestrator.campaign.liftoff_learning import LiftoffLearning
from wil_campaign.orchestrator.campaign.repositioning import Repositioning
from wil_campaign.orchestrator.campaign.resuming.runs_to_fly import (
    ResumedCampaign,
    ResumeRules,
    resume_campaign,
)
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import lost_result, real_runs
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import (
    ResumeError,
    resumed_folder,
    resumed_manifest,
)
from wil_campaign.orchestrator.campaign.sensor_kinds import sensor_kinds
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.campaign.workers.run_output import OUTPUT_FILE, run_output_tail
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.campaign.workers.worker_pool import WorkerPool
from wil_campaign.orchestrator.operator.campaign_controller import CampaignController
from wil_campaign.orchestrator.operator.errors import OperatingError
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.operator.run_messages import News, RunProgressReport
from wil_campaign.orchestrator.run.stages.return_flight import return_plan
from wil_campaign.orchestrator.run.vehicles.preflight_checks import disk_item
from wil_campaign.orchestrator.run_results.attempts import after_attempts, attempt_of, retry_due
from wil_campaign.orchestrator.run_results.campaign_results import Summary, SummaryText, summarize
from wil_campaign.orchestrator.run_results.exit_codes import exit_code, rehearsal_code
from wil_campaign.orchestrator.run_results.junit import junit_xml
from wil_campaign.orchestrator.run_results.result_parts import distinct_firmware
from wil_campaign.orchestrator.run_results.run_result import NOT_ARMED, RunResult
from wil_campaign.orchestrator.state.faults import InternalFaults, fault_log
from wil_campaign.orchestrator.state.run_setup import RunOrder

_NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM", signal.SIGHUP: "SIGHUP"}
"""The signals that land all vehicles and end the campaign; SIGHUP unless ignored, as by nohup."""
_OUTPUT_LINES = 3
"""How many lines of a run's output are shown with a verdict other than PASS."""


class CampaignWatcher(Protocol):
    """Shows a campaign while the runner flies it (protocol)."""

    def progress(self, progress: RunProgressReport) -> None:
        """Show the progress of a run."""

    def finished(self, result: RunResult) -> None:
        """Show a finished run of the campaign."""

    def say(self, text: str) -> None:
        """Show a sentence about the campaign."""

    def settle(self) -> None:
        """Wait until all is shown, a few seconds at most; raise what could not be shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome:
    """The outcome of a flown campaign.

    folder: where its files are. announced: names of the runs whose verdict the watcher has.
    """

    summary: Summary
    folder: Path
    exit_code: int
    announced: frozenset[str] = field(default=frozenset(), compare=False)


def fly_campaign(
    campaign: Campaign,
    options: FlightOptions,
    cleared: ClearedCampaign,
    watcher: CampaignWatcher,
    *,
    batch: Path | None = None,
) -> CampaignOutcome:
    """Fly all runs of a campaign and write its folder.

    Every finished run is on the disk and in summary.json before the next one begins. Ctrl-C and
    SIGTERM land all vehicles, as ABORTED, and end the campaign. batch: the campaign's own folder,
    as one of a series: it is made, or resumed with its cut-off runs flown anew; None: a new one
    beneath `options.out`, named by the time. Raises OutputError, OperatingError, ResumeError,
    EngineError.
    """
    with ExitStack() as stack:
        folder, before, files = _begin(campaign, options, cleared, watcher, stack, batch=batch)
        flight = _Flight(
            campaign, options, cleared, watcher, folder=folder, before=before, files=files
        )
        flight.set_surplus_aside()  # a kill may have come before that
        # From the beginning there is a summary of the runs so far, also in place of an old one.
        flight.write_summary()
        asyncio.run(flight.fly())
        return flight.outcome()


def _begin(
    campaign: Campaign,
    options: FlightOptions,
    cleared: ClearedCampaign,
    watcher: CampaignWatcher,
    stack: ExitStack,
    *,
    batch: Path | None,
) -> tuple[Path, ResumedCampaign, FlownFiles]:
    """Return the campaign's folder, locked until the stack ends, its finished runs, its files."""
    document: Mapping[str, Any] = campaign_manifest(campaign, cleared.clock, arm=options.arm)
    skipped = {*campaign.paths, *maybe_written_files(campaign)}
    files = FlownFiles.of(
        campaign.document.path,
        document["files"],
        read=files_read_by_campaign(campaign),
        skipped=skipped,
    )
    if options.resume:
        folder = resumed_folder(batch or options.out, campaign.name)
        document = resumed_manifest(folder, document)
    else:
        folder = batch or make_campaign_folder(options.out / campaign.name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        stack.enter_context(locked_campaign_folder(folder))
        _require_space(campaign, folder)
        write_campaign_document(folder / "campaign.json", to_json(document))
        if not options.resume:
            return folder, ResumedCampaign(results={}, attempts={}), files
        rules = ResumeRules(
            is_real=real_runs(campaign, cleared.hardware),
            again=options.again,
            repeats_cut_off=batch is not None,
        )
        before = resume_campaign(campaign, folder, rules, say=watcher.say)
        if cleared.engine.reads_files_here:
            _require_same_code(folder, files, before)
    except (FolderTakenError, OSError) as error:
        raise OutputError(str(error)) from error
    watcher.say(
        f"resumed: {len(before.results)} of {len(campaign.plans)} are finished, in {folder}"
    )
    return folder, before, files


def _require_same_code(folder: Path, files: FlownFiles, before: ResumedCampaign) -> None:
    """Raise ResumeError where code of the user's changed that only the finished runs name."""
    try:
        for name, result in before.results.items():
            files.require_code_on_disk(name, result.code)
    except OutputError as error:
        raise ResumeError(f"{folder} cannot be resumed: {error}") from error


def _require_space(campaign: Campaign, folder: Path) -> None:
    """Raise OutputError when the disk has less space than the campaign's preflight demands."""
    wanted = [setup.preflight for setup in campaign.setups.values()]
    least_mb = max(
        [preflight.min_disk_mb for preflight in wanted if "disk" not in preflight.override],
        default=0.0,
    )
    if problem := disk_item(folder, least_mb).text:
        raise OutputError(f"{problem}; free space, or lower preflight.min_disk_mb")


class _Flight:
    """The flight of a whole campaign."""

    def __init__(
        self,
        campaign: Campaign,
        options: FlightOptions,
        cleared: ClearedCampaign,
        watcher: CampaignWatcher,
        *,
        folder: Path,
        before: ResumedCampaign,
        files: FlownFiles,
    ) -> None:
        self._campaign = campaign
        self._options = options
        self._cleared = cleared
        self._watcher = watcher
        self._folder = folder
        self._files = files
        self._changed: OutputError | None = None
        """Why no further run is flown, once a file has changed."""
        self._plans = runs_planned(campaign, arm=options.arm)
        self._results = dict(before.results)
        self._summary_text = SummaryText()
        self._announced: set[str] = set()
        self._attempts = before.attempts
        self._was_broken = before.is_broken
        self._is_real = real_runs(campaign, cleared.hardware)
        self._lost_with_vehicle = ""
        began_s = time.monotonic()
        self._faults = InternalFaults(
            time=lambda: time.monotonic() - began_s,
            log=fault_log(folder / "log.jsonl"),
            take=lambda fault: watcher.say(f"internal error: {fault.text}; see log.jsonl"),
        )
        self._learning = LiftoffLearning(campaign, cleared.clock)
        self._workers = cleared.engine.workers(campaign, folder, self._say)
        if not cleared.engine.reads_files_here:
            # What its nodes get was packed just now; a resumed campaign may have waited minutes.
            files.require_unchanged()
        self._pool = WorkerPool[RunOrder, RunResult](
            jobs=cleared.jobs,
            workers=self._workers,
            report=self._report,
            done=self._finish_run,
            ended_badly=lambda how: self._faults.record(RuntimeError(how), "a worker process"),
            ready=self._ready,
            begun=lambda order, place: self._controller.begun(_flight_name(order), place),
            run_of=_flight_name,
        )
        self._controller = CampaignController(
            campaign=campaign.name,
            folder=folder,
            total=len(self._plans) - len(before.results),
            fleet=self._pool,
            say=self._say,
        )
        self._repositioning = Repositioning(
            vehicles=cleared.hardware or "real", controller=self._controller, say=self._say
        )
        self._between = BetweenRuns(
            campaign=campaign,
            folder=folder,
            hardware=cleared.hardware,
            repositioning=self._repositioning,
            say=self._say,
        )

    async def fly(self) -> None:
        """Fly the campaign's runs on the worker pool until all are finished."""
        loop = asyncio.get_running_loop()
        calls = {number: partial(self._controller.signal, name) for number, name in _NAMES.items()}
        loop.set_exception_handler(self._report_unhandled)
        account = TaskAccount(
            fault=self._faults.record,
            expected=(OutputError, OperatingError, EngineError, OSError, EOFError),
        )
        with signals_call(calls):
            try:
                with raising_first_task_error(OutputError, EngineError), account.of(loop):
                    async with open_operator_channels(self._controller, self._campaign.operators):
                        await self._pool.fly(self._orders())
                    if self._changed is not None:
                        raise self._changed
            finally:
                await self._workers.close()
                self._repositioning.end_wait()
                with self._faults.recording("a message"):
                    self._watcher.settle()

    def _say(self, text: str) -> None:
        """Show a sentence about the campaign; that it cannot be shown must not end a flight."""
        with self._faults.recording("a message"):
            self._watcher.say(text)

    def _report_unhandled(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Record an exception of a callback in the campaign runner's loop."""
        error, where = context.get("exception"), str(context.get("message", ""))
        if not isinstance(error, BaseException):
            error = RuntimeError(where)
        self._faults.record(error, where)

    @property
    def _is_broken(self) -> bool:
        """Return whether an internal exception came up beside the runs, now or before resuming."""
        return self._was_broken or bool(self._faults.all)

    def outcome(self) -> CampaignOutcome:
        """Return the campaign's outcome: summary and exit code."""
        summary = self.write_summary(has_ended=True)
        flown = (*summary.runs, *summary.controls)
        stopped, broken = self._controller.ended_by, self._is_broken
        code = exit_code(
            flown,
            self._campaign.requirements,
            stopped=stopped,
            broken=broken,
            controls_due=len(self._campaign.controls),
            missing=self._missing(),
        )
        if not self._options.arm and stopped is None and not broken:
            code = rehearsal_code(summary.runs)
        return CampaignOutcome(
            summary=summary,
            folder=self._folder,
            exit_code=code,
            announced=frozenset(self._announced),
        )

    def _orders(self) -> Iterable[RunOrder]:
        plans: Sequence[RunPlan] = self._plans
        if self._cleared.jobs > 1:
            # Pairs take longest, so they start first; else the last one would occupy a single core.
            plans = sorted(plans, key=lambda plan: plan.mode != "wil")
        for plan in plans:
            if plan.name not in self._results:
                yield RunOrder(
                    plan=replace(plan, files=plan.files.alone(plan.case)),
                    folder=self._folder / plan.name,
                    clock=self._cleared.clock,
                    attempts=self._attempts.get(plan.name, ()),
                    arm=self._options.arm,
                    campaign=self._folder,
                    uids=self._cleared.uids,
                )

    def _ready(self, order: RunOrder) -> RunOrder | None:
        """Return an order with the liftoff delays known by now; None if it is no longer needed.

        Raises EngineError after a run was lost with a real vehicle: its guard may still be landing
        it, and a person has to inspect it. None for all runs once a file that they would read has
        changed; what flies is flown to its end.
        """
        if self._lost_with_vehicle:
            raise EngineError(
                f"{self._lost_with_vehicle} was lost with a real vehicle: no further runs are "
                "flown; inspect the vehicle, then start again with --resume"
            )
        if order.back is None and not self._is_due(order.plan):
            return None
        return None if self._have_files_changed() else self._learning.ready(order)

    def _have_files_changed(self) -> bool:
        """Return whether a file that each run loads is no longer what it was."""
        if self._changed is None and self._cleared.engine.reads_files_here:
            try:
                self._files.require_unchanged()
            except OutputError as error:
                self._changed = error
        return self._changed is not None

    def _check_code(self, run: str, result: RunResult) -> None:
        """Keep that no further run is flown, where a run imported other code than those before."""
        try:
            self._files.require_same_code(run, result.code)
        except OutputError as error:
            self._changed = self._changed or error

    def _due(self) -> list[RunPlan]:
        """Return the runs that count: a sequential test may have decided before the last."""
        return runs_due(self._plans, self._campaign.test, self._results)

    def _is_due(self, plan: RunPlan) -> bool:
        """Return whether a run counts by what is known now."""
        return plan.name in {run_plan.name for run_plan in self._due()}

    def set_surplus_aside(self) -> None:
        """Set aside runs that were in flight when an earlier repetition decided.

        Raises OutputError.
        """
        due = {plan.name for plan in self._due()}
        for name in [name for name in self._results if name not in due]:
            del self._results[name]
            try:
                place = set_run_folder_aside(self._folder, name).relative_to(self._folder)
            except OSError as error:
                raise OutputError(f"{self._folder / name} cannot be set aside: {error}") from error
            self._say(f"{name}: flown after the decision, does not count; kept in {place}")

    def _report(self, news: News) -> None:
        """Pass a run's progress on to the campaign's operators and watcher."""
        # A fault of a display must not end a flight.
        with self._faults.recording("progress"):
            self._controller.news(news)
        if isinstance(news, RunProgressReport):
            self._repositioning.end_wait()
            if news.case in self._campaign.setups:  # a return flight is no run
                with self._faults.recording("progress"):
                    self._watcher.progress(news)

    def _finish_run(self, order: RunOrder, outcome: RunResult | WorkerLost) -> RunOrder | None:
        """Handle the outcome of an order; return a further one: a retry or a return flight."""
        if order.back is not None:
            self._controller.left(_flight_name(order))
            self._between.check_return(order, outcome)
            return None
        if isinstance(outcome, WorkerLost):
            result = after_attempts(lost_result(order.plan, outcome, order.folder), order.attempts)
            if not (order.folder / "result.json").exists():  # another program may have flown it
                write_campaign_document(order.folder / "result.json", to_json(result))
            if outcome.details:
                write_campaign_document(order.folder / "error.txt", outcome.details)
                fault_log(order.folder / "log.jsonl")(outcome.fault)
        else:
            result = outcome
        self._learning.learn(order.plan, result)
        self._check_code(order.plan.name, result)
        following = self._retry_run(order, result)
        if following is None:
            self._results[order.plan.name] = result
            self.set_surplus_aside()
        self.write_summary()
        flown = result.duration_s is not None or isinstance(outcome, WorkerLost)
        if following is None:
            self._controller.finished(
                result, may_end=self._options.arm or result.reason != NOT_ARMED
            )
            with self._faults.recording("a verdict"):
                self._watcher.finished(result)
                self._announced.add(order.plan.name)
                if result.verdict != "PASS":
                    self._show_output(order)
        if isinstance(outcome, WorkerLost) and self._is_real(order.plan):
            self._lost_with_vehicle = order.plan.name
        elif following is None:
            following = self._between_runs(order, result, flown=flown)
        return following

    def _between_runs(self, order: RunOrder, result: RunResult, *, flown: bool) -> RunOrder | None:
        """Return the flight back after a run, if one is due; flown: whether the run may have flown.

        A person may be asked instead, before the next run; not where nothing is armed.
        """
        coming = [plan for plan in self._due() if plan.name not in self._results]
        if not coming or not self._options.arm:
            return None
        return self._between.after(order, result, coming=coming, flown=flown)

    def _show_output(self, order: RunOrder) -> None:
        lines = run_output_tail(order.folder, _OUTPUT_LINES)
        if lines:
            self._say(f"{order.plan.name}: {order.folder / OUTPUT_FILE} ends with")
        for line in lines:
            self._say(f"  {printable_problem(line)}")

    def _retry_run(self, order: RunOrder, result: RunResult) -> RunOrder | None:
        """Set a run's files aside and return the order to fly it once more; None if none is due.

        Until it ends again the run has no result, and a sequential test waits for it.
        """
        # With hardware a person inspects the vehicle before a retry, or puts it back.
        setup = self._campaign.setups[order.plan.case]
        is_put_back = self._campaign.between is not None and any(
            flown.attached is not None for flown in setup.flown_in(order.plan.mode)
        )
        retries = 0 if self._cleared.hardware or is_put_back else order.plan.retries
        is_due = retry_due(result, retries=retries)
        if retries and result.no_retry:
            self._say(f"{order.plan.name}: {result.verdict}, not flown again: {result.no_retry}")
        if not is_due or self._controller.stopped is not None or not self._is_due(order.plan):
            return None
        try:
            place = str(
                set_run_folder_aside(self._folder, order.plan.name).relative_to(self._folder)
            )
        except OSError as error:
            raise OutputError(f"{order.folder} cannot be set aside: {error}") from error
        self._say(f"{order.plan.name}: {result.verdict}, {result.reason}; flown again")
        return replace(order, attempts=(*order.attempts, attempt_of(result, place)))

    def _missing(self) -> int:
        """Return how many required runs of the campaign have no result."""
        return sum(plan.required and plan.name not in self._results for plan in self._due())

    def write_summary(self, *, has_ended: bool = False) -> Summary:
        """Write the campaign's summary.json and junit.xml so far. Raises OutputError.

        has_ended: the campaign is over. A summary written before that is never accepted as a
        success: the campaign may be killed and leave it behind.
        """
        plans = self._due()
        runs = [self._results[plan.name] for plan in plans if plan.name in self._results]
        summary = summarize(
            [_with_artifact_paths(run) for run in runs],
            self._campaign.requirements,
            campaign=self._campaign.name,
            clock=self._cleared.clock,
            surrogate=self._cleared.real_kind == "embedded"
            and any("real" in FLIES[plan.mode] for plan in plans),
            real_kind=self._cleared.real_kind,
            sensors=sensor_kinds(self._campaign),
            left_out=self._campaign.left_out,
            stopped=self._controller.ended_by,
            broken=self._is_broken if has_ended or self._is_broken else None,
            controls_due=len(self._campaign.controls),
            missing=self._missing(),
            caveats=self._campaign.caveats,
            not_flown=tuple(plan.name for plan in plans if plan.name not in self._results),
        )
        write_campaign_document(self._folder / "summary.json", self._summary_text.text(summary))
        if has_ended:
            self._record_firmware(summary)
        junit = junit_xml(summary, self._campaign.requirements, arm=self._options.arm)
        write_campaign_document(self._folder / "junit.xml", junit)
        if self._options.junit is not None:
            write_campaign_document(self._options.junit, junit)
        return summary

    def _record_firmware(self, summary: Summary) -> None:
        """Add the firmware that flew to campaign.json. Raises OutputError."""
        path = self._folder / "campaign.json"
        runs = (*summary.runs, *summary.controls)
        flown = distinct_firmware(flown_firmware for run in runs for flown_firmware in run.firmware)
        try:
            document = read_limited_json(path)
        except (OSError, ValueError):  # lost or damaged while it flew: the results have it
            return
        if isinstance(document, dict) and flown:
            document["firmware"] = [asdict(flown_firmware) for flown_firmware in flown]
            write_campaign_document(path, to_json(document))


def _flight_name(order: RunOrder) -> str:
    """Return the name by which an order's flight reports, and by which commands address it."""
    return (order.plan if order.back is None else return_plan(order.plan)).name


def _with_artifact_paths(run: RunResult) -> RunResult:
    prefix = f"{run.case}/{run.mode}/{run.rep}"
    return replace(run, artifacts=tuple(f"{prefix}/{name}" for name in run.artifacts))
