"""A search of the obstacle field, scored by the rules of the UAV testing competition.

    wil-campaign search campaigns/search-field.yaml --out results
    python -m bench.competition results/search-field/search/20261123T120000Z

The rules: at most 3 boxes; of each re-run 5 points below 0.25 m (contact included), 2 below 1 m,
1 below 1.5 m; a test's score is mean points x 10 / (boxes^2 x minutes); its diversity 1 - mean
overlap (intersection over union) of its boxes' footprint with those of the others. The system
under test, the field and the distance (of the hull, not of the middle) are ours.
"""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.plugins.search.ledger import FILE_NAME as LEDGER
from wil_campaign.plugins.search.search_document import FILE_NAME

_POINTS = ((0.25, 5), (1.0, 2), (1.5, 1))
_GRID_M = 0.1
_FIELD_M = ((3.0, 18.0), (-7.0, 7.0))
"""North and east of every footprint."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A test with the score of its re-runs. nearest_m: of each re-run; inf where nothing was near.

    standing: as the search found. minutes: mean flight time.
    """

    name: str
    standing: str
    boxes: int
    nearest_m: tuple[float, ...]
    minutes: float
    footprint: NDArray[np.bool_]

    @property
    def points(self) -> float:
        """Return the mean points of the re-runs."""
        return fmean(points_of(one) for one in self.nearest_m)

    @property
    def touched(self) -> int:
        """Return how many of the re-runs touched a box."""
        return sum(one == 0.0 for one in self.nearest_m)

    @property
    def score(self) -> float:
        """Return the score of the test."""
        return self.points * 10.0 / (self.boxes**2 * self.minutes)


def points_of(nearest_m: float) -> int:
    """Return the points of a flight that came so near to a box; 0 m is contact."""
    return next((points for below_m, points in _POINTS if nearest_m < below_m), 0)


def footprint(values: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return the cells of the field on which the boxes of a variant stand."""
    (south, north), (west, east) = _FIELD_M
    rows, columns = np.meshgrid(
        np.arange(south, north, _GRID_M), np.arange(west, east, _GRID_M), indexing="ij"
    )
    covered = np.zeros(rows.shape, bool)
    for number in box_numbers(values):
        ahead, right = (
            rows - float(values[f"north{number}"]),
            columns - float(values[f"east{number}"]),
        )
        yaw_rad = math.radians(float(values[f"turned{number}"]))
        along = ahead * math.cos(yaw_rad) + right * math.sin(yaw_rad)
        across = right * math.cos(yaw_rad) - ahead * math.sin(yaw_rad)
        half_long, half_wide = (float(values[f"{k}{number}"]) / 2.0 for k in ("long", "wide"))
        covered |= (np.abs(along) <= half_long) & (np.abs(across) <= half_wide)
    return covered


def box_numbers(values: Mapping[str, Any]) -> list[int]:
    """Return the boxes that stand in a variant."""
    return [1, *(number for number in (2, 3) if values[f"there{number}"] == "Wv")]


def diversity(tests: Sequence[Scored]) -> float | None:
    """Return 1 - mean overlap of the footprints of each two tests; None below two tests."""
    overlaps = [
        float((test.footprint & other.footprint).sum() / (test.footprint | other.footprint).sum())
        for index, test in enumerate(tests)
        for other in tests[:index]
    ]
    return 1.0 - fmean(overlaps) if overlaps else None


def scored_tests(folder: Path) -> list[Scored]:
    """Return the failing variants of a search that were flown again, scored."""
    document = json.loads((folder / FILE_NAME).read_text("utf-8"))
    again = _confirmations(folder)
    return [
        _scored(one, [read_result(path) for path in again[one["name"]]])
        for one in document["failures"]
    ]


def _confirmations(folder: Path) -> dict[str, list[Path]]:
    """Return the results of the re-runs, by variant."""
    found: dict[str, list[Path]] = {}
    for line in (folder / LEDGER).read_text("utf-8").splitlines():
        batch = json.loads(line).get("begun")
        if batch is None or batch["purpose"] != "confirm":
            continue
        name = batch["flights"][0]["variant"]["name"]
        home = folder / "flights" / f"{batch['number']:04d}" / name / batch["mode"]
        found[name] = sorted(home.glob("*/result.json"))
    return found


def _scored(failure: Mapping[str, Any], runs: Sequence[RunResult]) -> Scored:
    values = failure["values"]
    proven = [run for run in runs if run.verdict in {"PASS", "FAIL"}]
    return Scored(
        name=failure["name"],
        standing=failure["standing"],
        boxes=len(box_numbers(values)),
        nearest_m=tuple(_nearest_m(one) for one in proven),
        minutes=fmean((one.duration_s or 0.0) / 60.0 for one in proven),
        footprint=footprint(values),
    )


def _nearest_m(result: RunResult) -> float:
    """Return how near a flight came to a box."""
    found = [
        oracle.actual
        for oracle in result.oracles
        if oracle.name == "clearance" and oracle.actual is not None
    ]
    return min((float(one) for one in found if isinstance(one, int | float)), default=math.inf)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="of a search of campaigns/search-field.yaml")
    tests = scored_tests(parser.parse_args().folder)
    print("test  standing  boxes  failed  nearest of each re-run, m  min  score")
    for one in sorted(tests, key=lambda test: -test.score):
        near = " ".join(f"{m:.2f}" for m in one.nearest_m)
        failed = sum(points_of(m) > 0 for m in one.nearest_m)
        counted = f"{failed}/{len(one.nearest_m)}"
        print(
            f"{one.name} {one.standing:<9} {one.boxes}  {counted}  {near}  "
            f"{one.minutes:.2f}  {one.score:.2f}"
        )
    confirmed = [one for one in tests if one.standing == "confirmed"]
    hard = [
        one for one in confirmed if sum(m == 0.0 for m in one.nearest_m) * 2 > len(one.nearest_m)
    ]
    shown = diversity(confirmed)
    print(
        f"{len(confirmed)} of {len(tests)} failing tests confirmed, {len(hard)} by contact; "
        f"score {sum(one.score for one in confirmed):.2f} in all, "
        f"diversity {'-' if shown is None else f'{shown:.2f}'}"
    )


if __name__ == "__main__":
    main()
