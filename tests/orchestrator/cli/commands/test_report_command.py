"""`wil-campaign report`, and the report at the end of `run`: neither changes a result."""

import json
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from tests.orchestrator.report.recorded_campaign import summary_of_campaign, write_campaign
from wil_campaign.orchestrator.campaign.campaign_runner import CampaignOutcome
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.commands import run as run_command
from wil_campaign.orchestrator.report import campaign_report

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


def test_the_report_of_a_search_is_not_replaced(tmp_path: Path, capsys: Capture) -> None:
    """As the report of a campaign without flights, for its flights are of campaigns beneath."""
    flight = tmp_path / "flights" / "0001"
    flight.mkdir(parents=True)
    for place in (tmp_path, flight):
        (place / "campaign.json").write_text("{}")
    (tmp_path / "report.html").write_text("of the search")
    assert main(["report", str(tmp_path)]) == 2
    assert "is the folder of a search" in capsys.readouterr().err
    assert (tmp_path / "report.html").read_text() == "of the search"


def test_run_writes_a_report_and_one_that_fails_changes_nothing(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_campaign(tmp_path / "flown")
    result = CampaignOutcome(summary=summary_of_campaign(), folder=folder, exit_code=1)
    monkeypatch.setattr(run_command, "fly_campaign", lambda *_: result)
    command = ["run", str(write_hover(tmp_path)), "--out", str(tmp_path / "out")]

    assert main(command) == 1
    lines = capsys.readouterr().out.splitlines()
    at = lines.index(f"report: {folder / 'report.html'}")
    assert lines[at + 1] == f"results: {folder}"
    assert all(line.startswith("next: ") for line in lines[at + 2 :])
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
    assert f"results: {folder}" in outcome.out.splitlines()
    assert "report:" not in outcome.out
    assert "open the report" not in outcome.out
    assert not page.exists()


def out_of_ink(*_: object, **__: object) -> str:
    raise RuntimeError("out of ink")


def test_a_video_that_was_not_made_is_offered_and_made_when_asked_for(
    tmp_path: Path, capsys: Capture
) -> None:
    folder = write_campaign(tmp_path / "gate")
    assert main(["report", str(folder)]) == 0
    page = folder / "report.html"
    offer = "<code>wil-campaign report . --video large/wil/1</code>"
    assert offer in page.read_text()
    assert main(["report", str(folder), "--video", "large/wil/1"]) == 0
    assert (folder / "large/wil/1/mixed.mp4").read_bytes()[4:8] == b"ftyp"
    assert not (folder / "large/sim/1/mixed.mp4").exists()
    assert offer not in page.read_text()
    assert 'src="data:video/mp4;base64,' in page.read_text()

    assert main(["report", str(folder), "--video", "all"]) == 0
    assert (folder / "large/sim/1/mixed.mp4").is_file()
    capsys.readouterr()
    assert main(["report", str(folder), "--video", "large/wil/2"]) == 2
    outcome = capsys.readouterr()
    assert outcome.err.startswith("--video large/wil/2: no run of ")
    assert "there are large/sim/1, large/wil/1" in outcome.err

    (folder / "large/wil/1/run.mcap").unlink()
    assert main(["report", str(folder), "--video", "large/wil/1"]) == 3
    assert "large/wil/1: no video: " in capsys.readouterr().err
