"""What flights need: as the last ones of the campaign, else a guess that says so."""

import json
from pathlib import Path

import pytest

from wil_campaign.orchestrator.cli.flight_needs import needs_text


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
    text = needs_text(tmp_path / "none", flights=24, at_once=2, clock="virtual")
    assert text == "about 2 minutes and 170 MB (a guess)"


def test_the_newest_flights_by_the_same_clock_count(tmp_path: Path) -> None:
    flown(tmp_path / "20260101T000000Z", wall_s=4.0)
    flown(tmp_path / "20260102T000000Z", wall_s=50.0, clock="wall")
    text = needs_text(tmp_path, flights=4, at_once=2, clock="virtual")
    assert text == "about 10 s and 7 MB (as last time)"
    text = needs_text(tmp_path, flights=300, at_once=1, clock="wall")
    assert text == "about 4.2 hours and 460 MB (as last time)"


@pytest.mark.parametrize("content", ["", "[]", '{"clock": "virtual", "runs": 7}', "{\0"])
def test_an_unreadable_summary_is_no_error(tmp_path: Path, content: str) -> None:
    folder = tmp_path / "20260101T000000Z"
    folder.mkdir()
    (folder / "summary.json").write_text(content)
    text = needs_text(tmp_path, flights=1, at_once=1, clock="wall")
    assert text.endswith("(a guess)")
