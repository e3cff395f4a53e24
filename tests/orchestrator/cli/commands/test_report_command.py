"""`wil-campaign report`, and the report at the end of `run`: neither changes a result."""

import json
from pathlib import Path

import pytest

from orchestrator.campaign.campaign_runner import CampaignOutcome
from orchestrator.cli import main
from orchestrator.cli.commands import run as run_command
from orchestrator.report import campaign_report
from tests.orchestrator.hover import write_hover
from tests.orchestrator.report.recorded_campaign import summary_of_campaign, write_campaign

Capture = pytest.CaptureFixture[str]


def test_a_whole_folder_is_0_a_damaged_one_3_and_a_foreign_one_2(
    tmp_path: Path, capsys: Capture
) -> None:
    folder = write_campaign(tmp_path / "gate")
    assert main(["report", str(folder)]) == 0
    outcome = capsys.readouterr()
    assert outcome.out.splitlines()[-1] == f"report: {folder / 'report.html'}"
    assert outcome.err == ""

    (folder / "large/wil/1/run.mcap").write_bytes(b"\x1b[2J" * 100)
    assert main(["report", str(folder), "--out", str(tmp_path / "again.html")]) == 3
    outcome = capsys.readouterr()
    assert "large/wil/1: run.mcap: not an MCAP file" in outcome.err
    assert "\x1b" not in outcome.err
    assert "real touched gate.left" in (tmp_path / "again.html").read_text()

    assert main(["report", str(tmp_path)]) == 2
    assert "not the results folder" in capsys.readouterr().err
    assert main(["report", str(folder), "--out", str(tmp_path / "nowhere" / "r.html")]) == 3
    assert "cannot be written" in capsys.readouterr().err


def test_run_writes_a_report_and_one_that_fails_changes_nothing(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_campaign(tmp_path / "flown")
    result = CampaignOutcome(summary=summary_of_campaign(), folder=folder, exit_code=1)
    monkeypatch.setattr(run_command, "fly_campaign", lambda *_: result)
    command = ["run", str(write_hover(tmp_path)), "--out", str(tmp_path / "out")]

    assert main(command) == 1
    assert capsys.readouterr().out.splitlines()[-2:] == [
        f"report: {folder / 'report.html'}",
        f"results: {folder}",
    ]
    page = folder / "report.html"
    assert "real touched gate.left" in page.read_text()

    page.unlink()
    monkeypatch.setattr(campaign_report, "render_page", out_of_ink)
    assert main([*command, "--json"]) == 1
    outcome = capsys.readouterr()
    assert json.loads(outcome.out)["accepted"] is False
    assert outcome.err.startswith("ERROR: report.html was not written (RuntimeError: out of ink)")
    assert main(command) == 1
    outcome = capsys.readouterr()
    assert outcome.out.splitlines()[-1] == f"results: {folder}"
    assert "report:" not in outcome.out
    assert not page.exists()


def out_of_ink(*_: object, **__: object) -> str:
    raise RuntimeError("out of ink")
