"""docs/ci.md: the examples are YAML, and their commands are ones that the program has."""

import re
import shlex
from typing import Any

import pytest
import yaml

from tests.test_house import ROOT
from wil_campaign.orchestrator.cli import build_app
from wil_campaign.plugins.start.init_command import _filled

STARTERS = ROOT / "plugins" / "start" / "starter"
PAGE = (ROOT / "docs" / "ci.md").read_text("utf-8")


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


WORKFLOWS = [path.read_text("utf-8") for path in (ROOT / "docs" / "examples").glob("*.yml")]
LINES = [
    line
    for text in (*blocks("yaml"), *WORKFLOWS, _filled("github-workflow.yml.in", "first"))
    for line in commands(yaml.safe_load(text))
    if line.startswith("wil-campaign ")
] + [line for text in blocks("sh") for line in text.splitlines()]


def test_the_page_has_both_systems_with_junit() -> None:
    _, gitlab = (yaml.safe_load(text) for text in blocks("yaml"))
    github = yaml.safe_load(_filled("github-workflow.yml.in", "first"))
    assert "upload-artifact" in str(github["jobs"])
    assert "--junit" in str(github["jobs"])
    assert gitlab["fly"]["artifacts"]["reports"]["junit"] == "junit.xml"
    assert len(LINES) >= 8


def test_the_page_uses_the_action_of_this_repository_by_its_inputs() -> None:
    action = yaml.safe_load((ROOT / "action.yml").read_text("utf-8"))
    page = yaml.safe_load(blocks("yaml")[0])
    (step,) = (one for one in page["jobs"]["fly"]["steps"] if "wil-campaign" in one["uses"])
    assert set(step["with"]) <= set(action["inputs"])
    needed = {name for name, one in action["inputs"].items() if one.get("required")}
    assert needed <= set(step["with"])


def test_a_workflow_to_copy_builds_a_wheel_tries_it_and_attaches_it() -> None:
    wheel = yaml.safe_load((ROOT / "docs" / "examples" / "wheel.yml").read_text("utf-8"))
    assert wheel[True]["push"]["tags"]  # YAML 1.1 reads the key `on` as true
    lines = [step["run"] for step in wheel["jobs"]["wheel"]["steps"] if "run" in step]
    order = ("pip wheel", "pip install", "wil-campaign --version", "wil-campaign run", "gh release")
    assert [line.startswith(one) for line, one in zip(lines, order, strict=True)] == [True] * 5


def test_nothing_promises_a_release_on_an_index() -> None:
    """By name alone pip finds the program only where it is installed: extras are added to it."""
    pages = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md", *STARTERS.iterdir()]
    by_name = re.compile(r"pip install [^\n&]*?\bwil-campaign(?!\[|==VERSION| @ )")
    found = {path.name: by_name.findall(path.read_text("utf-8")) for path in pages}
    assert {name for name, lines in found.items() if lines} == set()


@pytest.mark.parametrize("line", LINES)
def test_a_command_of_the_page_is_one_of_the_program(line: str) -> None:
    program, *words = shlex.split(line, comments=True)
    assert program == "wil-campaign"
    function, *_ = build_app().parse_args(words, exit_on_error=False, print_error=False)
    assert callable(function)
