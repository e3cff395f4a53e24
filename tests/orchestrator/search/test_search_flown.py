"""A search flown under virtual time by the command line, and the file of the failure it found."""

import json
from pathlib import Path
from typing import Any

import pytest

from orchestrator.cli import main
from tests.orchestrator.search.searches import SEARCH, write_search


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
    out = tmp_path / "out"
    assert main(["search", str(path), "--out", str(out), "--jobs", "1", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    (failure,) = found["failures"]
    assert (failure["cause"], failure["failed"]) == ("altitude/twin", 2)
    assert failure["reduced"]["values"] == {"height": 1.6}
    assert sum(one["flights"] for one in found["costs"]) == 6
    (folder,) = (out / "hover" / "search").iterdir()
    assert "<svg" in (folder / "report.html").read_text()
    assert main(["run", str(folder / failure["file"]), "--out", str(tmp_path / "again")]) == 1
    again = sorted((tmp_path / "again").glob("*/*/failure-*/sim/*/result.json"))
    reduced = sorted((folder / "flights" / "0004").glob("*/sim/*/result.json"))
    # The same seeds: the same flights, to the last digit.
    assert [flown_height_m(one) for one in again] == [flown_height_m(one) for one in reduced]
    assert len(again) == 2
