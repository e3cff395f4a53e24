"""Flies a search: resumes from its ledger, flies batches, writes the findings.

A campaign file for a confirmed failure, which `wil-campaign run` flies.
"""

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from wil_campaign.campaigns.expansion.expansion import RunPlan
from wil_campaign.campaigns.schema import matrix_keys
from wil_campaign.campaigns.setup.overrides import Override
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.foundation.files.documents import Data
from wil_campaign.foundation.files.yaml_nodes import plain_value_of_node
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    FolderTakenError,
    OutputError,
    locked_campaign_folder,
    make_campaign_folder,
)
from wil_campaign.orchestrator.campaign.folder.flown_files import FlownFiles
from wil_campaign.orchestrator.campaign.folder.manifest import (
    campaign_manifest,
    files_read_by_campaign,
    maybe_written_files,
)
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import (
    ResumeError,
    resumed_folder,
    resumed_manifest,
)
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.orchestrator.cli.arming_consent import FlightRefusedError
from wil_campaign.orchestrator.run_results.attempts import ended_attempts, passed_text
from wil_campaign.orchestrator.run_results.run_result import RunResult, Stop
from wil_campaign.plugins.search.engine import SearchEngine
from wil_campaign.plugins.search.exploration.learning_strategies import make_strategy
from wil_campaign.plugins.search.exploration.model import (
    FailingCase,
    FlightBatch,
    FlightOutcome,
    SearchFindings,
    SearchFlightPlan,
)
from wil_campaign.plugins.search.exploration.search import Search, failure_name
from wil_campaign.plugins.search.exploration.search_campaign import (
    SearchCampaign,
    override_by_parameter,
)
from wil_campaign.plugins.search.exploration.strategies import SearchStrategy
from wil_campaign.plugins.search.ledger import SearchLedger
from wil_campaign.plugins.search.search_document import FILE_NAME, search_document
from wil_campaign.plugins.search.sensed_views import sensed_views

FOLDER = "failures"
_LEFT_OUT = ("accept", "controls", "published", "retries")
_LONGEST_NAME = 64
_PATH_KEY = "build"
"""The key whose bare names are always paths; those of other keys may be names of other things."""


def failure_text(search: SearchCampaign, case: FailingCase, folder: Path) -> str:
    """Return the campaign file of a confirmed failure, as reduced. folder: of the new file.

    It has the search's seed, the case's name and as many repetitions as confirmed it, so that its
    flights are the same; all are required. Files that it names stay where they are.
    """
    name = failure_name(case.reduced)
    data = search.document.data
    campaign = dict(data) if isinstance(data, dict) else {}
    for key in _LEFT_OUT:
        campaign.pop(key, None)
    campaign["campaign"] = f"{search.campaign.name[: _LONGEST_NAME - len(name) - 1]}-{name}"
    cause = case.causes_text or "no cause is known"
    campaign["description"] = f"A failure that a search found: {cause}"
    campaign["modes"] = [case.mode]
    campaign["repetitions"] = search.part.confirm.flights
    campaign["seed"] = search.campaign.seed
    home = search.document.path.parent
    relocated = {
        key: _relocate_paths(value, home, folder, key=key) for key, value in campaign.items()
    }
    relocated["cases"] = {name: _case_overrides(search, case, folder)}
    text = yaml.safe_dump(relocated, sort_keys=False, allow_unicode=True, width=100)
    return _comment(case) + text


def _comment(case: FailingCase) -> str:
    return (
        f"# Found by a search as {case.variant.name}; failed in {case.reduced_failed} of "
        f"{case.reduced_proven} flights in mode {case.mode} by {case.reduced_causes_text}.\n"
    )


def _case_overrides(search: SearchCampaign, case: FailingCase, folder: Path) -> dict[str, Data]:
    """Return the overrides of the failing case: the base case's, the options', the variant's."""
    home = search.document.path.parent
    given = (*search.case_overrides, *search.option_overrides)
    changed = search.overrides(case.reduced.values).items()
    values: list[tuple[Override, Data]] = [
        (override, plain_value_of_node(override.entry.node)) for override in given
    ]
    values += [(override_by_parameter(key, value), value) for key, value in changed]
    return {
        key: _relocate_paths(value, home, folder, key=key) if override.file == "campaign" else value
        for override, value in values
        if (key := override.dotted_key).partition(".")[0] not in matrix_keys()
    }


def _relocate_paths(value: Data, home: Path, folder: Path, *, key: str) -> Data:
    """Return a value with relative paths relative to another folder than the campaign's.

    key: of the value, dotted.
    """
    if isinstance(value, dict):
        return {
            name: _relocate_paths(inner, home, folder, key=name) for name, inner in value.items()
        }
    if isinstance(value, list):
        return [_relocate_paths(inner, home, folder, key=key) for inner in value]
    if not isinstance(value, str) or not _may_be_relative_path(value, key):
        return value
    name, colon, inside = value.rpartition(":") if ".py:" in value else (value, "", "")
    with suppress(OSError, ValueError):  # a text that is no path
        path = (home / name).resolve()
        if path.exists():
            return f"{os.path.relpath(path, folder.resolve())}{colon}{inside}"
    return value


def _may_be_relative_path(text: str, key: str) -> bool:
    """Return whether a text may be a relative path: `px4` names a folder in `build` alone."""
    if not text.strip("./"):
        return False  # as a separator; it names a folder everywhere
    is_bare = "." not in text and "/" not in text
    return not Path(text).is_absolute() and (not is_bare or key.rpartition(".")[2] == _PATH_KEY)


SEARCHES = "search"
"""The folder of a campaign's searches, beneath its results."""
_FLIGHTS = "flights"
_STOPPED: Mapping[Stop, str] = {
    "signal": "Ctrl-C or SIGTERM; continue with --resume",
    "command": "aborted by an operator; continue with --resume",
}
_CODES: Mapping[Stop, int] = {"signal": 130, "command": 4}


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOutcome:
    """The outcome of a search. ended: why it ended. files: of confirmed failures, by variant.

    is_broken: there was an internal error beside its flights.
    """

    findings: SearchFindings
    folder: Path
    ended: str
    files: Mapping[str, str]
    exit_code: int
    is_broken: bool = False


def fly_search(
    search: SearchCampaign,
    options: FlightOptions,
    cleared: ClearedCampaign,
    engine: SearchEngine,
    say: Callable[[str], None],
) -> SearchOutcome:
    """Fly a search and write its folder, beneath `options.out`.

    It proposes as many flights at once as `cleared` has jobs; one that is resumed keeps its number.
    Raises OutputError, OperatingError, ResumeError, SearchError, MissingExtraError; EngineError and
    FlightRefusedError with search.json as far as it came.
    """
    # First of all: it raises MissingExtraError before anything begins.
    strategy = make_strategy(search.part.strategy, search.space, search.campaign.seed)
    with ExitStack() as stack:
        try:
            folder, ledger, files = _begin(search, options, cleared, stack)
            flight = _SearchFlight(
                search, engine, folder=folder, ledger=ledger, files=files, say=say
            )
            return flight.fly(strategy)
        except (FolderTakenError, OSError) as error:
            raise OutputError(f"{error}; choose another folder with --out") from error


def _begin(
    search: SearchCampaign, options: FlightOptions, cleared: ClearedCampaign, stack: ExitStack
) -> tuple[Path, SearchLedger, FlownFiles]:
    """Return the search's folder, locked until the stack ends, its ledger, and its files."""
    home = options.out / search.campaign.name
    document: Mapping[str, Any] = campaign_manifest(search.campaign, cleared.clock)
    files = FlownFiles.of(
        search.document.path,
        document["files"],
        read=files_read_by_campaign(search.campaign),
        skipped={search.document.path, *maybe_written_files(search.campaign)},
    )
    if not options.resume:
        folder = make_campaign_folder(home / SEARCHES)
        stack.enter_context(locked_campaign_folder(folder))
        ledger = SearchLedger.new(folder, at_once=cleared.jobs)
    else:
        is_folder = (options.out / "campaign.json").is_file()
        folder = resumed_folder(options.out if is_folder else home, SEARCHES)
        document = resumed_manifest(folder, document)
        stack.enter_context(locked_campaign_folder(folder))
        ledger = SearchLedger.resumed(folder)
        if cleared.engine.reads_files_here:
            _require_same_code(folder, files, ledger)
    write_atomically(folder / "campaign.json", to_json(document))
    return folder, ledger, files


def _require_same_code(folder: Path, files: FlownFiles, ledger: SearchLedger) -> None:
    """Raise ResumeError where code of the user's changed that only the finished flights name."""
    try:
        files.require_code_on_disk("its finished flights", ledger.code)
    except OutputError as error:
        raise ResumeError(f"{folder} cannot be resumed: {error}") from error


class _SearchFlight:
    """A search while it is flown."""

    def __init__(
        self,
        search: SearchCampaign,
        engine: SearchEngine,
        *,
        folder: Path,
        ledger: SearchLedger,
        files: FlownFiles,
        say: Callable[[str], None],
    ) -> None:
        self._search = search
        self._engine = engine
        self._folder = folder
        self._ledger = ledger
        self._flown_files = files
        self._say = say
        self._files: dict[str, str] = {}

    def fly(self, strategy: SearchStrategy) -> SearchOutcome:
        """Fly until the search is complete, or is stopped. Raises as `fly_search`."""
        search = Search(self._search.problem(at_once=self._ledger.at_once), strategy)
        try:
            stopped = self._fly_all(search)
        except KeyboardInterrupt:
            # Between two batches; within a batch the campaign lands its vehicles.
            stopped = "signal"
        except (EngineError, FlightRefusedError) as error:
            # A vehicle that is silent before the next batch, say: what was flown so far is shown.
            self._write(search.findings, f"{error}; continue with --resume")
            raise
        findings = search.findings
        ended = findings.ended if stopped is None else _STOPPED[stopped]
        self._write(findings, ended)
        return SearchOutcome(
            findings=findings,
            folder=self._folder,
            ended=ended,
            files=dict(self._files),
            is_broken=self._ledger.is_broken,
            exit_code=search_exit_code(findings, stopped=stopped, is_broken=self._ledger.is_broken),
        )

    def _fly_all(self, search: Search) -> Stop | None:
        """Fly the proposed batches, and send the search their outcomes; return what stopped it."""
        steps = search.steps()
        outcomes: tuple[FlightOutcome, ...] | None = None
        while True:
            try:
                batch = next(steps) if outcomes is None else steps.send(outcomes)
            except StopIteration:
                return None
            outcomes = self._ledger.outcomes(batch)
            if outcomes is None:
                flown = self._fly_batch(batch)
                if not isinstance(flown, tuple):
                    return flown
                outcomes = flown

    def _fly_batch(self, batch: FlightBatch) -> tuple[FlightOutcome, ...] | Stop:
        """Fly a batch; return its outcomes, or what stopped it.

        Raises OutputError where its flights would have other files than those before.
        """
        self._flown_files.require_unchanged()
        self._ledger.begin(batch)
        names = ", ".join(dict.fromkeys(flight.variant.name for flight in batch.flights))
        self._say(f"batch {batch.number}, {batch.purpose} in {batch.mode}: {names}")
        folder = self._folder / _FLIGHTS / f"{batch.number:04d}"
        campaign = self._search.batch_campaign(batch)
        result = self._engine.fly(campaign, folder)
        if result.stopped is not None:
            return result.stopped
        code: dict[str, str] = {}
        for name, run in result.runs.items():
            self._flown_files.require_same_code(name, run.code)
            code |= run.code
        plans = {plan.name: plan for plan in campaign.runs}
        outcomes = tuple(
            self._outcome(result.runs[name], plans[name], folder / name)
            for name in map(_run_name, batch.flights)
        )
        self._ledger.finish(batch, outcomes, code=code, is_broken=result.is_broken)
        return outcomes

    def _outcome(self, result: RunResult, plan: RunPlan, folder: Path) -> FlightOutcome:
        outcome = self._search.objective.outcome(
            verdict=result.verdict,
            results=result.oracles,
            vehicle=result.subject,
            cause=(result.decided_by or result.bare_reason) if result.verdict == "FAIL" else "",
            reason=_reason(result),
            duration_s=result.duration_s or 0.0,
            wall_s=result.wall_s,
        )
        return replace(outcome, sensed=sensed_views(plan, folder))

    def _write(self, findings: SearchFindings, ended: str) -> None:
        """Write the campaign files of confirmed failures, and search.json."""
        place = self._folder / FOLDER
        for case in findings.confirmed:
            place.mkdir(exist_ok=True)
            path = place / f"{case.variant.name}.yaml"
            write_atomically(path, failure_text(self._search, case, place))
            self._files[case.variant.name] = f"{FOLDER}/{path.name}"
        document = search_document(
            self._search,
            findings,
            ended=ended,
            files=self._files,
            at_once=self._ledger.at_once,
            is_broken=self._ledger.is_broken,
        )
        write_atomically(self._folder / FILE_NAME, to_json(document))


def search_exit_code(findings: SearchFindings, *, stopped: Stop | None, is_broken: bool) -> int:
    """Return the exit code of a search; the first of 130, 4, 3, 1, 5, 0.

    1: a failure is confirmed. 3: an internal error; or a failure is neither confirmed nor refuted,
    or half of a mode's variants or more have no PASS or FAIL. 5: nothing was flown.
    """
    if stopped is not None:
        return _CODES[stopped]
    if is_broken:
        return 3
    if findings.confirmed:
        return 1
    if not any(tried_variant.outcomes for tried_variant in findings.tried):
        return 5
    return 3 if findings.open_failures or not findings.is_proven else 0


def _reason(result: RunResult) -> str:
    """Return a flight's reason, the same whether or not the search was interrupted meanwhile."""
    if result.verdict != "PASS":
        return result.reason
    return passed_text(ended_attempts(result.attempts))


def _run_name(flight: SearchFlightPlan) -> str:
    return f"{flight.variant.name}/{flight.mode}/{flight.repetition}"
