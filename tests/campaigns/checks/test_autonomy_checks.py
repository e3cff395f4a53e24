"""The autonomy under test is built in a child process, which may start late."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.checks import autonomy_checks
from wil_campaign.campaigns.setup.autonomy_under_test import UnderTest


def test_a_child_that_does_not_start_in_time_is_no_built_autonomy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # A limit of 0 s is no limit: a child that is quick has answered by then.
    monkeypatch.setattr(autonomy_checks, "_is_answered", lambda *_: False)
    missing = UnderTest(use="nowhere.py:Autonomy", folder=tmp_path, rate_hz=20.0)
    refusal = autonomy_checks.IsolatedBuilds().trial(missing).refusal
    assert refusal is not None
    assert "could not be checked" in refusal.message


_SCRIPT = """
import threading
from pathlib import Path

with Path("ran").open("a") as file:
    file.write("once ")
threading.Thread(target=threading.Event().wait, daemon=True).start()  # so that nothing is forked
import wil_campaign

print(wil_campaign.validate("hover.yaml"))
"""


def test_a_program_that_checks_a_file_is_not_run_again_for_it(tmp_path: Path) -> None:
    """A program without `if __name__ == "__main__"` may fly before it checks another file."""
    write_hover(tmp_path)
    (tmp_path / "script.py").write_text(_SCRIPT)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, check=False, capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("()\n", "")
    assert (tmp_path / "ran").read_text() == "once "
