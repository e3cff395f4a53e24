"""The beginning and the end of the program: quick, and with the exit handlers of everybody."""

import subprocess
import sys
from pathlib import Path

import pytest

BEFORE = "import atexit; atexit.register(print, 'handler of before')\n"
PROGRAM = """\
import atexit
import sys
from wil_campaign.__main__ import run_program

class Freed:
    def __del__(self):
        print("freed")

kept = Freed()
sys.argv = ["wil-campaign", "plan", "nowhere.yaml"]
code = run_program()
atexit.register(print, "handler of after")
sys.exit(code)
"""
STARTING = """\
import sys
from wil_campaign.orchestrator.campaign.workers import run_server
from wil_campaign.orchestrator.cli import main

def start():
    print("started", any(name.endswith(("commands.run", "search_command")) for name in sys.modules))

run_server.start_run_server = start
main(sys.argv[1:])
"""


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("run nowhere.yaml", ["started False", "started True"]),
        ("search nowhere.yaml", ["started False", "started True"]),
        ("run nowhere.yaml --help", []),
        ("validate nowhere.yaml", []),
    ],
)
def test_the_run_server_starts_before_a_command_that_flies_is_imported(
    line: str, said: list[str], tmp_path: Path
) -> None:
    """Both take a second. The command itself starts it as well, and says why it cannot."""
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", STARTING, *line.split()],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert [text for text in done.stdout.splitlines() if text.startswith("started")] == said


@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("", ["handler of after"]),
        (BEFORE, ["handler of after", "handler of before", "freed"]),
    ],
    ids=["alone", "beside others"],
)
def test_all_exit_handlers_are_called_and_the_code_is_kept(
    before: str, said: list[str], tmp_path: Path
) -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", before + PROGRAM],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert "nowhere.yaml" in done.stderr
    assert done.stdout.splitlines() == said


INTERRUPTED = """\
import sys
from wil_campaign.__main__ import run_program

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "wil_campaign.orchestrator.cli":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupting())
sys.exit(run_program())
"""


def test_ctrl_c_while_the_program_is_imported_is_one_word() -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")
