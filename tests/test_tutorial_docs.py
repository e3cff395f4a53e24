"""docs/tutorial.md, and README.md: what they show of the campaign is what `init` writes."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.test_house import ROOT
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.orchestrator.cli import main

PAGE = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
START = "        if self._through_from_s is not None:\n"
END = "            return Command(self._velocity(telemetry, ahead), done=is_through"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def add_the_case_of_the_page(path: Path) -> None:
    """Change the campaign file as section 3 of the page says."""
    cases, accept = blocks("yaml")
    text = path.read_text()
    *known, own = cases.splitlines(keepends=True)
    assert "".join(known) in text
    before = text[text.index("accept:") :].splitlines(keepends=True)[0]
    path.write_text(text.replace("".join(known), "".join(known) + own).replace(before, accept))


def mend_the_autonomy(autonomy: Path) -> None:
    """Change the autonomy as section 4 of the page says."""
    (mended,) = blocks("python")
    code = autonomy.read_text()
    part = code[code.index(START) : code.index(END)]
    autonomy.write_text(code.replace(part, mended))


def test_the_changes_of_the_page_fit_what_init_writes(tmp_path: Path) -> None:
    assert main(["init", "first", "--in", str(tmp_path)]) == 0
    path = tmp_path / "campaign.yaml"
    add_the_case_of_the_page(path)
    mend_the_autonomy(tmp_path / "autonomy.py")
    campaign = load_campaign(path)
    required = {f"{plan.case}/{plan.mode}" for plan in campaign.runs if plan.required}
    assert required == {"wide/sim", "wide/wil", "fast/sim", "fast/wil"}


def in_it(shown: Any, written: Any) -> bool:
    """Return whether what a page shows is part of what is written; `...` stands for anything."""
    if not isinstance(shown, dict) or not isinstance(written, dict):
        return bool(shown == written)
    kept = {key: value for key, value in shown.items() if key != "..."}
    return all(key in written and in_it(value, written[key]) for key, value in kept.items())


def test_what_the_readme_shows_of_the_campaign_is_in_it(tmp_path: Path) -> None:
    main(["init", "first", "--in", str(tmp_path)])
    readme = (ROOT / "README.md").read_text("utf-8")
    shown = yaml.safe_load(readme.partition("```yaml\n")[2].partition("```")[0])
    assert in_it(shown, yaml.safe_load((tmp_path / "campaign.yaml").read_text()))


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


def printed_lines(text: str) -> set[str]:
    """Return what was printed, without what fills a table, the time, and which run ended first."""
    changing = {r"\d{8}T\d{6}Z": "TIME", r"^\[\d/\d\] ": ""}
    lines = {line.rstrip() for line in text.splitlines()}
    for pattern, instead in changing.items():
        lines = {re.sub(pattern, instead, line) for line in lines}
    return lines


def test_the_flights_of_the_page_print_what_it_shows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    main(["init", "first", "--in", str(tmp_path)])
    monkeypatch.chdir(tmp_path)
    add_the_case_of_the_page(tmp_path / "campaign.yaml")
    _, _, first, failed, mended = (printed_lines(text) for text in blocks("text"))
    capsys.readouterr()
    assert main(["run", "campaign.yaml", "--case", "fast"]) == 1
    assert failed - {"..."} <= printed_lines(capsys.readouterr().out)
    mend_the_autonomy(tmp_path / "autonomy.py")
    # The first flights are shown again by the last ones: the change is of the fast case alone.
    assert main(["run", "campaign.yaml"]) == 0
    assert (first | mended) - {"..."} <= printed_lines(capsys.readouterr().out)
