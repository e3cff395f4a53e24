"""action.yml and Containerfile: their scripts run here, and name what is there."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.orchestrator.hover import write_hover
from tests.test_house import ROOT
from wil_campaign.orchestrator.cli import build_app

ACTION = yaml.safe_load((ROOT / "action.yml").read_text("utf-8"))
STEPS = {step.get("name"): step for step in ACTION["runs"]["steps"]}
CONTAINER = re.sub(r"\\\n", "", (ROOT / "Containerfile").read_text("utf-8"))
INPUTS = {name: one.get("default", "") for name, one in ACTION["inputs"].items()}


def perform(step: str, folder: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """Run a step's script as a runner does, where `pip` says what it is given."""
    tools = folder / "tools"
    tools.mkdir(exist_ok=True)
    words = shlex.join([sys.executable, "-P", "-m", "wil_campaign"])
    for name, line in (("wil-campaign", f'exec {words} "$@"'), ("pip", 'echo "pip $*"')):
        (tools / name).write_text(f"#!/bin/sh\n{line}\n")
        (tools / name).chmod(0o755)
    given: dict[str, Any] = STEPS[step]["env"]
    values = {**INPUTS, **inputs}
    environment = {
        name: re.sub(r"\$\{\{ inputs\.(\S+) \}\}", lambda found: values[found[1]], text)
        for name, text in given.items()
    }
    job = {
        "GITHUB_ACTIONS": "true",
        "GITHUB_STEP_SUMMARY": str(folder / "summary.md"),
        "GITHUB_ACTION_PATH": "/action",
        "GITHUB_WORKSPACE": str(folder),
        "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    return subprocess.run(  # noqa: S603 - our own scripts
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", STEPS[step]["run"]],  # noqa: S607
        cwd=folder,
        env={**os.environ, **job, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_action_validates_flies_and_shows_what_failed(tmp_path: Path) -> None:
    write_hover(tmp_path)
    inputs = {
        "campaign": "hover.yaml",
        "options": "--repetitions 1  --set oracles.altitude.max_m=9",
    }
    done = perform("Validate", tmp_path, **inputs)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "results" / "faults.sarif").read_text())["version"] == "2.1.0"
    done = perform("Fly", tmp_path, **inputs)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "results" / "junit.xml").read_text().count("<testcase") == 1
    assert "### hover: accepted" in (tmp_path / "summary.md").read_text("utf-8")
    inputs["options"] = "--repetitions 1\n--set oracles.altitude.max_m=0.1\n"  # of a block of YAML
    done = perform("Fly", tmp_path, **inputs)
    assert done.returncode == 1
    assert "::error file=hover.yaml,line=1," in done.stderr
    assert "### hover: not accepted" in (tmp_path / "summary.md").read_text("utf-8")
    done = perform("Validate", tmp_path, campaign="nothing.yaml")
    assert done.returncode == 2


@pytest.mark.parametrize(
    ("inputs", "lines"),
    [
        ({}, ["pip install -q -c /action/constraints.txt /action"]),
        (
            {"extras": "ros2,search", "requirements": "mine.txt"},
            [
                "pip install -q -c /action/constraints.txt /action[ros2,search]",
                "pip install -q -r mine.txt",
            ],
        ),
    ],
)
def test_the_action_installs_its_checkout(
    tmp_path: Path, inputs: dict[str, str], lines: list[str]
) -> None:
    assert perform("Install wil-campaign", tmp_path, **inputs).stdout.splitlines() == lines
    assert (ROOT / "constraints.txt").is_file()


def test_the_action_names_only_inputs_that_it_has() -> None:
    named = set(re.findall(r"\binputs\.([\w-]+)", (ROOT / "action.yml").read_text("utf-8")))
    assert named == set(INPUTS)


def test_the_image_has_what_a_wheel_is_built_of() -> None:
    copied = re.findall(r"^COPY (.+) \S+$", CONTAINER, re.MULTILINE)
    sources = {word for line in copied for word in line.split()}
    assert {name for name in sources if not (ROOT / name).exists()} == set()
    hook = (ROOT / ".ci" / "build_hook.py").read_text("utf-8")
    folders = re.search(r"^FOLDERS = \((.+)\)$", hook, re.MULTILINE)
    assert folders is not None
    needed = {*re.findall(r'"(\w+)"', folders[1]), "wil_campaign", ".ci", "pyproject.toml"}
    assert needed <= sources
    extras = re.search(r"^ARG EXTRAS=(\S+)$", CONTAINER, re.MULTILINE)
    assert extras is not None
    assert all(
        f"\n{extra} = [" in (ROOT / "pyproject.toml").read_text() for extra in extras[1].split(",")
    )


def test_the_commands_of_the_image_are_ours_and_their_campaigns_are_there() -> None:
    """They are not flown here: CI flies gate.yaml by other tests."""
    (command,) = re.findall(r"^CMD (.+)$", CONTAINER, re.MULTILINE)
    (flown,) = re.findall(r"^RUN wil-campaign (.+?) &&", CONTAINER, re.MULTILINE)
    assert 'ENTRYPOINT ["wil-campaign"]' in CONTAINER
    for words in (json.loads(command), shlex.split(flown)):
        function, bound, _ = build_app().parse_args(words, exit_on_error=False, print_error=False)
        assert callable(function)
        file = str(bound.args[0]).removeprefix("/opt/wil-campaign/")
        assert (ROOT / file).is_file(), words


EXAMPLES = ROOT / "docs" / "examples"


@pytest.mark.parametrize("script", [".ci/run", ".ci/run-ray", "docs/examples/night.sbatch"])
def test_the_scripts_of_ci_and_of_a_night_are_scripts(script: str) -> None:
    """`.ci/run-ray` runs the last one with a real Ray, each night."""
    path = ROOT / script
    done = subprocess.run(  # noqa: S603 - our own scripts
        ["bash", "-n", str(path)],  # noqa: S607
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_all_pods_of_the_kubernetes_night_have_one_image_and_the_token() -> None:
    spec = yaml.safe_load((EXAMPLES / "night.yaml").read_text("utf-8"))["spec"]
    cluster = spec["rayClusterSpec"]
    pods = [cluster["headGroupSpec"], *cluster["workerGroupSpecs"]]
    containers = [pod["template"]["spec"]["containers"][0] for pod in pods]
    containers.append(spec["submitterPodTemplate"]["spec"]["containers"][0])
    assert {container["image"] for container in containers} == {"IMAGE"}
    names = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_worker_niceness"}
    assert all({each["name"] for each in container["env"]} == names for container in containers)
    assert spec["backoffLimit"] == 0, "a campaign is never flown again by itself"
