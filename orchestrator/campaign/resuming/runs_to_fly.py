"""Sorts the runs of a resumed campaign: finished, lost with their program, or flown again.

Internal exceptions beside the runs of a campaign, before it was resumed: they stay with it.
"""

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from wil_campaign.campaigns.expansion.expansion import Campaign, RunPlan
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.foundation.files.limited_json import loads_limited_json
from wil_campaign.hooks import engines
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    FolderTakenError,
    OutputError,
    earlier_attempt_folders,
    locked_run_folder,
    make_run_folder,
    set_run_folder_aside,
)
from wil_campaign.orchestrator.campaign.folder.repetitions import runs_due
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import (
    OpenOrder,
    campaign_places,
    close_order,
    open_orders,
)
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import (
    IsReal,
    killed_program_text,
    lost_result,
)
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.campaign.workers.run_workers import WorkerLost
from wil_campaign.orchestrator.run_results.attempts import (
    after_attempts,
    attempt_of,
    failed_too_text,
    is_cut_off,
    retry_due,
)
from wil_campaign.orchestrator.run_results.campaign_results import is_same_result
from wil_campaign.orchestrator.run_results.result_reader import (
    ResultError,
    read_result,
    read_summary,
)
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt, RunResult
from wil_campaign.orchestrator.state.run_log import read_cut_log


def earlier_fault(folder: Path) -> str:
    """Return the first internal exception beside a campaign's runs so far, in words; "" for none.

    A killed campaign may have it in its log alone, and one with a full disk in summary.json alone.
    Raises OSError.
    """
    log = folder / "log.jsonl"
    if log.is_file():
        with log.open("rb") as lines:
            if text := next(filter(None, map(_fault_text, lines)), ""):
                return f"{text}; see {log}"
    try:
        is_broken = read_summary(folder / "summary.json").broken
    except ResultError:
        return ""  # the campaign was killed before it had one: then the log has them all
    return f"stated in {folder / 'summary.json'}" if is_broken else ""


def _fault_text(line: bytes) -> str:
    """Return the internal exception in a line of a campaign's log, in words; "" for another event.

    A line that was cut off counts as one: the log of a campaign has nothing else.
    """
    try:
        event = loads_limited_json(line)
        if event["event"] != "error":
            return ""
        return f"{event['where']}: {event['type']}: {event['message']}"
    except (ValueError, KeyError, TypeError):
        return "a line of its log that is damaged"


_LANDED_S = 120.0
"""How long a run of a killed campaign may take to land."""
_POLL_S = 0.2
_CUT_OFF = "it has no result"
_COUNTED = frozenset({"PASS", "FAIL"})
_RESULT, _DAMAGED = "result.json", "result.damaged.json"

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumedCampaign:
    """The results of a resumed campaign, by run. attempts: earlier ones at the other runs.

    is_broken: an internal exception came up beside its runs before it was resumed.
    """

    results: Mapping[str, RunResult]
    attempts: Mapping[str, tuple[EarlierAttempt, ...]]
    is_broken: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumeRules:
    """Which runs of a campaign are flown again, beside those that have retries left.

    is_real: runs that are not flown again automatically. again: runs that a person has named.
    repeats_cut_off: a simulated run that was cut off in flight is flown again even if it had a
    verdict by then; a search needs this, because its next proposal depends on the complete flight.
    """

    is_real: IsReal = lambda _: False
    again: Collection[str] = ()
    repeats_cut_off: bool = False


def resume_campaign(
    campaign: Campaign, folder: Path, rules: ResumeRules, *, say: Say
) -> ResumedCampaign:
    """Return the finished runs of a resumed campaign; set aside those that are flown again.

    A run with a real vehicle that began and has no result is lost: its ERROR is on the disk before
    anything flies. Raises ResumeError, OutputError, OSError.
    """
    _fetch_runs(folder, say)
    return _RunsToFly(campaign, folder, rules, say, open_orders(folder)).resume()


def _fetch_runs(folder: Path, say: Say) -> None:
    """Have engines fetch the runs that they flew elsewhere. Raises ResumeError, OutputError."""
    if not campaign_places(folder):
        return
    fetches = [engine.fetch for engine in plugin_additions(engines).values() if engine.fetch]
    if not fetches:
        why = "; ".join(absent_additions(engines).values()) or "no plugin's engine can fetch them"
        raise ResumeError(f"{folder} has runs in a store: {why}")
    for fetch in fetches:
        load_plugin_object(fetch)(folder, say=say)


@dataclass(frozen=True, slots=True)
class _RunsToFly:
    """A campaign while it is resumed. orders: those without an outcome in its ledger."""

    campaign: Campaign
    folder: Path
    rules: ResumeRules
    say: Say
    orders: Mapping[str, OpenOrder]
    results: dict[str, RunResult] = field(default_factory=dict)
    attempts: dict[str, tuple[EarlierAttempt, ...]] = field(default_factory=dict)

    def resume(self) -> ResumedCampaign:
        """Return the folder's results. Raises ResumeError, OutputError, OSError."""
        for plan in self.campaign.plans:
            home = self.folder / plan.name
            if home.is_dir():
                _await_landing(home, self.say)
        results = {plan.name: _read_finished(self.folder / plan.name, plan) for plan in self._plans}
        self._require_repeatable(results)
        self._require_own_results(results)
        lost: list[tuple[RunPlan, str]] = []
        for plan in self._plans:
            result, earlier = results[plan.name], self._earlier_attempts(plan)
            if isinstance(result, RunResult) and not self._is_flown_again(plan, result):
                self._keep_result(plan, result)
            elif what := self._loss_text(plan, result, earlier):
                lost.append((plan, what))
            else:
                self._plan_flight(plan, result, earlier)
        for plan, what in lost:
            # After the decision of a sequential test no run counts, lost or not.
            due = runs_due(self._plans, self.campaign.test, self.results)
            if plan.name in {run_plan.name for run_plan in due}:
                self._record_loss(plan, what)
            elif (order := self.orders.get(plan.name)) is not None:
                close_order(self.folder, order, "lost", f"{what}; it does not count")
        fault = earlier_fault(self.folder)
        if fault:
            self.say(
                f"an internal exception came up before the campaign was resumed ({fault}): it "
                "ends with exit code 3 and is not accepted, whatever its runs end with; to have it "
                "accepted, fly it anew, without --resume"
            )
        return ResumedCampaign(results=self.results, attempts=self.attempts, is_broken=bool(fault))

    @property
    def _plans(self) -> tuple[RunPlan, ...]:
        return self.campaign.plans

    def _require_repeatable(self, results: Mapping[str, RunResult | str]) -> None:
        """Raise ResumeError for a run of --again that does not exist, or has a PASS or FAIL."""
        for name in self.rules.again:
            result = results.get(name)
            if result is None:
                raise ResumeError(f"--again {name}: the campaign has no such run")
            if isinstance(result, RunResult) and result.verdict in _COUNTED:
                raise ResumeError(
                    f"--again {name}: it is {result.verdict}, which counts; only a run without "
                    "PASS or FAIL can be flown again"
                )
            why = result.no_retry if isinstance(result, RunResult) else self._failure(name, result)
            if why:
                raise ResumeError(f"--again {name}: {why}; such a run is not flown again")

    def _require_own_results(self, results: Mapping[str, RunResult | str]) -> None:
        """Raise ResumeError for a result that is not what summary.json has, or for a lost FAIL.

        A kill may come before the summary: it may lack a run, or a later attempt at one. A person
        may have brought the result of a run that was lost.
        """
        try:
            summary = read_summary(self.folder / "summary.json")
        except ResultError:
            return
        counted = [run for run in (*summary.runs, *summary.controls) if run.verdict in _COUNTED]
        for run in counted:
            name = f"{run.case}/{run.mode}/{run.rep}"
            result = results.get(name, "")
            if isinstance(result, RunResult):
                is_later = len(result.attempts) > len(run.attempts)
                is_own = is_later or is_same_result(run, result)
            else:
                is_set_aside = bool(earlier_attempt_folders(self.folder, name))
                is_own = run.verdict != "FAIL" or is_set_aside or bool(self._failure(name, result))
            if not is_own:
                raise ResumeError(
                    f"{self.folder / name / _RESULT} is not the result that summary.json has "
                    f"({run.verdict}): restore it, or start the campaign anew, without --resume"
                )

    def _is_flown_again(self, plan: RunPlan, result: RunResult) -> bool:
        if plan.name in self.rules.again:
            return True
        # After Ctrl-C or the death of its parent, a run was not flown to its end.
        is_due = result.verdict == "ABORTED" and not result.no_retry
        is_due = is_due or self._was_cut_off(result)
        is_due = is_due or retry_due(result, retries=plan.retries)
        return is_due and not self.rules.is_real(plan)

    def _was_cut_off(self, result: RunResult) -> bool:
        """Return whether a run was cut off after its verdict, and has to be flown to its end."""
        return self.rules.repeats_cut_off and is_cut_off(result)

    def _loss_text(
        self, plan: RunPlan, result: RunResult | str, earlier: list[EarlierAttempt]
    ) -> str:
        """Return what is known about a begun run that may not be flown again; "" for others."""
        if isinstance(result, str) and self._failure(plan.name, result):
            return result
        if plan.name in self.rules.again or not self.rules.is_real(plan):
            return ""
        if isinstance(result, str) and result:
            return result
        if earlier:
            return "it had been set aside for another flight"
        order = self.orders.get(plan.name)
        return "" if order is None else f"it was ordered from {order.node} and has no folder"

    def _failure(self, name: str, result: str) -> str:
        """Return why a run without a result is not flown again by its log; "" where it may be.

        A search flies it again, as it needs the complete flight.
        """
        if not result or self.rules.repeats_cut_off:
            return ""
        log = read_cut_log(self.folder / name / "log.jsonl")
        return next(
            (
                failed_too_text(decisive_event.text)
                for decisive_event in log.decisive
                if decisive_event.kind == "FAIL"
            ),
            "",
        )

    def _earlier_attempts(self, plan: RunPlan) -> list[EarlierAttempt]:
        places = earlier_attempt_folders(self.folder, plan.name)
        return [self._attempt_in(place) for place in places]

    def _attempt_in(self, place: Path) -> EarlierAttempt:
        """Return the earlier attempt in a folder that was set aside."""
        name = str(place.relative_to(self.folder))
        try:
            return self._attempt_of(read_result(place / _RESULT), name)
        except ResultError:
            return EarlierAttempt(None, _CUT_OFF, name)

    def _attempt_of(self, result: RunResult, place: str) -> EarlierAttempt:
        """Return a result as an earlier attempt; one that was cut off does not count as a retry."""
        if result.verdict != "ABORTED" and self._was_cut_off(result):
            return EarlierAttempt(
                None, f"in flight, after {result.verdict}: {result.reason}", place
            )
        return attempt_of(result, place)

    def _keep_result(self, plan: RunPlan, result: RunResult) -> None:
        """Count a result, and close its order in the ledger."""
        self.results[plan.name] = result
        if (order := self.orders.get(plan.name)) is not None:
            close_order(self.folder, order, "found", result.verdict)

    def _plan_flight(
        self, plan: RunPlan, result: RunResult | str, earlier: list[EarlierAttempt]
    ) -> None:
        """Plan the flight of a run; set aside what an earlier flight has left."""
        why = "it had not begun"
        if result:
            place = set_run_folder_aside(self.folder, plan.name).relative_to(self.folder)
            last = (
                EarlierAttempt(None, result, str(place))
                if isinstance(result, str)
                else self._attempt_of(result, str(place))
            )
            why = f"{last.verdict or 'cut off'}, {last.reason}; kept in {place}"
            self.say(f"{plan.name}: {why}")
            earlier.append(last)
        self.attempts[plan.name] = tuple(earlier)
        if (order := self.orders.get(plan.name)) is not None:
            close_order(self.folder, order, "lost", why)

    def _record_loss(self, plan: RunPlan, what: str) -> None:
        """Count a run as lost, and write its result."""
        home = self.folder / plan.name
        why = killed_program_text(plan.name, what, failure=self._failure(plan.name, what))
        lost = lost_result(plan, WorkerLost(why), home)
        result = after_attempts(lost, self._earlier_attempts(plan))
        make_run_folder(home, plan.name)
        if (home / _RESULT).exists():
            (home / _RESULT).rename(home / _DAMAGED)
        write_atomically(home / _RESULT, to_json(result))
        self.results[plan.name] = result
        if (order := self.orders.get(plan.name)) is not None:
            close_order(self.folder, order, "lost", why)
        self.say(f"{plan.name}: {result.verdict}, {result.reason}")


def _read_finished(home: Path, plan: RunPlan) -> RunResult | str:
    """Return a run's result, or in words why it has none; "" for a run that has not begun."""
    if not home.is_dir() or not any(home.iterdir()):
        return ""
    if not (home / _RESULT).exists():
        return _CUT_OFF
    try:
        result = read_result(home / _RESULT)
    except ResultError as error:
        return str(error)
    wanted = (plan.case, plan.mode, plan.repetition, plan.seed, plan.required)
    if (result.case, result.mode, result.rep, result.seed, result.required) != wanted:
        return f"{home / _RESULT} belongs to another run"
    return result


def _await_landing(home: Path, say: Say) -> None:
    """Wait until no process uses a run's folder. Raises OutputError."""
    is_reported = False
    for _ in range(round(_LANDED_S / _POLL_S)):
        try:
            with locked_run_folder(home):
                return
        except FolderTakenError:
            if not is_reported:
                say(f"{home} is still in flight: waiting until it has landed")
                is_reported = True
            time.sleep(_POLL_S)
    raise OutputError(f"{home} is still in flight after {_LANDED_S:g} s; see wil-campaign watch")
