"""The end of the program: quick, and with the exit handlers of everybody."""

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
