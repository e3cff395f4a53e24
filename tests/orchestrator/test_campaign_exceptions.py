"""Exceptions of ours beside the flights: display, worker processes, the campaign's own loop."""

import asyncio
import json
import os
from collections.abc import Callable
from multiprocessing.util import Finalize
from pathlib import Path

import pytest

from tests.orchestrator.campaign.resuming.test_runs_to_fly import quick_fly
from tests.orchestrator.flights import log_of
from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    fly_campaign,
)
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers import run_engine
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder


def raise_key_error(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    raise KeyError("lost")


def raise_cancelled(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    raise asyncio.CancelledError("lost")


def end_badly(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    Finalize(None, os._exit, args=(7,), exitpriority=100)
    return quick_fly(order, report, inbox)


class Raising(SilentDisplay):
    """A display with an error in it."""

    def finished(self, result: RunResult) -> None:
        raise KeyError("display")


class Listening(SilentDisplay):
    """A display that keeps what it is to say."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def say(self, text: str) -> None:
        self.texts.append(text)


def fly(
    folder: Path, watcher: SilentDisplay | None = None, *, resume: bool = False
) -> CampaignOutcome:
    campaign = load_campaign(write_hover(folder), ExpansionOptions(repetitions=1))
    options = FlightOptions(out=folder / "out", resume=resume)
    cleared = ClearedCampaign("virtual", 1)
    return fly_campaign(campaign, options, cleared, watcher or SilentDisplay())


@pytest.mark.usefixtures("forked_workers")
@pytest.mark.parametrize(
    ("fly_order", "kind"), [(raise_key_error, "KeyError"), (raise_cancelled, "CancelledError")]
)
def test_an_exception_of_a_worker_is_an_error_with_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fly_order: object, kind: str
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", fly_order)
    outcome = fly(tmp_path)
    (run,) = outcome.summary.runs
    assert (run.verdict, outcome.exit_code) == ("ERROR", 3)
    assert len(run.exceptions) == 1
    (line,) = log_of(outcome.folder / run.case / run.mode / str(run.rep))
    assert (line["event"], line["type"]) == ("error", kind)
    assert "lost" in line["message"]
    assert "Traceback" in line["trace"]


@pytest.mark.usefixtures("forked_workers")
def test_a_display_that_raises_is_never_exit_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)
    outcome = fly(tmp_path, Raising())
    assert [run.verdict for run in outcome.summary.runs] == ["PASS"]
    assert outcome.exit_code == 3
    document = json.loads((outcome.folder / "summary.json").read_text("utf-8"))
    assert (document["broken"], document["accepted"]) == (True, False)
    (line,) = log_of(outcome.folder)
    assert (line["type"], line["message"]) == ("KeyError", "'display'")
    assert "Traceback" in line["trace"]


def cut_off(folder: Path) -> None:
    """Leave what a campaign leaves that was killed before its end: no summary, or an open one."""
    (folder / "summary.json").unlink()


def lose_log(folder: Path) -> None:
    """Leave what a campaign leaves whose disk was full when it wrote its log."""
    (folder / "log.jsonl").unlink()


def damage_log(folder: Path) -> None:
    """Leave what a power failure leaves: a line that was cut off, and no summary."""
    cut_off(folder)
    log = folder / "log.jsonl"
    log.write_bytes(log.read_bytes()[:40])


@pytest.mark.usefixtures("forked_workers")
@pytest.mark.parametrize(
    ("left", "said"),
    [
        (None, "a verdict: KeyError: 'display'"),
        (cut_off, "a verdict: KeyError: 'display'"),
        (lose_log, "stated in"),
        (damage_log, "a line of its log that is damaged"),
    ],
)
def test_an_exception_stays_with_a_campaign_however_often_it_is_resumed(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    left: Callable[[Path], None] | None,
    said: str,
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)
    folder = fly(tmp_path, Raising()).folder
    if left is not None:
        left(folder)
    for text_of_first in (said, ""):
        watcher = Listening()
        outcome = fly(tmp_path, watcher, resume=True)
        assert outcome.folder == folder
        assert [run.verdict for run in outcome.summary.runs] == ["PASS"]
        assert (outcome.exit_code, outcome.summary.broken) == (3, True)
        assert outcome.summary.accepted is False
        (why,) = [text for text in watcher.texts if "internal exception" in text]
        assert text_of_first in why
        assert "fly it anew, without --resume" in why
    assert b"an internal exception occurred" in (folder / "junit.xml").read_bytes()


@pytest.mark.usefixtures("forked_workers")
def test_a_campaign_without_an_exception_is_resumed_to_exit_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)
    assert fly(tmp_path).exit_code == 0
    watcher = Listening()
    outcome = fly(tmp_path, watcher, resume=True)
    assert (outcome.exit_code, outcome.summary.broken) == (0, False)
    assert not [text for text in watcher.texts if "internal exception" in text]


class Looking(SilentDisplay):
    """A display that reads summary.json when a run is finished."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.found: list[tuple[bool | None, bool]] = []

    def finished(self, result: RunResult) -> None:
        (path,) = self.out.glob("*/*/summary.json")
        document = json.loads(path.read_text("utf-8"))
        self.found.append((document["broken"], document["accepted"]))


@pytest.mark.usefixtures("forked_workers")
def test_a_campaign_that_is_killed_after_its_last_run_leaves_nothing_accepted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What summary.json says before the campaign has come to its end stays if it never does."""
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)
    watcher = Looking(tmp_path / "out")
    outcome = fly(tmp_path, watcher)
    assert watcher.found == [(None, False)]
    assert (outcome.exit_code, outcome.summary.broken) == (0, False)
    document = json.loads((outcome.folder / "summary.json").read_text("utf-8"))
    assert (document["broken"], document["accepted"]) == (False, True)


def test_a_worker_that_ends_badly_after_its_last_run_is_never_exit_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", end_badly)
    outcome = fly(tmp_path)
    assert outcome.exit_code == 3
    (line,) = log_of(outcome.folder)
    assert "exit status 7" in line["message"]
