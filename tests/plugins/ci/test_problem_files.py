"""Faults of files as SARIF and as GitLab's code quality, by `validate`."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.foundation.files.problems import Problem
from wil_campaign.orchestrator.cli import main
from wil_campaign.plugins.ci.problem_files import code_quality_text, sarif_text


def validated(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, old: str = "", new: str = ""
) -> tuple[int, Any, Any]:
    """Validate a campaign in `sub dir`; return the code, the SARIF and the code quality."""
    monkeypatch.setenv("CI_PROJECT_DIR", str(folder))
    monkeypatch.delenv("GITHUB_WORKSPACE", raising=False)
    (folder / "sub dir").mkdir(exist_ok=True)
    file = write_hover(folder / "sub dir")
    file.write_text(file.read_text().replace(old, new, 1) if old else file.read_text())
    names = [folder / "a.sarif", folder / "b.json"]
    options = ["--sarif", str(names[0]), "--codequality", str(names[1])]
    code = main(["validate", str(file), *options])
    return code, *(json.loads(name.read_text("utf-8")) for name in names)


def test_a_file_that_can_be_used_has_at_most_warnings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, sarif, quality = validated(tmp_path, monkeypatch)
    assert code == 0
    assert sarif["version"] == "2.1.0"
    assert sarif["runs"][0]["tool"]["driver"]["name"] == "wil-campaign"
    results = sarif["runs"][0]["results"]
    assert {result["level"] for result in results} == {"warning"}
    assert {one["severity"] for one in quality} == {"minor"}
    assert {one["location"]["path"] for one in quality} == {"sub dir/still.py"}
    assert json.loads(sarif_text((), ()))["runs"][0]["results"] == []
    assert json.loads(code_quality_text((), ())) == []


def test_a_fault_has_its_place_in_the_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, sarif, quality = validated(tmp_path, monkeypatch, old="goal:", new="\ngaol: 1\ngoal:")
    assert code == 2
    result, issue = sarif["runs"][0]["results"][0], quality[0]
    (location,) = result["locations"]
    place = location["physicalLocation"]
    assert place["artifactLocation"]["uri"] == "sub%20dir/hover.yaml"
    line = place["region"]["startLine"]
    text = (tmp_path / "sub dir" / "hover.yaml").read_text().splitlines()[line - 1]
    assert text.startswith("gaol")
    assert place["region"]["startColumn"] == 1
    assert result["level"] == "error"
    assert "did you mean 'goal'?" in result["message"]["text"] == issue["description"]
    assert issue["location"] == {"path": "sub dir/hover.yaml", "lines": {"begin": line}}
    assert issue["severity"] == "major"
    _, _, moved = validated(tmp_path, monkeypatch, old="goal:", new="\n\n\ngaol: 1\ngoal:")
    assert moved[0]["fingerprint"] == issue["fingerprint"]
    assert moved[0]["location"]["lines"]["begin"] == line + 2


def test_equal_faults_differ_and_what_is_no_file_has_no_location() -> None:
    twice = (Problem("--set a=1", 1, 1, "is wrong"), Problem("--set a=1", 1, 1, "is wrong"))
    warned = (Problem("--set a=1", 0, 0, "is odd"),)
    quality = json.loads(code_quality_text(twice, warned))
    assert len({one["fingerprint"] for one in quality}) == 3
    assert [one["severity"] for one in quality] == ["major", "major", "minor"]
    results = json.loads(sarif_text(twice, warned))["runs"][0]["results"]
    assert [result["level"] for result in results] == ["error", "error", "warning"]
    assert "locations" not in results[0]
    assert results[2]["message"]["text"] == "--set a=1: is odd"


def test_a_document_that_cannot_be_written_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_hover(tmp_path)
    assert main(["validate", str(file), "--sarif", str(tmp_path / "no" / "a.sarif")]) == 3
    assert "a.sarif: cannot be written: No such file" in capsys.readouterr().err
