"""docs/tutorial.md: its commands are the program's, its changes fit what `init` writes."""

import re
import shlex
from pathlib import Path

import pytest

from campaigns.expansion.expansion import load_campaign
from orchestrator.cli import build_app, main
from tests.test_house import ROOT

PAGE = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
START = "        if self._through_from_s is not None:\n"
END = "            return Command(self._velocity(telemetry, ahead), done=is_through"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


COMMANDS = [line for text in blocks("sh") for line in text.splitlines() if line != "cd first"]


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_of_the_page_is_one_of_the_program(line: str) -> None:
    program, *words = shlex.split(line)
    assert program == "wil-campaign"
    function, *_ = build_app().parse_args(words, exit_on_error=False, print_error=False)
    assert callable(function)


def test_the_changes_of_the_page_fit_what_init_writes(tmp_path: Path) -> None:
    assert main(["init", "first", "--in", str(tmp_path)]) == 0
    path, autonomy = tmp_path / "campaign.yaml", tmp_path / "autonomy.py"
    cases, accept = blocks("yaml")
    text = path.read_text()
    *known, own = cases.splitlines(keepends=True)
    assert "".join(known) in text
    before = text[text.index("accept:") :].splitlines(keepends=True)[0]
    path.write_text(text.replace("".join(known), "".join(known) + own).replace(before, accept))
    (mended,) = blocks("python")
    code = autonomy.read_text()
    part = code[code.index(START) : code.index(END)]
    autonomy.write_text(code.replace(part, mended))
    campaign = load_campaign(path)
    required = {f"{plan.case}/{plan.mode}" for plan in campaign.runs if plan.required}
    assert required == {"wide/sim", "wide/wil", "fast/sim", "fast/wil"}


def test_the_table_of_the_plan_is_what_init_writes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["init", "first", "--in", str(tmp_path)])
    capsys.readouterr()
    assert main(["plan", str(tmp_path / "campaign.yaml")]) == 0
    printed = capsys.readouterr().out.splitlines()
    shown = [line for line in blocks("text")[1].splitlines() if "/1" in line or "  1  " in line]
    assert len(shown) == 7
    assert [line for line in shown if line not in printed] == []
