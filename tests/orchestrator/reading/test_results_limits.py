"""Files of a results folder that would fill the memory: refused, or read as far as the limit."""

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.orchestrator.report.recorded_campaign import write_campaign
from wil_campaign.foundation.files.limited_json import loads_limited_json, read_limited_json
from wil_campaign.foundation.files.limits import MAX_MESSAGE_VALUES, MAX_RESULTS_BYTES
from wil_campaign.orchestrator.campaign.folder.manifest import file_digest
from wil_campaign.orchestrator.reading import trajectory_file
from wil_campaign.orchestrator.reading.results_folder import (
    UnreadableError,
    read_campaign_documents,
    read_limited_data,
)
from wil_campaign.orchestrator.reading.trajectory_file import read_trajectory
from wil_campaign.orchestrator.report.reading.event_log import MOST_EVENTS, read_event_log
from wil_campaign.orchestrator.run_results.result_reader import (
    ResultError,
    read_result,
    read_summary,
)

MANY = b'{"x": [' + b"{}," * (MAX_MESSAGE_VALUES // 2) + b"{}]}"


@pytest.mark.parametrize("read", [read_result, read_summary])
def test_a_result_of_many_values_or_bytes_is_refused(
    tmp_path: Path, read: Callable[[Path], object]
) -> None:
    path = tmp_path / "result.json"
    path.write_bytes(MANY)
    with pytest.raises(ResultError, match=r"it has \d+ values; at most 5000000 are read"):
        read(path)
    with path.open("ab") as stream:
        stream.truncate(MAX_RESULTS_BYTES + 1)  # takes no room on the disk
    with pytest.raises(ResultError, match="it is larger than 256,000,000 bytes"):
        read(path)


def test_documents_of_a_folder_are_refused_by_name(tmp_path: Path) -> None:
    folder = write_campaign(tmp_path / "campaign")
    (folder / "summary.json").write_bytes(MANY)
    problems = read_campaign_documents(folder).problems
    assert any(
        "summary.json" in problem and "at most 5000000 are read" in problem for problem in problems
    )
    with (folder / "summary.json").open("ab") as stream:
        stream.truncate(MAX_RESULTS_BYTES + 1)
    with pytest.raises(UnreadableError, match="larger than"):
        read_limited_data(folder / "summary.json")


def test_json_that_is_nested_too_deep_is_a_value_error(tmp_path: Path) -> None:
    deep = b"[" * 100_000
    with pytest.raises(ValueError, match="it is nested too deep"):
        loads_limited_json(deep)
    (tmp_path / "a.json").write_bytes(deep)
    with pytest.raises(ValueError, match="it is nested too deep"):
        read_limited_json(tmp_path / "a.json")


def test_a_long_log_keeps_its_first_events_and_every_stage(tmp_path: Path) -> None:
    lines = [json.dumps({"t_s": k, "event": "note", "text": "x" * 100}) for k in range(50_000)]
    lines.append(json.dumps({"t_s": 9.0, "event": "stage", "stage": "end"}))
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(lines))
    tracemalloc.start()
    log = read_event_log(path)
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (len(log.events), log.left_out) == (MOST_EVENTS + 1, 50_000 - MOST_EVENTS)
    assert log.stages == (("end", 9.0),)
    assert most_bytes < 2 * path.stat().st_size


def test_the_first_rows_of_a_long_trajectory_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trajectory.csv"
    rows = [f"{k},twin,goal,{k}" for k in range(7)]
    path.write_text("\n".join(["t_s,vehicle,stage,est_north_m", *rows, ""]))
    assert len(read_trajectory(path).rows) == 7
    monkeypatch.setattr(trajectory_file, "MAX_TRAJECTORY_ROWS", 5)
    found = read_trajectory(path)
    assert [row.t_s for row in found.rows] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert found.problems == ("trajectory.csv: only its first 5 rows are read",)


def test_a_file_is_digested_in_pieces(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)
    tracemalloc.start()
    assert len(file_digest(path)) == len("sha256:") + 64
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 10_000_000


def test_a_row_of_a_long_flight_takes_little_more_than_its_text(tmp_path: Path) -> None:
    """Each cell was a text of its own: of three hours 1.4 GB, of which the page shows a few."""
    cells = ",".join(["0.0025"] * 24)
    lines = "".join(f'{n / 20.0},real,goal,{cells},"ahead, left"\n' for n in range(4000))
    names = ",".join(["t_s", "vehicle", "stage", *(f"c{n}" for n in range(24)), "note"])
    path = tmp_path / "trajectory.csv"
    path.write_text(f"{names}\n{lines}")
    tracemalloc.start()
    try:
        found = read_trajectory(path)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 3 * path.stat().st_size
    assert (len(found.rows), found.rows[-1].t_s) == (4000, 199.95)
    assert (found.rows[-1].note, found.rows[-1].decoded().stage) == ("ahead, left", "goal")
