"""`wil-campaign report`, and the report at the end of `run`: neither changes a result."""

import json
from pathlib import Path

import pytest

from orchestrator.cli import main
from orchestrator.report import campaign_report
from tests.orchestrator.hover import write_hover
from tests.orchestrator.report.recorded_campaign import write_campaign

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
    assert "no results folder" in capsys.readouterr().err
    assert main(["report", str(folder), "--out", str(tmp_path / "nowhere" / "r.html")]) == 3
    assert "cannot be written" in capsys.readouterr().err


def test_run_writes_a_report_and_one_that_fails_changes_nothing(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = write_hover(tmp_path)
    command = ["run", str(campaign), "--repetitions", "1", "--jobs", "1", "--out"]

    assert main([*command, str(tmp_path / "a")]) == 0
    lines = capsys.readouterr().out.splitlines()
    (page,) = (tmp_path / "a").glob("hover/*/report.html")
    assert lines[-2:] == [f"report: {page}", f"results: {page.parent}"]
    assert 'id="run-default-sim-1"' in page.read_text()

    def broken(*_: object) -> None:
        raise RuntimeError("out of ink")

    monkeypatch.setattr(campaign_report, "render_page", broken)
    assert main([*command, str(tmp_path / "b"), "--json"]) == 0
    outcome = capsys.readouterr()
    assert json.loads(outcome.out)["accepted"] is True
    assert outcome.err.startswith("ERROR: report.html was not written (RuntimeError: out of ink)")
    assert main([*command, str(tmp_path / "c")]) == 0
    outcome = capsys.readouterr()
    assert outcome.out.splitlines()[-1].startswith("results: ")
    assert "report:" not in outcome.out
    assert not list((tmp_path / "c").glob("hover/*/report.html"))
