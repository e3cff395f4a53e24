"""The runs of a campaign file as tests of pytest.

A FAIL is a failed test. INVALID, ERROR and ABORTED are errors, because they say nothing about the
autonomy; so is a run with an internal error of wil-campaign. A run that does not count against the
campaign is skipped, with its verdict as the reason, as in junit.xml. What ended the campaign
outside of its runs is an error after the last of its tests.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.campaigns.expansion.expansion import (
    Campaign,
    ExpansionOptions,
    RunPlan,
    load_campaign,
    requested_bench,
)
from wil_campaign.campaigns.setup.bench_file import load_benches
from wil_campaign.foundation.files.documents import BadInput
from wil_campaign.orchestrator.campaign.flight_options import FlightOptions
from wil_campaign.orchestrator.campaign.workers.run_engine import LOCAL
from wil_campaign.orchestrator.run_results.caveats import (
    campaign_caveats,
    retried_texts,
    synthesised_texts,
)
from wil_campaign.orchestrator.run_results.control_results import control_faults
from wil_campaign.orchestrator.run_results.exit_codes import standings_of
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.pytest.pytest_plugin import REPORTS
from wil_campaign.plugins.python.campaign_results import CampaignResults
from wil_campaign.plugins.python.flying import CannotFlyError, run


class CampaignFile(pytest.File):
    """A campaign file; its selected runs are flown together when the first of them is due."""

    def collect(self) -> Iterator["RunItem"]:
        """Yield a test for each run and control. Raises CollectError for faults of the file."""
        try:
            self._campaign = self._load()
        except BadInput as error:
            raise self.CollectError(str(error)) from None
        self._due: set[str] = set()
        self._flown: dict[str, RunResult] = {}
        self._not_flown: frozenset[str] = frozenset()
        self._forgiven: frozenset[str] = frozenset()
        self._refused: CannotFlyError | None = None
        self._endings: list[str] = []
        self._caveats: tuple[str, ...] = ()
        for plan in self._campaign.plans:
            yield RunItem.from_parent(self, name=plan.name, plan=plan)

    def _load(self) -> Campaign:
        """Return the campaign by the session's options. Raises BadInput, CollectError."""
        option = self.config.getoption
        options = ExpansionOptions(
            sets=tuple(option("--wil-set")),
            is_autonomy_isolated=True,
            benches=load_benches(map(Path, option("--wil-bench-file"))),
        )
        is_here = option("--wil-engine") == LOCAL
        if not (is_here or options.benches) and requested_bench(self.path, options) is not None:
            raise self.CollectError(
                f"{self.path}: pytest names runs before a bench of a cluster is known: fly this "
                "campaign with `wil-campaign run --junit`"
            )
        return load_campaign(self.path, options)

    def result_of(self, item: "RunItem") -> RunResult | None:
        """Return the result of a run, after flying the selected ones; None if it was not needed."""
        if item.name not in self._due and self._refused is None:
            names = self._names_due(item)
            self._due.update(names)
            try:
                self._record(self._fly(names))
            except CannotFlyError as error:
                self._refused = error
        if self._refused is not None:
            pytest.fail(str(self._refused), pytrace=False)
        if item.name in self._not_flown:
            pytest.fail("not flown: the campaign ended before this run", pytrace=False)
        return self._flown.get(item.name)

    def is_forgiven(self, result: RunResult) -> bool:
        """Return whether a FAIL is within the share that the campaign accepts."""
        return f"{result.case}/{result.mode}" in self._forgiven

    def _names_due(self, item: "RunItem") -> list[str]:
        """Return the runs that this process tests; only this one under pytest-xdist."""
        if hasattr(self.config, "workerinput"):
            return [item.name]
        return [one.name for one in self.session.items if one.parent is self]

    def _fly(self, names: list[str]) -> CampaignResults:
        option = self.config.getoption
        options = FlightOptions(
            runs=tuple(names),
            out=Path(option("--wil-out")),
            clock=option("--wil-clock"),
            jobs=option("--wil-jobs"),
            arm_real=option("--wil-arm-real"),
            engine=option("--wil-engine"),
            store=option("--wil-store"),
        )
        return run(self._campaign, options)

    def caveats(self, result: RunResult) -> Iterator[str]:
        """Yield what a reader of a run's PASS has to know."""
        yield from campaign_caveats([result])
        yield from (f"not at the first attempt: {text}" for text in retried_texts([result]))
        yield from self._caveats

    def teardown(self) -> None:
        """Report what ended the campaign outside of its runs, which no test of a run shows."""
        endings, self._endings = self._endings, []
        if endings:
            pytest.fail("\n".join(endings), pytrace=False)

    def _record(self, results: CampaignResults) -> None:
        if ending := results.summary.ending:
            self._endings.append(
                f"the campaign ended with exit code {results.exit_code}: {ending}; see "
                f"{results.folder}"
            )
        for result in (*results.runs, *results.controls):
            self._flown[f"{result.case}/{result.mode}/{result.rep}"] = result
        self._not_flown |= frozenset(results.summary.not_flown)
        self._forgiven = _accepted_cells(self._campaign, results)
        self._caveats = (*synthesised_texts(results.summary), *results.summary.caveats)
        self.config.stash.setdefault(REPORTS, []).append(results.folder / "report.html")


class RunItem(pytest.Item):
    """A run of a campaign as a test."""

    def __init__(self, *, plan: RunPlan, **options: Any) -> None:
        super().__init__(**options)
        self._plan = plan
        self._result: RunResult | None = None

    @property
    def campaign_file(self) -> CampaignFile:
        """Return the collector of the run's campaign file."""
        parent = self.parent
        assert isinstance(parent, CampaignFile)  # noqa: S101 - only a CampaignFile creates items
        return parent

    def setup(self) -> None:
        """Fly the run: a failure here is an error of the test, as INVALID and ERROR are."""
        result = self._result = self.campaign_file.result_of(self)
        if result is None:
            pytest.skip("not flown: earlier repetitions have decided")
        self.user_properties += [("seed", result.seed), ("verdict", result.verdict)]
        self.user_properties += [("caveat", text) for text in self.campaign_file.caveats(result)]
        proves = result.verdict in {"PASS", "FAIL"}
        is_met = result.control is not None and result.control.met
        if result.exceptions or result.verdict == "ABORTED":
            # Never forgiven: `wil-campaign run` ends with 3 or 4 even if the run does not count.
            pytest.fail("\n".join([_text(result), *result.exceptions]), pytrace=False)
        if not (proves or is_met):
            self._skip_reported(result)
            pytest.fail(_text(result), pytrace=False)

    def runtest(self) -> None:
        """Fail if the run failed, or if a control did not end as it must."""
        result = self._result
        if result is None:
            return
        if result.control is not None:
            if faults := control_faults([result]):
                pytest.fail("\n".join([*faults, _text(result)]), pytrace=False)
        elif result.verdict == "FAIL":
            self._skip_reported(result)
            if self.campaign_file.is_forgiven(result):
                pytest.skip(f"within what is accepted: FAIL: {result.reason}")
            pytest.fail(_text(result), pytrace=False)

    def _skip_reported(self, result: RunResult) -> None:
        if result.control is None and not result.required:
            pytest.skip(f"reported only: {result.verdict}: {result.reason}")

    def reportinfo(self) -> tuple[Any, int | None, str]:
        """Return the file and the name under which the test is shown."""
        return self.path, None, f"{self._plan.campaign}: {self.name}"


def _accepted_cells(campaign: Campaign, results: CampaignResults) -> frozenset[str]:
    """Return the cases and modes whose share of passes is met, also with a FAIL among them."""
    standings = standings_of(results.runs, campaign.requirements)
    return frozenset(
        f"{standing.requirement.case}/{standing.requirement.mode}"
        for standing in standings
        if standing.met
    )


def _text(result: RunResult) -> str:
    """Return a run's result in words: the verdict, then each oracle that did not pass."""
    lines = [f"{result.verdict}: {result.reason}"]
    for oracle in result.oracles:
        if oracle.verdict != "PASS":
            measured = (
                "" if oracle.actual is None else f", actual {oracle.actual:.4g} {oracle.unit}"
            )
            lines.append(f"  {oracle.name} ({oracle.vehicle}): {oracle.detail}{measured}".rstrip())
    lines += [f"  also {late.verdict} at {late.at_s:.3f} s: {late.reason}" for late in result.also]
    return "\n".join([*lines, result.trace.rstrip()]).rstrip()
