"""`init --ros2`: a campaign with a node, which flies as it is written."""

import os
import shlex
import sys
from pathlib import Path

import pytest
import yaml

from wil_campaign.orchestrator.cli import main

Capture = pytest.CaptureFixture[str]


def test_the_campaign_of_init_flies_by_its_node(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """`python3` is that of the environment in which the program is installed, as in a shell."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    place = tmp_path / "first"
    assert main(["init", "first", "--ros2", "--in", str(place)]) == 0
    capsys.readouterr()
    words = ["--case", "wide", "--mode", "wil", "--set", "controls={}", "--json"]
    words += ["--set", "accept={wide: {wil: 1/1}}", "--out", str(tmp_path / "out")]
    assert main(["run", str(place / "campaign.yaml"), *words]) == 0, capsys.readouterr()
    (log,) = (tmp_path / "out").glob("*/*/wide/wil/1/real-node.log")
    assert log.read_text("utf-8") == ""  # it has nothing to say


def test_the_node_is_short_and_no_class_is_beside_it(tmp_path: Path) -> None:
    assert main(["init", "first", "--ros2", "--in", str(tmp_path)]) == 0
    assert not (tmp_path / "autonomy.py").exists()
    assert len((tmp_path / "node.py").read_text("utf-8").splitlines()) <= 40
    campaign = yaml.safe_load((tmp_path / "campaign.yaml").read_text("utf-8"))
    assert campaign["autonomy"]["ros2"]["command"] == ["python3", "node.py"]
    workflow = yaml.safe_load((tmp_path / ".github/workflows/wil-campaign.yml").read_text("utf-8"))
    lines = [shlex.split(one["run"]) for one in workflow["jobs"]["fly"]["steps"] if "run" in one]
    assert lines[1] == ["pip", "install", "wil-campaign[ros2]"]
    assert lines[2][:2] == ["wil-campaign", "validate"]


def test_a_log_and_a_node_are_two_starts(tmp_path: Path, capsys: Capture) -> None:
    given = ["--ros2", "--from", "flight.bin", "--in", str(tmp_path / "first")]
    assert main(["init", "first", *given]) == 2
    assert "--from flight.bin and --ros2: one start at a time" in capsys.readouterr().err
    assert not (tmp_path / "first").exists()
