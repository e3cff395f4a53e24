"""Recordings and results folders from elsewhere are data: what they name is not run unasked."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.recipes.samples import beam
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.recording.mcap.mcap_writer import McapRecorder

CODE = "from pathlib import Path\nPath({marker!r}).write_text('ran')\n"
STEP = "def take(*given):\n    return given[0]\n"
PLACES: dict[str, dict[str, object]] = {
    "transform": {"transform": [{"use": "theirs.py:take"}], "merge": {"aggregate": "min"}},
    "filter": {"filter": [{"use": "theirs.py:take"}], "merge": {"aggregate": "min"}},
    "merge": {"merge": {"use": "theirs.py:take"}},
}

Write = Callable[[str], Path]


@pytest.fixture
def marker(tmp_path: Path) -> Path:
    """Return the file that appears once the foreign code runs."""
    return tmp_path / "ran"


@pytest.fixture
def recording(tmp_path: Path, marker: Path) -> Write:
    """Return a function that writes a recording whose recipe runs a step of its own in a stage."""
    (tmp_path / "theirs.py").write_text(CODE.format(marker=str(marker)) + STEP)

    def write(stage: str) -> Path:
        recipe = {
            "schema": "wil/recipe/1",
            "sensors": {"range": {"type": "rangefinder"}},
            "combine": [{"sensor": "range", **PLACES[stage]}],
        }
        facts = {"recipe": json.dumps(recipe), "recipe_file": str(tmp_path / "recipe.yaml")}
        path = tmp_path / "run.mcap"
        with McapRecorder(path=path, epoch_s=0.0, clock="virtual", facts=facts) as run:
            run.reading("range", beam(1.0))
        return path

    return write


@pytest.mark.parametrize("stage", [*PLACES])
def test_replay_runs_no_code_that_a_recording_names(
    recording: Write, marker: Path, stage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recording(stage)
    assert main(["replay", str(path)]) == 2
    said = capsys.readouterr()
    assert not marker.exists()
    assert said.out == ""
    assert f"code that would run: {path.parent / 'theirs.py'}:take" in said.err
    assert "--trust" in said.err
    # There is no mixture in it to compare.
    assert main(["replay", str(path), "--trust"]) == 3
    assert marker.read_text() == "ran"


def test_mix_runs_no_code_that_a_recording_names(
    recording: Write, tmp_path: Path, marker: Path
) -> None:
    path = recording("filter")
    own = tmp_path / "own.yaml"
    own.write_text(
        "schema: wil/recipe/1\nsensors: {range: {type: rangefinder}}\n"
        "combine: [{sensor: range, merge: {aggregate: min}}]\n"
    )
    given = ("--real", str(path), "--twin", str(path), "--out", str(tmp_path / "mixed.mcap"))
    main(["mix", str(own), *given])
    assert not marker.exists()
