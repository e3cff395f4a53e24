"""Lidar scans in the report: where the beams ended, and what is damaged is left out."""

from typing import Any

from wil_campaign.plugins.lidar.scan_sketch import scans_svg


def scan(source: str = "mixed", **changes: Any) -> dict[str, Any]:
    wil = {"source": source, "start_angle_rad": 0.0, "step_rad": 1.5707963, "range_max_m": 10.0}
    return {"ranges": [2.0, 1.0, None, float("inf")], "wil": {**wil, **changes}}


def test_beams_end_where_they_met_something() -> None:
    drawn = scans_svg([scan("real"), scan()])
    assert drawn is not None
    assert drawn.count('class="beams real"') == drawn.count('class="beams mixed"') == 1
    (path,) = {part for part in drawn.split('"') if part.startswith("M") and part.count("h0") == 2}
    ends = [tuple(map(float, end[1:-2].split(","))) for end in path.split(" ")]
    assert [(round(x), round(y)) for x, y in ends] == [(0, -100), (50, 0)], (
        "ahead, and to the right"
    )


def test_a_damaged_scan_is_left_out() -> None:
    damaged = {"ranges": [1.0], "wil": {"source": "twin"}}
    assert scans_svg([damaged]) is None
    alone = scans_svg([damaged, scan()])
    assert alone is not None
    assert "beams twin" not in alone
