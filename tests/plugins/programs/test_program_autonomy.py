"""What a campaign may say of an autonomy that is a program."""

from pathlib import Path

import pytest

from tests.campaigns.conftest import Files
from tests.campaigns.setup.test_external_setups import needs, setup
from wil_campaign.plugins.programs.program_autonomy import ProgramAutonomy


def program(files: Files, text: str) -> None:
    files.change("autonomy: {use: pilot.py:Pilot, with: {speed_m_s: 0.8}}", f"autonomy: {text}")


def test_an_autonomy_may_be_a_program(files: Files) -> None:
    program(files, "{program: [python3, fly.py], with: {speed_m_s: 0.8}}")
    under_test = setup(files).under_test
    assert under_test.foreign == ProgramAutonomy(("python3", "fly.py"))
    assert under_test.folder == files.folder.resolve()
    assert under_test.goal == {"altitude_m": 1.2, "gate_count": 1}
    assert needs(files) == ["the program python3"]


def test_a_program_beside_the_campaign_is_found(files: Files) -> None:
    program(files, "{program: [./fly]}")
    assert any("there is no file './fly' beside" in fault for fault in files.faults())
    path = Path(files.folder / "fly")
    path.touch()
    assert any("is not executable" in fault for fault in files.faults())
    path.chmod(0o755)
    assert setup(files).under_test.foreign == ProgramAutonomy(("./fly",))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{program: [no-such-program]}", "there is no program 'no-such-program' in PATH"),
        ("{program: []}", "at least 1"),
        ("{with: {}}", "give use: (a class) or program: (a command line)"),
        ("{use: pilot.py:Pilot, program: [python3]}", "has no effect with a program"),
    ],
)
def test_impossible_programs_are_refused(files: Files, text: str, said: str) -> None:
    program(files, text)
    assert any(said in fault for fault in files.faults())
