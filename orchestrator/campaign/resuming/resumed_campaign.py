"""What a resumed campaign has already, what is flown again, and what was lost with its program."""

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from campaigns.expansion.expansion import Campaign, RunPlan
from orchestrator.campaign.folder.campaign_folder import (
    OutputError,
    TakenError,
    earlier_folders,
    held,
    make_run_folder,
    set_aside,
)
from orchestrator.campaign.folder.repetitions import runs_due
from orchestrator.campaign.resuming.lost_runs import IsReal, killed_program_text, lost_result
from orchestrator.campaign.resuming.resumption import ResumeError
from orchestrator.campaign.resuming.run_ledger import OpenOrder, close_order, open_orders
from orchestrator.campaign.resuming.unfetched_runs import fetch_stored_runs
from orchestrator.campaign.workers.run_workers import WorkerLost
from orchestrator.model.attempts import after_attempts, attempt_of, is_cut_off, retry_due
from orchestrator.model.document_writer import to_json, write_whole
from orchestrator.model.results import Attempt, RunResult
from orchestrator.model.results_reader import ResultError, read_result

_LANDED_S = 120.0
"""How long a run of a campaign that was killed may go on: it lands, for its parent has died."""
_LOOK_S = 0.2
_CUT_OFF = "it has no result"
_RESULT, _DAMAGED = "result.json", "result.damaged.json"

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumedCampaign:
    """What a resumed campaign has already, by run. attempts: at those still to be flown."""

    results: Mapping[str, RunResult]
    attempts: Mapping[str, tuple[Attempt, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumeRules:
    """What of a campaign is flown again. retries: of the campaign.

    is_real: of whose runs none is flown again by itself. again: runs that a person has named.
    repeats_cut_off: a simulated run that was cut off in flight is flown again whatever it had come
    to by then, as a search needs it: what it proposes next depends on how the flight ends.
    """

    retries: int = 0
    is_real: IsReal = lambda _: False
    again: Collection[str] = ()
    repeats_cut_off: bool = False


def resume_campaign(
    campaign: Campaign, folder: Path, rules: ResumeRules, *, say: Say
) -> ResumedCampaign:
    """Return the finished runs of a resumed campaign; set aside what is flown again.

    A run with a real vehicle that was begun and has no result is lost: ERROR, on the disk before
    anything flies. Raises ResumeError, OutputError, OSError.
    """
    fetch_stored_runs(folder, say=say)
    return _Resumption(campaign, folder, rules, say, open_orders(folder)).resume()


@dataclass(frozen=True, slots=True)
class _Resumption:
    """A campaign while it is resumed. orders: that its ledger has no outcome of."""

    campaign: Campaign
    folder: Path
    rules: ResumeRules
    say: Say
    orders: Mapping[str, OpenOrder]
    results: dict[str, RunResult] = field(default_factory=dict)
    attempts: dict[str, tuple[Attempt, ...]] = field(default_factory=dict)

    def resume(self) -> ResumedCampaign:
        """Return what the folder has. Raises ResumeError, OutputError, OSError."""
        for plan in self.campaign.plans:
            home = self.folder / plan.name
            if home.is_dir():
                _wait_for(home, self.say)
        found = {plan.name: _find_results(self.folder / plan.name, plan) for plan in self._plans}
        self._require_named(found)
        lost: list[tuple[RunPlan, str]] = []
        for plan in self._plans:
            one, earlier = found[plan.name], self._earlier(plan)
            if isinstance(one, RunResult) and not self._is_flown_again(plan, one):
                self._keep(plan, one)
            elif what := self._begun(plan, one, earlier):
                lost.append((plan, what))
            else:
                self._clear(plan, one, earlier)
        for plan, what in lost:
            # Beyond the decision of a sequential test nothing counts, lost or not.
            due = runs_due(self._plans, self.campaign.test, self.results)
            if plan.name in {one.name for one in due}:
                self._lose(plan, what)
            elif (order := self.orders.get(plan.name)) is not None:
                close_order(self.folder, order, "lost", f"{what}; it does not count")
        return ResumedCampaign(results=self.results, attempts=self.attempts)

    @property
    def _plans(self) -> tuple[RunPlan, ...]:
        return self.campaign.plans

    def _require_named(self, found: Mapping[str, RunResult | str]) -> None:
        """Raise ResumeError for a named run that there is not, or that has proved something."""
        for name in self.rules.again:
            one = found.get(name)
            if one is None:
                raise ResumeError(f"--again {name}: the campaign has no such run")
            if isinstance(one, RunResult) and one.verdict in {"PASS", "FAIL"}:
                raise ResumeError(
                    f"--again {name}: it is {one.verdict}, which stays; only what proved nothing "
                    "is flown again"
                )

    def _is_flown_again(self, plan: RunPlan, result: RunResult) -> bool:
        """Return whether a run that has a result is flown again."""
        if plan.name in self.rules.again:
            return True
        # Whose parent died, or whose operator pressed Ctrl-C, was not tried to its end.
        wants = result.verdict == "ABORTED" or self._was_cut_off(result)
        wants = wants or retry_due(result, retries=self.rules.retries)
        return wants and not self.rules.is_real(plan)

    def _was_cut_off(self, result: RunResult) -> bool:
        """Return whether a run was cut off after its verdict, and is to be flown to its end."""
        return self.rules.repeats_cut_off and is_cut_off(result)

    def _begun(self, plan: RunPlan, found: RunResult | str, earlier: list[Attempt]) -> str:
        """Return what was begun of a run that may not be flown again; "" for one that may."""
        if plan.name in self.rules.again or not self.rules.is_real(plan):
            return ""
        if isinstance(found, str) and found:
            return found
        if earlier:
            return "it had been set aside for another flight"
        order = self.orders.get(plan.name)
        return "" if order is None else f"it was ordered from {order.node} and has no folder"

    def _earlier(self, plan: RunPlan) -> list[Attempt]:
        places = earlier_folders(self.folder, plan.name)
        return [self._attempt_in(place) for place in places]

    def _attempt_in(self, place: Path) -> Attempt:
        """Return the earlier attempt in a folder that the resumption sets aside."""
        name = str(place.relative_to(self.folder))
        try:
            return self._attempt_of(read_result(place / _RESULT), name)
        except ResultError:
            return Attempt(None, _CUT_OFF, name)

    def _attempt_of(self, result: RunResult, place: str) -> Attempt:
        """Return a result as an earlier attempt; one that was cut off has spent no retry."""
        if result.verdict != "ABORTED" and self._was_cut_off(result):
            return Attempt(None, f"in flight, after {result.verdict}: {result.reason}", place)
        return attempt_of(result, place)

    def _keep(self, plan: RunPlan, result: RunResult) -> None:
        """Have a result count; the ledger has it, too."""
        self.results[plan.name] = result
        if (order := self.orders.get(plan.name)) is not None:
            close_order(self.folder, order, "found", result.verdict)

    def _clear(self, plan: RunPlan, found: RunResult | str, earlier: list[Attempt]) -> None:
        """Have a run flown; what there is of it is set aside."""
        why = "it had not begun"
        if found:
            place = set_aside(self.folder, plan.name).relative_to(self.folder)
            last = (
                Attempt(None, found, str(place))
                if isinstance(found, str)
                else self._attempt_of(found, str(place))
            )
            why = f"{last.verdict or 'cut off'}, {last.reason}; kept in {place}"
            self.say(f"{plan.name}: {why}")
            earlier.append(last)
        self.attempts[plan.name] = tuple(earlier)
        if (order := self.orders.get(plan.name)) is not None:
            close_order(self.folder, order, "lost", why)

    def _lose(self, plan: RunPlan, what: str) -> None:
        """Have a run count as lost, on the disk."""
        home, why = self.folder / plan.name, killed_program_text(plan.name, what)
        result = after_attempts(lost_result(plan, WorkerLost(why)), self._earlier(plan))
        make_run_folder(home, plan.name)
        if (home / _RESULT).exists():
            (home / _RESULT).rename(home / _DAMAGED)
        write_whole(home / _RESULT, to_json(result))
        self.results[plan.name] = result
        if (order := self.orders.get(plan.name)) is not None:
            close_order(self.folder, order, "lost", why)
        self.say(f"{plan.name}: ERROR, {result.reason}")


def _find_results(home: Path, plan: RunPlan) -> RunResult | str:
    """Return a run's result to resume with; or in words why it is unusable; "" for none."""
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
        return f"{home / _RESULT} is of another run"
    return result


def _wait_for(home: Path, say: Say) -> None:
    """Wait until no process flies into the folder to resume. Raises OutputError."""
    told = False
    for _ in range(round(_LANDED_S / _LOOK_S)):
        try:
            with held(home):
                return
        except TakenError:
            if not told:
                say(f"{home} is still in flight: waiting until it has landed")
                told = True
            time.sleep(_LOOK_S)
    raise OutputError(
        f"{home} is being flown still, after {_LANDED_S:g} s; look: wil-campaign watch"
    )
