"""Runs that are flown again while others fly: each by its own file, and none after a decision."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from tests.orchestrator.campaign.resuming.test_runs_to_fly import quick_fly, result_of
from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    fly_campaign,
)
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.workers import run_engine
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run_results.attempts import after_attempts
from wil_campaign.orchestrator.run_results.result_reader import read_summary
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.safety.model.oracle_results import Verdict

pytestmark = pytest.mark.usefixtures("forked_workers")

UNTIL = "{until: decided, at_least: 0.9, against: 0.2, most: 5}"
"""Two passes decide for it; after a pass and a failure three more are flown."""
COMPOSED = """\
schema: wil/campaign/1
campaign: both
campaigns: {one: hover.yaml, other: other.yaml}
"""
_PATIENCE_S = 60.0


def wait_for(is_so: Callable[[], bool]) -> None:
    """Wait in a worker for what the campaign or another run has to do first."""
    end_s = time.monotonic() + _PATIENCE_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def end(order: RunOrder, verdict: Verdict) -> RunResult:
    flown = after_attempts(result_of(order.plan, verdict), order.attempts)
    write_atomically(order.folder / "result.json", to_json(flown))
    return flown


def counted(order: RunOrder, *repetitions: int) -> bool:
    """Return whether the campaign has counted these repetitions."""
    summary = read_summary(order.folder.parents[2] / "summary.json")
    return set(repetitions) <= {run.rep for run in summary.runs}


def invalid_after_the_decision(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """The second repetition decides while the third flies, which then is INVALID."""
    order.folder.mkdir(parents=True)
    if order.plan.repetition == 2:
        wait_for((order.folder.parent / "3").is_dir)
    if order.plan.repetition == 3:
        wait_for(lambda: counted(order, 1, 2))
        return end(order, "INVALID")
    return end(order, "PASS")


def invalid_before_the_decision(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """The third repetition is INVALID, and flies again when the second decides."""
    order.folder.mkdir(parents=True)
    if order.plan.repetition == 2:
        wait_for((order.folder.parents[2] / "earlier/default/sim/3-1").is_dir)
        wait_for((order.folder.parent / "3").is_dir)
    if order.plan.repetition == 3 and not order.attempts:
        return end(order, "INVALID")
    if order.plan.repetition == 3:
        wait_for(lambda: counted(order, 1, 2))
    return end(order, "PASS")


def invalid_before_others(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """All others have passed when the second repetition is INVALID; flown again it fails."""
    order.folder.mkdir(parents=True)
    if order.plan.repetition == 2 and not order.attempts:
        wait_for(lambda: counted(order, 1, 3, 4, 5))
        return end(order, "INVALID")
    return end(order, "FAIL" if order.plan.repetition == 2 else "PASS")


def fly(path: Path, *, jobs: int = 1, resume: bool = False) -> CampaignOutcome:
    options = FlightOptions(out=path.parent / "out", resume=resume)
    cleared = ClearedCampaign("virtual", jobs)
    return fly_campaign(load_campaign(path), options, cleared, SilentDisplay())


@pytest.mark.parametrize(
    ("fly_order", "kept"),
    [
        (invalid_after_the_decision, ["3-1"]),
        (invalid_before_the_decision, ["3-1", "3-2"]),
    ],
)
def test_a_run_that_the_decision_made_needless_is_not_flown_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fly_order: object, kept: list[str]
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", fly_order)
    path = write_hover(tmp_path)
    text = path.read_text().replace("repetitions: 2", f"repetitions: {UNTIL}\nretries: 1")
    path.write_text(text)
    outcome = fly(path, jobs=2)
    assert [(run.rep, run.verdict) for run in outcome.summary.runs] == [(1, "PASS"), (2, "PASS")]
    assert outcome.exit_code == 0
    earlier = outcome.folder / "earlier/default/sim"
    assert sorted(one.name for one in earlier.iterdir() if one.name.startswith("3")) == kept
    assert not (outcome.folder / "default/sim/3").exists()


def test_a_kill_before_a_needless_run_was_set_aside_does_not_make_it_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", invalid_after_the_decision)
    path = write_hover(tmp_path)
    path.write_text(path.read_text().replace("repetitions: 2", f"repetitions: {UNTIL}"))
    folder = fly(path, jobs=2).folder
    (folder / "earlier/default/sim/3-1").rename(folder / "default/sim/3")
    outcome = fly(path, resume=True)
    assert [(run.rep, run.verdict) for run in outcome.summary.runs] == [(1, "PASS"), (2, "PASS")]
    assert outcome.exit_code == 0
    assert (folder / "earlier/default/sim/3-1/result.json").is_file()
    assert not (folder / "default/sim/3").exists()


def test_a_decision_waits_for_a_run_that_is_flown_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What counts does not depend on how many fly at once."""
    monkeypatch.setattr(run_engine, "fly_order", invalid_before_others)
    path = write_hover(tmp_path)
    text = path.read_text().replace("repetitions: 2", f"repetitions: {UNTIL}\nretries: 1")
    path.write_text(text)
    outcome = fly(path, jobs=2)
    verdicts = {run.rep: run.verdict for run in outcome.summary.runs}
    assert verdicts == {1: "PASS", 2: "FAIL", 3: "PASS", 4: "PASS", 5: "PASS"}
    assert (outcome.exit_code, outcome.summary.not_flown) == (0, ())


def test_each_part_of_a_composition_has_the_retries_of_its_own_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)
    one = write_hover(tmp_path)
    text = one.read_text().replace("repetitions: 2", "repetitions: 1") + "description: INVALID\n"
    one.write_text(text)
    # Nobody has to put an embedded vehicle back, whatever the file says of attached ones.
    (tmp_path / "other.yaml").write_text(text + "retries: 2\nbetween_runs: ask\n")
    one.write_text(text + "between_runs: ask\n")
    whole = tmp_path / "both.yaml"
    whole.write_text(COMPOSED)
    outcome = fly(whole)
    flown = {run.case: (run.verdict, len(run.attempts)) for run in outcome.summary.runs}
    assert flown == {"one.default": ("INVALID", 0), "other.default": ("PASS", 1)}
    options = FlightOptions(out=tmp_path / "out", resume=True)
    cleared = ClearedCampaign("virtual", 1)
    again = fly_campaign(load_campaign(whole), options, cleared, SilentDisplay())
    assert replace(again, exit_code=0) == replace(outcome, exit_code=0)
    assert again.exit_code == outcome.exit_code == 3


def own_entries_fly(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Stand in for a flight: keeps what its order says of cases and controls."""
    file = order.plan.files.campaign
    result = quick_fly(order, report, inbox)
    kept = {key: file.get((key,)) for key in ("cases", "controls", "published")}
    (order.folder / "kept.json").write_text(json.dumps(kept))
    return result


def test_an_order_names_no_other_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of thousands each run had all in its recording."""
    monkeypatch.setattr(run_engine, "fly_order", own_entries_fly)
    cases = {name: {"goal.altitude_m": height} for name, height in (("a", 2.0), ("b.c", 2.1))}
    control = {"set": {"limits.speed_m_s": 1.0}, "expect": {"verdict": "FAIL", "cause": "time"}}
    published = {"passed": {"a": {"sim": "1/1"}}}
    told = {"cases": cases, "controls": {"late": control}, "published": published}
    whole = tmp_path / "both.yaml"
    hover = write_hover(tmp_path)
    hover.write_text(hover.read_text() + yaml.safe_dump(told))
    whole.write_text("schema: wil/campaign/1\ncampaign: both\ncampaigns: {one: hover.yaml}\n")
    outcome = fly(whole)
    kept = {
        run.case: json.loads((outcome.folder / run.case / "sim/1/kept.json").read_text())
        for run in outcome.summary.runs
    }
    assert {case: (one["cases"], list(one["controls"])) for case, one in kept.items()} == {
        "one.a": ({"a": cases["a"]}, []),
        "one.b.c": ({"b.c": cases["b.c"]}, []),
        "one.late": ({}, ["late"]),
    }
    assert {one["published"] for one in kept.values()} == {None}
