"""`wil-campaign list`: what campaigns can name."""

import json
from pathlib import Path
from typing import get_args

import pytest

from tests.orchestrator.cli.commands.test_cli_commands import ROOT, Cli
from wil_campaign.plugins.start.list_command import What
from wil_campaign.plugins.start.step_docs import describe_step
from wil_campaign.recipes.model.registry import registered_steps


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Cli:
    monkeypatch.chdir(ROOT)
    return Cli(capsys)


def test_list_alone_shows_what_can_be_listed(cli: Cli) -> None:
    outcome = cli("list")
    assert outcome.code == 0
    commands = [line.split("  ")[0] for line in outcome.out.splitlines()]
    assert commands[2:] == [f"wil-campaign list {what}" for what in get_args(What)]
    for row in json.loads(cli("list", "--json").out):
        assert cli(*row["command"].split()[1:]).code == 0


@pytest.mark.parametrize(
    ("what", "name"),
    [
        ("campaigns", "gate"),
        ("operators", "overlay"),
        ("autonomies", "gate"),
        ("oracles", "collision"),
        ("signals", "clearance_m"),
    ],
)
def test_list_shows_all_that_is_available(cli: Cli, what: str, name: str) -> None:
    rows = json.loads(cli("list", what, "--json").out)
    assert name in [row["name"] for row in rows]
    outcome = cli("list", what)
    assert outcome.code == 0
    assert name in [line.split()[0].rstrip(":") for line in outcome.out.splitlines() if line]


def test_list_oracles_documents_every_parameter(cli: Cli) -> None:
    rows = {row["name"]: row for row in json.loads(cli("list", "oracles", "--json").out)}
    assert all(each["meaning"] for row in rows.values() for each in row["parameters"])
    (limit,) = rows["time_limit"]["parameters"]
    assert (limit["name"], limit["unit"], limit["needed"]) == ("limit_s", "s", True)
    assert (rows["time_limit"]["window"], rows["time_limit"]["fail_fast"]) == (
        "from goal to done",
        True,
    )
    text = cli("list", "oracles").out
    assert "    max_gap_s  number, s  needed  the longest silence that is allowed" in text
    assert "every oracle takes" in text


def test_list_operators_tells_shapes_units_and_parameters(cli: Cli) -> None:
    rows = {row["name"]: row for row in json.loads(cli("list", "operators", "--json").out)}
    assert "(h, w, 3) uint8" in rows["resize"]["details"]
    text = cli("list", "operators").out
    assert "geodetic (transform; pose -> gps): Convert a local position into a fix" in text
    lines = [line.split() for line in text.splitlines()]
    assert ["soft_edge_px", "number", "0"] in lines


def test_list_campaigns_finds_those_of_the_folder_and_the_shipped(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "campaigns").mkdir()
    (tmp_path / "campaigns" / "mine.yaml").write_text("campaign: mine\ndescription: of mine")
    (tmp_path / "campaigns" / "bad.yaml").write_text("a: [")
    monkeypatch.chdir(tmp_path)
    rows = {row["file"]: row for row in json.loads(cli("list", "campaigns", "--json").out)}
    assert rows["campaigns/mine.yaml"]["description"] == "of mine"
    assert "not YAML" in rows["campaigns/bad.yaml"]["description"]
    assert str(ROOT / "wil_campaign" / "campaigns" / "gate.yaml") in rows


def test_every_step_is_described_with_its_parameters() -> None:
    docs = {(doc.name, doc.stage): doc for doc in map(describe_step, registered_steps())}
    resize = docs["resize", "transform"]
    assert resize.sensors == ("camera", "depth")
    assert "(h, w, 3) uint8" in resize.details
    on, to, aspect = resize.parameters
    assert (aspect.takes, aspect.default) == ("fit | crop | pad", "fit")
    assert (on.name, on.takes, on.default, on.needed) == (
        "on",
        "real | twin | both",
        "twin",
        False,
    )
    assert (to.takes, to.needed) == ("real | twin or {width_px, height_px}", True)
    assert docs["geodetic", "transform"].gives == "gps"
    assert docs["use", "filter"].parameters[-1].name == "with"
    overlay = {parameter.name: parameter for parameter in docs["overlay", "merge"].parameters}
    assert overlay["priority"].default == "[twin, real]"
    for doc in docs.values():
        assert doc.summary.endswith((".", ":"))
        assert doc.notes
