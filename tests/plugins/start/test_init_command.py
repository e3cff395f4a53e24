"""init: what it writes is a campaign, and it overwrites nothing."""

import os
import re
import shlex
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.plugins.logs.logs_of_flights import write_tlog
from wil_campaign.campaigns.expansion.expansion import load_campaign
from wil_campaign.campaigns.schema.vehicles import BodyPart
from wil_campaign.campaigns.setup.vehicle_setups import EMBEDDED_BODY
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.installation import program_text
from wil_campaign.plugins.start import init_command
from wil_campaign.plugins.start.schema_command import schema_texts
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.profile import AirframeNumbers, Profile, load_profile

VEHICLE_WIDTH_M = 0.3
Capture = pytest.CaptureFixture[str]
once = cache(schema_texts)


@pytest.fixture(autouse=True)
def schemas_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write the same schemas each time: they take most of the time of an `init`."""
    monkeypatch.setattr(init_command, "schema_texts", once)


def test_init_writes_a_profile_with_every_key_its_unit_and_its_default(tmp_path: Path) -> None:
    assert main(["init", "own", "--in", str(tmp_path), "--profile"]) == 0
    path = tmp_path / "profile.yaml"
    profile, nominal = load_profile(path), load_profile("nominal")
    assert profile.airframe is not None
    for name, value in profile.airframe.model_dump().items():
        assert value == getattr(Airframe(), name), name
    assert profile.model_copy(update={"airframe": None, "description": nominal.description}) == (
        nominal
    )
    text = path.read_text()
    written = yaml.safe_load(text)
    for name, field in Profile.model_fields.items():
        part = written[field.alias or name]
        kind = {"airframe": AirframeNumbers}.get(name, field.annotation)
        if isinstance(part, dict):
            assert part.keys() == kind.model_fields.keys()  # type: ignore[union-attr]
            for key in part:
                assert re.search(rf"(?m)^  {key}: .+  # .", text), key
    campaign = load_campaign(tmp_path / "campaign.yaml")
    assert {run.name for run in campaign.runs} >= {"wide/sim/1"}
    flown = yaml.safe_load((tmp_path / "campaign.yaml").read_text())["vehicles"]
    assert [one["profile"] for one in flown.values()] == ["profile.yaml"] * 2
    for one in flown.values():
        assert BodyPart(**one["body"]).shape() == EMBEDDED_BODY, "the default's values"


def test_init_writes_a_campaign_with_a_control(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "first"]) == 0
    assert capsys.readouterr().out.endswith("next: wil-campaign run first/campaign.yaml\n")
    campaign = load_campaign(Path("first/campaign.yaml"))
    assert campaign.name == "first"
    assert [run.name for run in campaign.runs] == [
        f"{case}/{mode}/1" for case in ("wide", "narrow") for mode in ("sim", "wil")
    ]
    assert [run.name for run in campaign.controls] == ["blind/sim/1", "blind/wil/1"]
    assert campaign.warnings == ()
    written = {path.relative_to("first").as_posix() for path in Path("first").rglob("*.*")}
    workflow = yaml.safe_load(Path("first/.github/workflows/wil-campaign.yml").read_text())
    commands = [step["run"] for step in workflow["jobs"]["fly"]["steps"] if "run" in step]
    assert commands[-1].startswith("wil-campaign run campaign.yaml")
    assert written >= {"campaign.yaml", "world.yaml", "recipe.yaml", "autonomy.py"}
    assert not any("@NAME@" in path.read_text() for path in Path("first").rglob("*.y*ml"))


def install_step(folder: Path) -> dict[str, Any]:
    """Return the first step of the workflow that runs a command."""
    workflow = yaml.safe_load((folder / ".github/workflows/wil-campaign.yml").read_text())
    return next(step for step in workflow["jobs"]["fly"]["steps"] if "run" in step)


@pytest.mark.parametrize(
    "requirement",
    [
        "wil-campaign==0.1.0",
        f"wil-campaign @ git+https://a.b/c/d.git@{'a' * 40}#subdirectory=e",
        f"wil-campaign @ https://a.b/wil_campaign-0.1.0-py3-none-any.whl#sha256={'b' * 64}",
    ],
)
def test_the_workflow_installs_from_where_the_program_came(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, requirement: str
) -> None:
    monkeypatch.setattr(init_command, "pip_requirement", lambda: requirement)
    assert main(["init", "first", "--in", str(tmp_path)]) == 0
    step = install_step(tmp_path)
    assert shlex.split(step["run"]) == ["pip", "install", requirement]
    assert "WIL_CAMPAIGN" not in capsys.readouterr().out


def test_the_workflow_of_a_program_from_a_folder_fails_until_it_is_completed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr(init_command, "pip_requirement", lambda: None)
    assert main(["init", "first", "--in", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "before a first run on GitHub, set WIL_CAMPAIGN in " in said
    assert "flights on this machine do not need it" in said
    text = (tmp_path / ".github/workflows/wil-campaign.yml").read_text()
    assert "came from a folder or file of one machine" in text
    assert program_text() in text
    step = install_step(tmp_path)
    pip = tmp_path / "pip"
    pip.write_text('#!/bin/sh\necho "<$2>"\n')
    pip.chmod(0o755)
    for given, code, shown in (("", 1, ""), ("wil-campaign @ x", 0, "<wil-campaign @ x>\n")):
        done = subprocess.run(  # noqa: S603
            ["bash", "-e", "-c", step["run"]],  # noqa: S607 - as a runner does
            env={"PATH": f"{tmp_path}:{os.environ['PATH']}", **step["env"], "WIL_CAMPAIGN": given},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (code, shown)
        assert ("say in this workflow what pip installs" in done.stderr) == (code == 1)
    assert step["env"] == {"WIL_CAMPAIGN": ""}


def test_a_blind_flight_straight_on_misses_the_gate_by_far(tmp_path: Path) -> None:
    """The control must fail because it never flew through, not because it touched a bar."""
    assert main(["init", "first", "--in", str(tmp_path)]) == 0
    gate = yaml.safe_load((tmp_path / "world.yaml").read_text())["objects"]["gate"]
    shape = gate["shape"]["gate"]
    nearest_bar_m = gate["pose"]["east_m"] - shape["inner_size_m"] / 2 - shape["bar_m"]
    assert nearest_bar_m - VEHICLE_WIDTH_M / 2 >= 0.3


@pytest.mark.parametrize("name", ["123", "1e3", "0x1f", "null", "1.5"])
def test_a_name_that_yaml_reads_as_a_number_is_a_name(tmp_path: Path, name: str) -> None:
    """What `init 123` wrote, `validate` refused: 'must be text, is 123'."""
    log = write_tlog(tmp_path / "flight.tlog")
    for words in ([], ["--profile"], ["--from", str(log)]):
        folder = tmp_path / f"{name}{len(words)}{words[:1]}"
        assert main(["init", name, "--in", str(folder), *words]) == 0
        assert load_campaign(folder / "campaign.yaml").name == name


def test_nothing_is_overwritten(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "world.yaml").write_text("mine")
    assert main(["init", "first", "--in", str(tmp_path)]) == 2
    assert "has world.yaml already; nothing was written" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["world.yaml"]


@pytest.mark.parametrize("name", ["", "../up", "a b", ".hidden", "x" * 65, "a\x1b[31m"])
def test_a_name_that_is_no_folder_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", name]) == 2
    assert "becomes a folder" in (said := capsys.readouterr().err)
    assert "\x1b" not in said
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_an_error(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "file").write_text("")
    assert main(["init", "first", "--in", str(tmp_path / "file" / "below")]) == 3
    assert "cannot be written" in capsys.readouterr().err
