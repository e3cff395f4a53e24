"""What a job of GitHub shows: annotations of files and of runs, and a summary."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from tests.orchestrator.reading.flown_campaign import flights, summary_of
from tests.test_house import ROOT
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.announcements import announce_verdicts
from wil_campaign.orchestrator.run_results.campaign_results import Summary
from wil_campaign.orchestrator.run_results.control_results import ControlResult
from wil_campaign.plugins.ci.github_job import summary_markdown

Capture = pytest.CaptureFixture[str]
WILD = "hit <img src=x> | `gate` @someone #1 ![p](data:x)\nnext"


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Be in a job of GitHub, whose repository is this checkout; return the file of its summary."""
    summary = tmp_path / "summary.md"
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(summary))
    monkeypatch.setenv("GITHUB_WORKSPACE", str(ROOT))
    return summary


@pytest.fixture(scope="module")
def gate() -> Campaign:
    return load_campaign(ROOT / "campaigns" / "gate.yaml", ExpansionOptions(loads_code=False))


def flown(campaign: Campaign, verdicts: str, reason: str = "") -> Summary:
    given = flights("large", "sim", verdicts)
    summary = summary_of(given, requirements=campaign.requirements)
    if not reason:
        return summary
    runs = [run if run.verdict == "PASS" else replace(run, reason=reason) for run in summary.runs]
    return replace(summary, runs=tuple(runs))


def annotations(capsys: Capture) -> list[str]:
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("::")]


def test_faults_of_files_are_annotations_of_their_lines(
    tmp_path: Path, job: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("GITHUB_WORKSPACE", str(tmp_path))
    file = write_hover(tmp_path)
    file.write_text(file.read_text().replace("goal:", "'gaol%': 1\ngoal:", 1))
    line = next(n for n, text in enumerate(file.read_text().splitlines(), 1) if "gaol" in text)
    for command in ("validate", "plan", "run"):
        assert main([command, str(file)]) == 2
        (first,) = annotations(capsys)
        assert first.startswith(f"::error file={file.name},line={line},col=1::"), command
        assert "gaol%25" in first
    assert not job.exists()


def test_an_option_is_no_file(job: Path, capsys: Capture) -> None:
    gate = str(ROOT / "campaigns" / "gate.yaml")
    assert main(["validate", gate, "--set", "goal.hight_m=2"]) == 2
    (found,) = annotations(capsys)
    assert found.startswith("::error title=--set")
    assert "file=" not in found


def test_failed_required_runs_are_annotations_of_their_case(
    gate: Campaign, job: Path, tmp_path: Path, capsys: Capture
) -> None:
    announce_verdicts(gate, flown(gate, "PFPPP", WILD), tmp_path)
    line, column = gate.document.place(("cases", "large"), key=True)
    first, *rest = annotations(capsys)
    place = f"file=campaigns/gate.yaml,line={line},col={column}"
    assert first == (
        f"::error {place},title=gate.large.sim 2%3A FAIL::"
        "hit <img src=x> | `gate` @someone #1 ![p](data:x)%0Anext"
    )
    assert all("not flown" in one for one in rest)  # what the campaign requires besides


def test_a_control_that_ended_otherwise_is_an_annotation_of_its_line(
    gate: Campaign, job: Path, tmp_path: Path, capsys: Capture
) -> None:
    summary = flown(gate, "PPPPP")
    blind = replace(
        summary.runs[0],
        case="blind",
        required=False,
        control=ControlResult("large", "FAIL", "reached", None, met=False),
    )
    announce_verdicts(gate, replace(summary, controls=(blind,)), tmp_path)
    line, column = gate.document.place(("controls", "blind"), key=True)
    place = f"::error file=campaigns/gate.yaml,line={line},col={column},title=gate.controls.blind"
    assert any(one.startswith(place) for one in annotations(capsys))


def test_what_passes_has_no_annotation_and_a_share_forgives(
    job: Path, tmp_path: Path, capsys: Capture
) -> None:
    gate = ROOT / "campaigns" / "gate.yaml"
    sets = ("accept={large: {sim: 4/5}}", "controls={}")
    campaign = load_campaign(gate, ExpansionOptions(loads_code=False, sets=sets, modes=("sim",)))
    announce_verdicts(campaign, flown(campaign, "PPPPF"), tmp_path)
    assert annotations(capsys) == []
    assert "### gate: accepted" in job.read_text("utf-8")


def test_only_as_many_annotations_as_github_shows(
    gate: Campaign, job: Path, tmp_path: Path, capsys: Capture
) -> None:
    announce_verdicts(gate, flown(gate, "F" * 30), tmp_path)
    found = annotations(capsys)
    assert len(found) == 10
    assert found[-1].startswith("::error title=wil-campaign::and 2")


def test_the_summary_has_table_reasons_and_a_link_and_formats_nothing_of_a_run(
    gate: Campaign, job: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GITHUB_SERVER_URL", "https://git.example")
    monkeypatch.setenv("GITHUB_REPOSITORY", "a/b")
    monkeypatch.setenv("GITHUB_RUN_ID", "7")
    (tmp_path / "report.html").touch()
    job.write_text("before\n")
    announce_verdicts(gate, flown(gate, "PF", WILD), tmp_path)
    text = job.read_text("utf-8")
    assert text.startswith("before\n### gate: not accepted")
    assert "\n| case | mode | passed | verdict | clearance m |" in text
    assert "\n| large | sim | 1/2 | FAIL" in text
    assert "hit \\<img src=x\\> \\| \\`gate\\` @\u200bsomeone #\u200b1" in text
    assert "![" not in text
    assert "](https://git.example/a/b/actions/runs/7#artifacts)" in text
    assert "data:" not in text.replace("(data:x)", "")


def test_the_summary_of_many_failed_runs_is_short(gate: Campaign, tmp_path: Path) -> None:
    text = summary_markdown(gate, flown(gate, "F" * 400, "x" * 5000), tmp_path)
    assert len(text) < 50_000
    assert "lines more in the job's log" in text
    assert "Pictures" not in text  # there is no report


def test_the_heading_of_a_summary_points_below(gate: Campaign, tmp_path: Path) -> None:
    unmet = tuple(f"the control number {k} ended as something else: why" for k in range(9))
    text = summary_markdown(gate, replace(flown(gate, "P"), unmet=unmet), tmp_path)
    heading, _, rest = text.partition("\n")
    assert "more below" in heading
    assert "above" not in heading
    assert "the control number 8" in rest


def test_a_summary_that_cannot_be_written_costs_nothing(
    gate: Campaign, job: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "no" / "summary.md"))
    announce_verdicts(gate, flown(gate, "PPPPP"), tmp_path)
    assert "GITHUB_STEP_SUMMARY: " in capsys.readouterr().err


def test_outside_of_github_nothing_is_printed(
    gate: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    for name in ("GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"):
        monkeypatch.delenv(name, raising=False)
    announce_verdicts(gate, flown(gate, "F"), tmp_path)
    said = capsys.readouterr()
    assert said.out + said.err == ""


def test_run_and_judge_tell_the_job(tmp_path: Path, job: Path, capsys: Capture) -> None:
    file, out = write_hover(tmp_path), tmp_path / "out"
    limit = "oracles.altitude={max_m: 0.2}"
    assert main(["run", str(file), "--out", str(out), "--set", limit, "--json"]) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["accepted"] is False  # and nothing else
    assert [line for line in said.err.splitlines() if line.startswith("::error ")]
    assert job.read_text("utf-8").count("### hover: not accepted") == 1
    (folder,) = out.glob("*/*")
    assert main(["judge", str(file), str(folder)]) == 0
    assert annotations(capsys) == []
    assert "### hover: accepted" in job.read_text("utf-8")
