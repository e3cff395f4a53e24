"""Controls flown as users fly them: each kind ends as it must, and one that passes refuses all."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.orchestrator.cli import main

pytestmark = pytest.mark.usefixtures("forked_workers")
EACH_KIND = """\
  positions-stop:
    set: {faults.twin.pose_source: {stop: {on: goal, after_s: 0.5}}}
    expect: {verdict: INVALID, cause: pose of twin from mavlink}
  positions-freeze:
    set: {faults.twin.pose_source: {freeze: {on: goal, after_s: 0.5}}}
    expect: {verdict: INVALID, cause: pose of twin from mavlink}
  obstacle:
    set: {world.objects: {wall: {shape: {box: {size_m: [1, 1, 0.1]}}, pose: {up_m: 0.9}}}}
    expect: {oracle: collision_always}
"""
OTHER = """\
  other-autonomy:
    set: {autonomy.with.ticks: 200}
    expect: {oracle: time_limit}
"""
LAME = """\
  lame:
    set: {autonomy.with.ticks: 41}
    expect: {oracle: time_limit}
"""
REST = """\
oracles: {landed: {}, time_limit: {limit_s: 5}}
autonomy: {use: still.py:Still, with: {ticks: 40}}
"""


def fly(folder: Path, controls: str) -> tuple[int, dict[str, Any]]:
    path = write_hover(folder)
    old = ("repetitions: 2\n", "oracles: {landed: {}}\n", "autonomy: still.py:Still\n")
    text = path.read_text()
    for line in old:
        assert text.count(line) == 1
        text = text.replace(line, "")
    path.write_text(f"{text}repetitions: 1\ncontrols:\n{controls}{REST}")
    code = main(["run", str(path), "--out", str(folder / "out"), "--jobs", "1"])
    (summary,) = (folder / "out").rglob("summary.json")
    document: dict[str, Any] = json.loads(summary.read_text("utf-8"))
    return code, document


def test_controls_of_each_kind_end_as_expected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, summary = fly(tmp_path, EACH_KIND + OTHER)
    controls = {run["case"]: run for run in summary["controls"]}
    assert {name: run["control"]["met"] for name, run in controls.items()} == {
        "positions-stop": True,
        "positions-freeze": True,
        "obstacle": True,
        "other-autonomy": True,
    }, {name: (run["verdict"], run["reason"]) for name, run in controls.items()}
    assert "no sample" in controls["positions-stop"]["reason"]
    assert "repeats one position" in controls["positions-freeze"]["reason"]
    assert controls["obstacle"]["reason"].startswith("twin touched wall")
    assert (code, summary["accepted"]) == (0, True)
    log = next((tmp_path / "out").glob("hover/*/positions-stop/sim/1/log.jsonl")).read_text()
    assert "begun: the pose source of twin stops 0.5 s after stage goal" in log
    assert "fault injected" not in capsys.readouterr().out, "the runs that count have none"


def test_a_campaign_whose_control_passes_is_not_accepted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, summary = fly(tmp_path, OTHER + LAME)
    assert (code, summary["accepted"]) == (1, False)
    assert [run["verdict"] for run in summary["runs"]] == ["PASS"]
    lines = capsys.readouterr().out.splitlines()
    (said,) = (line for line in lines if "this campaign cannot fail" in line)
    assert said.startswith(
        "not accepted; this campaign cannot fail: control lame in mode sim passed"
    )


def test_a_shipped_control_ends_as_expected(flown_gate: Path) -> None:
    summary = json.loads((flown_gate / "summary.json").read_text("utf-8"))
    (blind,) = summary["controls"]
    assert (blind["case"], blind["verdict"], blind["decided_by"]) == (
        "blind",
        "FAIL",
        "reached/twin",
    )
    assert blind["control"]["met"]
    assert [run["verdict"] for run in summary["runs"]] == ["PASS"]
    assert summary["accepted"]
