"""docs/ci.md: the examples are YAML, and their commands are ones that the program has."""

import re
import shlex
from typing import Any

import pytest
import yaml

from orchestrator.cli import build_app
from tests.test_house import ROOT

PAGE = (ROOT / "docs" / "ci.md").read_text("utf-8")
STARTER = ROOT / "orchestrator" / "cli" / "starter" / "github-workflow.yml.in"


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def commands(found: Any) -> list[str]:
    """Return the command lines of a workflow, wherever in it they stand."""
    if isinstance(found, dict):
        own = [found["run"]] if isinstance(found.get("run"), str) else []
        return own + [line for value in found.values() for line in commands(value)]
    if isinstance(found, list):
        return [
            line for one in found for line in ([one] if isinstance(one, str) else commands(one))
        ]
    return []


LINES = [
    line
    for text in (*blocks("yaml"), STARTER.read_text("utf-8").replace("@NAME@", "first"))
    for line in commands(yaml.safe_load(text))
    if line.startswith("wil-campaign ")
] + [line for text in blocks("sh") for line in text.splitlines()]


def test_the_page_has_both_systems_with_junit() -> None:
    github, gitlab = (yaml.safe_load(text) for text in blocks("yaml"))
    assert "upload-artifact" in str(github["jobs"]["fly"]["steps"])
    assert gitlab["fly"]["artifacts"]["reports"]["junit"] == "junit.xml"
    assert len(LINES) >= 8


@pytest.mark.parametrize("line", LINES)
def test_a_command_of_the_page_is_one_of_the_program(line: str) -> None:
    program, *words = shlex.split(line, comments=True)
    assert program == "wil-campaign"
    function, *_ = build_app().parse_args(words, exit_on_error=False, print_error=False)
    assert callable(function)
