"""A search flown under virtual time by the command line, and the file of the failure it found."""

import json
from pathlib import Path
from typing import Any

import pytest

from orchestrator.cli import main
from orchestrator.search.ledger import read_ledger
from tests.orchestrator.search.searches import SEARCH, write_search

WITH_LIDAR = (
    "autopilot: px4}",
    "autopilot: px4, sensors: {scan: {type: lidar, rate_hz: 5, beams: 16}}}",
)
LONGER = ("autonomy: still.py:Still", "autonomy: {use: still.py:Still, with: {ticks: 20}}")


def flown_height_m(result: Path) -> Any:
    """The highest place of a run, to its last digit."""
    oracles = json.loads(result.read_text())["oracles"]
    return next(one["actual"] for one in oracles if one["name"] == "altitude")


@pytest.mark.timeout(400)
def test_a_failure_is_found_confirmed_made_smaller_and_flown_from_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_search(
        tmp_path, SEARCH.replace("steps: 3", "steps: 2").replace("sim: 3", "sim: 2")
    )
    path.write_text(path.read_text().replace(*WITH_LIDAR).replace(*LONGER))
    out = tmp_path / "out"
    assert main(["search", str(path), "--out", str(out), "--jobs", "1", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    (failure,) = found["failures"]
    assert (failure["cause"], failure["failed"]) == ("altitude/twin", 2)
    assert failure["reduced"]["values"] == {"height": 1.6}
    assert sum(one["flights"] for one in found["costs"]) == 6
    # Open ground, and nothing on it: each sector is empty in each of the flights.
    (scan,) = found["sensed"]
    assert (scan["sensor"], scan["flights"], scan["seen_in"]) == ("scan", 6, 0)
    assert (scan["distinct_readings"], scan["last_new_in_flight"]) == (1, 1)
    levels = [(one["sector"], one["level"], one["flights"]) for one in scan["cells"]]
    assert levels == [(sector, 5, 6) for sector in range(8)]
    (folder,) = (out / "hover" / "search").iterdir()
    assert "nearest by scan" in (folder / "report.html").read_text()
    contents = read_ledger((folder / "ledger.jsonl").read_text())
    assert {one.sensed[0].reduced for each in contents.outcomes.values() for one in each} == {
        ("55555555",)
    }
    assert "<svg" in (folder / "report.html").read_text()
    assert main(["run", str(folder / failure["file"]), "--out", str(tmp_path / "again")]) == 1
    again = sorted((tmp_path / "again").glob("*/*/failure-*/sim/*/result.json"))
    reduced = sorted((folder / "flights" / "0004").glob("*/sim/*/result.json"))
    # The same seeds: the same flights, to the last digit.
    assert [flown_height_m(one) for one in again] == [flown_height_m(one) for one in reduced]
    assert len(again) == 2
