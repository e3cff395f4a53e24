"""A file that an option names is replaced only by one of its kind."""

from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from tests.orchestrator.report.recorded_campaign import write_campaign
from wil_campaign.orchestrator.campaign.folder.campaign_folder import require_writable_results
from wil_campaign.orchestrator.cli import main

COMMANDS = {
    "report": "report {folder} --out {file}",
    "history": "history {folder} --page {file}",
    "compare": "compare {folder} {folder} --page {file}",
    "sarif": "validate {campaign} --sarif {file}",
    "codequality": "validate {campaign} --codequality {file}",
    "run": "run {campaign} --out {out} --junit {file}",
    "calibrate": "calibrate nothing.mp4 --board chessboard:9x6:25mm --out {file}",
}


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("content", ["schema: wil/campaign/1\nmodes: [sim]\n", "[1]", "\x89MCAP"])
def test_another_kind_of_file_is_not_replaced(
    tmp_path: Path, command: str, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if (command, content) == ("codequality", "[1]"):
        return  # so these files begin
    folder, file = write_campaign(tmp_path / "flown"), tmp_path / "mine"
    file.write_text(content)
    words = COMMANDS[command].format(
        folder=folder, file=file, campaign=write_hover(tmp_path), out=tmp_path / "out"
    )
    assert main(words.split()) == 2
    assert f"{file}: is another kind of file" in capsys.readouterr().err
    assert file.read_text() == content


@pytest.mark.parametrize("command", ["report", "history", "compare", "sarif", "codequality"])
def test_one_of_its_own_kind_is(tmp_path: Path, command: str) -> None:
    folder, file = write_campaign(tmp_path / "flown"), tmp_path / "mine"
    words = COMMANDS[command].format(folder=folder, file=file, campaign=write_hover(tmp_path))
    first, second = main(words.split()), main(words.split())
    assert first == second != 2
    assert file.stat().st_size > 1


def test_a_junit_file_of_another_tool_is_replaced(tmp_path: Path) -> None:
    junit = tmp_path / "junit.xml"
    for begin in ("<testsuite/>", '<?xml version="1.0"?>\n<testsuites/>', ""):
        junit.write_text(begin)
        require_writable_results(tmp_path, junit=junit)


def test_a_path_that_is_too_long_is_no_internal_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["judge", "campaigns/gate.yaml", "9" * 300]) == 2
    assert "9...': is too long for a path" in capsys.readouterr().err
