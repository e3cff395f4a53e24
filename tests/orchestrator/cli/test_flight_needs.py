"""What flights need: as the last ones of the campaign, else a guess that says so."""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.test_house import ROOT
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, load_campaign
from wil_campaign.campaigns.schema import Mode
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.orchestrator.cli.flight_needs import (
    FlightNeeds,
    disk_warning,
    flight_needs,
    images_mb_of,
    needs_text,
)


def needs(folder: Path, flights: int, at_once: int, clock: Clock) -> str:
    return needs_text(flight_needs(folder, clock), flights=flights, at_once=at_once)


def flown(folder: Path, *, wall_s: float, clock: str = "virtual", size: int = 3_000_000) -> None:
    folder.mkdir(parents=True)
    document = {
        "clock": clock,
        "runs": [{"wall_s": wall_s}],
        "controls": [{"wall_s": wall_s}, {"wall_s": None}],
    }
    (folder / "summary.json").write_text(json.dumps(document))
    (folder / "run.mcap").write_bytes(b"\0" * size)


def test_a_first_flight_is_a_guess(tmp_path: Path) -> None:
    text = needs(tmp_path / "none", 24, 2, "virtual")
    assert text == "about 2 minutes and 170 MB (a guess)"


def test_the_newest_flights_by_the_same_clock_count(tmp_path: Path) -> None:
    flown(tmp_path / "20260101T000000Z", wall_s=4.0)
    flown(tmp_path / "20260102T000000Z", wall_s=50.0, clock="wall")
    text = needs(tmp_path, 4, 2, "virtual")
    assert text == "about 10 s and 7 MB (as last time)"
    text = needs(tmp_path, 300, 1, "wall")
    assert text == "about 4.2 hours and 460 MB (as last time)"


def test_a_folder_that_another_program_removes_meanwhile_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown(tmp_path / "20260101T000000Z", wall_s=4.0)
    (tmp_path / "20260101T000000Z" / "gone").mkdir()
    listed = os.scandir

    def scandir(path: Any) -> Any:
        if Path(path).name == "gone":
            raise FileNotFoundError(path)
        return listed(path)

    monkeypatch.setattr(os, "scandir", scandir)
    assert needs(tmp_path, 4, 2, "virtual") == "about 10 s and 7 MB (as last time)"


@pytest.mark.parametrize("content", ["", "[]", '{"clock": "virtual", "runs": 7}', "{\0"])
def test_an_unreadable_summary_is_no_error(tmp_path: Path, content: str) -> None:
    folder = tmp_path / "20260101T000000Z"
    folder.mkdir()
    (folder / "summary.json").write_text(content)
    text = needs(tmp_path, 1, 1, "wall")
    assert text.endswith("(a guess)")


DEPTHS = tuple(
    f"vehicles.{name}.sensors={{camera: {{type: depth, rate_hz: 15, width_px: 320, "
    "height_px: 240, fov_deg: 69}}"
    for name in ("real", "twin")
)


@pytest.mark.parametrize(
    ("mode", "sets", "flown_mb"),
    [
        ("wil", (), 7.0),
        # Measured: run.mcap of such flights of 24 s through the gate of `init`.
        ("sim", DEPTHS, 47.0),
        ("wil", DEPTHS, 110.0),
    ],
)
def test_the_guess_counts_the_images_that_are_recorded(
    tmp_path: Path, mode: Mode, sets: tuple[str, ...], flown_mb: float
) -> None:
    given = (*sets, "recipe.sensors.camera.type=depth") if sets else ()
    given += ("recipe.combine.0.filter=[]", "recipe.combine.0.merge={aggregate: {by: min}}")
    gate = load_campaign(
        ROOT / "campaigns/gate.yaml", ExpansionOptions(sets=(*given, "controls={}"))
    )
    images_mb = [images_mb_of(gate.setups["large"], mode)]
    found = flight_needs(tmp_path, "virtual", images_mb=images_mb)
    assert found.disk_mb == pytest.approx(flown_mb, rel=0.25)


@pytest.mark.parametrize(
    ("flights", "free_mb", "warned"),
    [(9, 9e6, False), (11, 9e6, True), (3, 500.0, True), (3, 700.0, False)],
)
def test_much_disk_is_warned_of_before_the_flight(
    flights: int, free_mb: float, *, warned: bool
) -> None:
    text = disk_warning(FlightNeeds(6.0, 100.0, False), flights=flights, free_mb=free_mb)
    assert (text is not None) is warned
    if flights == 11:
        assert text is not None
        assert text.startswith("warning: 11 flights may write 1.1 GB (")
        assert "9000.0 GB are free" in text
    if flights == 3 and warned:
        assert text is not None
        assert "3 flights may write 300 MB (" in text
        assert "; 500 MB are free" in text
