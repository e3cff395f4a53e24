"""Whoever watches a campaign may raise: that is a fault, and all runs are flown."""

import io
import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from rich.console import Console

from tests.orchestrator.campaign.resuming.test_runs_to_fly import result_of
from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.campaign import display_thread
from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    CampaignWatcher,
    fly_campaign,
)
from wil_campaign.orchestrator.campaign.display_thread import DisplayThread
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers import run_engine
from wil_campaign.orchestrator.campaign.workers.run_output import OUTPUT_FILE
from wil_campaign.orchestrator.cli.progress_display import LineDisplay, SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder

pytestmark = pytest.mark.usefixtures("forked_workers")

OUTPUT = "[INFO] [169.2] [talker]: hi\n  [/talker] stopped\n"


@dataclass
class Deaf(SilentDisplay):
    """A watcher that cannot show messages."""

    tried: list[str] = field(default_factory=list)

    def say(self, text: str) -> None:
        self.tried.append(text)
        raise LookupError("no such style")


def fail_with_output(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    order.folder.mkdir(parents=True)
    (order.folder / OUTPUT_FILE).write_text(OUTPUT)
    flown = result_of(order.plan, "FAIL")
    write_atomically(order.folder / "result.json", to_json(flown))
    return flown


def fly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, watcher: CampaignWatcher
) -> CampaignOutcome:
    monkeypatch.setattr(run_engine, "fly_order", fail_with_output)
    campaign = load_campaign(write_hover(tmp_path), ExpansionOptions(repetitions=3))
    options = FlightOptions(out=tmp_path / "out")
    cleared = ClearedCampaign("virtual", 1)
    return fly_campaign(campaign, options, cleared, watcher)


def test_the_output_of_a_run_is_shown_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = io.StringIO()
    display = LineDisplay(console=Console(file=lines, soft_wrap=True), total=3)
    outcome = fly(tmp_path, monkeypatch, display)
    assert [run.verdict for run in outcome.summary.runs] == ["FAIL"] * 3
    assert outcome.exit_code == 1
    assert lines.getvalue().count("  [INFO] [169.2] [talker]: hi\n    [/talker] stopped\n") == 3


def test_a_watcher_that_raises_ends_no_campaign_and_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watcher = Deaf()
    outcome = fly(tmp_path, monkeypatch, watcher)
    assert [run.verdict for run in outcome.summary.runs] == ["FAIL"] * 3
    assert watcher.tried
    assert outcome.summary.broken is True
    assert outcome.exit_code == 3
    assert "LookupError" in (outcome.folder / "log.jsonl").read_text()


@dataclass
class DeafAtLast(Deaf):
    """A watcher that cannot show the last line of the last run."""

    def say(self, text: str) -> None:
        self.tried.append(text)
        if text.endswith("stopped") and self.tried.count(text) == 3:
            raise LookupError("no such style")


@pytest.mark.parametrize("watcher", [Deaf(), DeafAtLast()])
def test_a_display_in_a_thread_that_raises_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, watcher: Deaf
) -> None:
    with DisplayThread(watcher) as display:
        outcome = fly(tmp_path, monkeypatch, display)
    assert [run.verdict for run in outcome.summary.runs] == ["FAIL"] * 3
    assert any("internal error: " in text for text in watcher.tried)
    assert outcome.summary.broken is True
    assert outcome.exit_code == 3
    assert "LookupError" in (outcome.folder / "log.jsonl").read_text()


def test_a_terminal_that_takes_nothing_keeps_no_campaign_from_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(display_thread, "_SETTLED_S", 0.01)
    may = threading.Event()
    shown: list[int] = []

    class Stopped(SilentDisplay):
        def finished(self, result: RunResult) -> None:
            assert may.wait(60.0)
            shown.append(result.rep)

    with DisplayThread(Stopped()) as display:
        outcome = fly(tmp_path, monkeypatch, display)
        assert (outcome.exit_code, shown) == (1, [])
        assert '"accepted": false' in (outcome.folder / "summary.json").read_text()
        may.set()
    assert shown == [1, 2, 3]
