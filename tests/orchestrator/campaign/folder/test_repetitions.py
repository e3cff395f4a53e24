"""repetitions until decided: what is flown, what counts, and what it comes to."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from tests.orchestrator.reading.flown_campaign import flights, summary_of
from wil_campaign.campaigns.expansion.expansion import Campaign, load_campaign
from wil_campaign.campaigns.statistics.sequential_test import SequentialTest
from wil_campaign.campaigns.values.acceptance import (
    PassRequirement,
    PassShare,
    requirement_standings,
)
from wil_campaign.orchestrator.campaign.folder.repetitions import runs_due
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.run_results.exit_codes import exit_code, is_campaign_accepted
from wil_campaign.orchestrator.run_results.junit import junit_xml
from wil_campaign.orchestrator.run_results.run_result import RunResult

Capture = pytest.CaptureFixture[str]
TEST = SequentialTest(at_least=0.9, against=0.2, most=5)
"""Two passes decide for it, two failures against it; after one of each three more are flown."""
REQUIRED = PassRequirement("default", "sim", PassShare(5, 5), TEST)
UNTIL = "{until: decided, at_least: 0.9, against: 0.2, most: 5}"


@pytest.fixture
def hover(tmp_path: Path) -> Path:
    path = write_hover(tmp_path)
    path.write_text(path.read_text().replace("repetitions: 2", f"repetitions: {UNTIL}"))
    return path


@pytest.fixture
def campaign(hover: Path) -> Campaign:
    return load_campaign(hover)


def results(verdicts: str) -> dict[str, RunResult]:
    return {flight.name: flight.result() for flight in flights("default", "sim", verdicts)}


def test_the_campaign_plans_the_most_and_requires_the_decision(campaign: Campaign) -> None:
    assert len(campaign.runs) == 5
    assert campaign.test == TEST
    assert campaign.requirements == (REQUIRED,)


@pytest.mark.parametrize(
    ("verdicts", "due"),
    [("", 5), ("P", 5), ("PP", 2), ("PPP", 2), ("FF", 2), ("PF", 5), ("PIP", 3), ("PFPPF", 5)],
)
def test_runs_after_the_decision_are_not_due(campaign: Campaign, verdicts: str, due: int) -> None:
    assert len(runs_due(campaign.plans, TEST, results(verdicts))) == due
    assert len(runs_due(campaign.plans, None, results(verdicts))) == 5


def test_a_run_that_ended_early_waits_for_the_runs_before_it(campaign: Campaign) -> None:
    done = results("PPP")
    first = done.pop("default/sim/1")
    assert len(runs_due(campaign.plans, TEST, done)) == 5
    assert len(runs_due(campaign.plans, TEST, {**done, "default/sim/1": first})) == 2


@pytest.mark.parametrize(
    ("verdicts", "decision", "complete", "code"),
    [
        ("PP", "at least", True, 0),
        ("FF", "below", True, 1),
        ("PF", "undecided", False, 3),
        ("PFPFP", "undecided", True, 1),
    ],
)
def test_the_decision_is_the_verdict(
    verdicts: str, decision: str, complete: bool, code: int
) -> None:
    runs = list(results(verdicts).values())
    (standing,) = requirement_standings(
        [REQUIRED], [("default", "sim", letter == "P") for letter in verdicts]
    )
    assert (standing.decision, standing.is_complete) == (decision, complete)
    assert exit_code(runs, [REQUIRED]) == code
    assert is_campaign_accepted(runs, [REQUIRED]) is (code == 0)
    junit = junit_xml(summary_of(flights("default", "sim", verdicts)), [REQUIRED])
    assert (b"NOT_FLOWN" in junit) is not complete


def test_a_campaign_stops_when_it_is_decided(hover: Path, capsys: Capture) -> None:
    out = hover.parent / "out"
    assert main(["run", str(hover), "--out", str(out), "--jobs", "1"]) == 0
    text = capsys.readouterr().out
    assert "PASS (0.9:0.2)" in text
    (folder,) = (out / "hover").iterdir()
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    assert [run["rep"] for run in summary["runs"]] == [1, 2]
    assert (summary["accepted"], summary["not_flown"]) == (True, [])
    assert not (folder / "default/sim/3").exists()
    page = (folder / "report.html").read_text()
    assert "0.9 against 0.2: at least" in page
    assert "have no result" not in page
    assert main(["plan", str(hover)]) == 0
    assert "2 flights when all pass, 2 when all fail, 5 at most" in capsys.readouterr().out


def test_readers_know_that_a_composition_stops_when_it_is_decided(
    hover: Path, capsys: Capture
) -> None:
    both = hover.parent / "both.yaml"
    text = "schema: wil/campaign/1\ncampaign: both\ncampaigns: {one: %s, other: %s}\n"
    both.write_text(text % (hover.name, hover.name))
    out = hover.parent / "out"
    assert main(["run", str(both), "--out", str(out), "--jobs", "1"]) == 0
    (folder,) = (out / "both").iterdir()
    page = (folder / "report.html").read_text()
    assert page.count("0.9 against 0.2: at least") == 2
    assert "have no result" not in page
    capsys.readouterr()
    for command in (["report", folder], ["history", out], ["compare", folder, folder]):
        assert (command, main(list(map(str, command)))) == (command, 0)
        assert capsys.readouterr().err == ""


def test_a_campaign_with_a_fixed_number_needs_them_all(campaign: Campaign) -> None:
    fixed = replace(campaign, test=None)
    assert len(runs_due(fixed.plans, fixed.test, results("PP"))) == 5
