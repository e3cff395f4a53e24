"""Standard output as the command line hands it on."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from wil_campaign.orchestrator.cli import INTERNAL_ERROR, main
from wil_campaign.orchestrator.cli.standard_streams import ignore_broken_pipe


def test_the_stream_of_a_display_is_not_its_to_close(monkeypatch: pytest.MonkeyPatch) -> None:
    """From Python 3.13 on the collector reports what its `close` raises."""
    output = io.TextIOWrapper(io.BytesIO())
    monkeypatch.setattr("sys.stdout", output)
    shown = ignore_broken_pipe()
    shown.close()
    assert not output.closed
    output.close()
    ignore_broken_pipe().close()


@pytest.mark.parametrize("columns", ["0", "1"])
def test_help_is_printed_on_a_terminal_of_no_width(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], columns: str
) -> None:
    """In 0 columns nothing was printed; help of `run` was laid out for ever."""
    monkeypatch.setenv("COLUMNS", columns)
    assert main(["--help"]) == 0
    assert int(os.environ["COLUMNS"]) >= 20
    assert "Land all" in capsys.readouterr().out


def test_a_current_folder_that_was_removed_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign = Path("campaigns/gate.yaml").resolve()
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert main(["validate", str(campaign)]) == INTERNAL_ERROR
    assert capsys.readouterr().err == (
        "the current folder was removed: change to one that exists (cd)\n"
    )


@pytest.mark.parametrize("words", [["run", "--help"], ["list", "oracles"]])
def test_a_reader_that_has_seen_enough_causes_no_error(words: list[str]) -> None:
    """As of `| head`: Rich ends the program by SystemExit then, which is no fault of a plugin."""
    program = "import sys; from wil_campaign.orchestrator.cli import main; sys.exit(main())"
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", program, *words]
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, check=False)  # noqa: S603
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (INTERNAL_ERROR, b"")
