"""Recorded runs judged again: the same by the same oracles, and by others what these say."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.conftest import FEW_PICTURES, GATE_FLOWN, ROOT
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, RunPlan, load_campaign
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.campaign.reevaluation import judge_run_again
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.reading.trajectory_file import read_trajectory
from wil_campaign.orchestrator.recording.errors import RecordingError
from wil_campaign.orchestrator.run_results.attempts import after_attempts
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.orchestrator.run_results.run_result import EarlierAttempt, RunResult
from wil_campaign.safety.model.oracle_results import Verdict

Fly = Callable[..., tuple[RunResult, Path]]
GATE = ROOT / "campaigns" / "gate.yaml"
EVERYTHING = (
    "oracles.clearance={min_m: 0.05}",
    "oracles.speed={max_m_s: 3}",
    "oracles.attitude={max_tilt_deg: 30, required: false}",
    "oracles.modes={allowed: [guided]}",
    "oracles.battery={min_percent: 10}",
    "oracles.estimator={max_unsound_s: 0.1}",
    "oracles.twin_divergence={max_m: 2}",
    "oracles.near={use: distance, object: gate, max_m: 6}",
    "oracles.clear={stl: 'always[0,30] (clearance_m >= 0.05 and silence_s < 1)'}",
    "oracles.calm={stl: 'always (tilt_deg < 30) and eventually (twin_distance_m < 1)'}",
)


def plan_of(sets: tuple[str, ...]) -> RunPlan:
    options = ExpansionOptions(cases=("large",), modes=("wil",), sets=sets)
    return load_campaign(GATE, options).runs[0]


@pytest.mark.parametrize(
    ("sets", "verdict"),
    [
        (EVERYTHING, "PASS"),
        (("oracles.altitude={max_m: 0.6, fail_fast: true}",), "FAIL"),
        (("geofence.box.north_m=[-0.8, 3.2]",), "FAIL"),
    ],
)
def test_a_recorded_run_is_judged_as_it_was_flown(
    fly_run: Fly, sets: tuple[str, ...], verdict: str
) -> None:
    sets = (*FEW_PICTURES, *sets)
    result, folder = fly_run(sets=sets)
    assert result.verdict == verdict
    write_atomically(folder / "result.json", to_json(result))
    rejudged = judge_run_again(plan_of(sets), folder)
    for oracle, other in zip(rejudged.now.oracles, result.oracles, strict=True):
        assert oracle == other
    # Whether it is required goes by the campaign, which the fixture has narrowed alike.
    assert rejudged.now == result
    assert rejudged.before == result


@pytest.fixture
def recorded(flown_gate: Path) -> Path:
    """Return the results folder of one good run in mode sim, and a control, flown as users fly."""
    return flown_gate


def judge(folder: Path, *sets: str, repetitions: int = 1, json: bool = False) -> int:
    options = [option for value in sets for option in ("--set", value)]
    options += ["--repetitions", str(repetitions), *(["--json"] if json else [])]
    return main(["judge", str(GATE), str(folder), *GATE_FLOWN, *options])


def test_another_limit_is_tried_without_a_flight(recorded: Path, capsys: Any) -> None:
    before = sorted((path, path.read_bytes()) for path in recorded.rglob("*") if path.is_file())
    assert judge(recorded) == 0
    assert "large/sim/1  PASS   PASS" in capsys.readouterr().out
    assert judge(recorded, "oracles.altitude.max_m=1.0") == 1
    said = capsys.readouterr().out
    assert "large/sim/1  PASS   FAIL  twin is at a height of 1.0" in said
    assert "altitude of twin in large/sim/1: FAIL (was PASS)" in said
    assert judge(recorded, "oracles.slow={use: speed, max_m_s: 0.1}") == 1
    assert "slow of twin in large/sim/1: FAIL (was not judged)" in capsys.readouterr().out
    after = sorted((path, path.read_bytes()) for path in recorded.rglob("*") if path.is_file())
    assert after == before


THEIRS = """\
from pathlib import Path

Path({marker!r}).write_text("ran")


class Mine:
    def __init__(self, **_): ...
    def perceive(self, reading): ...
    def act(self, state): ...


def take(work, other):
    return work
"""


def test_no_code_that_the_files_name_is_run(recorded: Path, tmp_path: Path, capsys: Any) -> None:
    marker = tmp_path / "ran"
    (tmp_path / "theirs.py").write_text(THEIRS.format(marker=str(marker)))
    recipe = (ROOT / "recipes" / "gate.yaml").read_text()
    own = "filter: [{use: theirs.py:take}, "
    assert "filter: [" in recipe
    (tmp_path / "recipe.yaml").write_text(recipe.replace("filter: [", own))
    sets = (f"autonomy={{use: {tmp_path}/theirs.py:Mine}}", f"recipe={tmp_path}/recipe.yaml")
    assert judge(recorded, *sets) == 0
    assert "large/sim/1  PASS   PASS" in capsys.readouterr().out
    assert not marker.exists()
    # The same files do run where a person flies them.
    given = [option for value in sets for option in ("--set", value)]
    assert main(["plan", str(GATE), *given]) == 0
    assert marker.exists()


def test_judge_reports_runs_never_flown_and_a_folder_without_recordings(
    recorded: Path, tmp_path: Path, capsys: Any
) -> None:
    assert judge(recorded, repetitions=4) == 3
    lines = capsys.readouterr().out.splitlines()
    assert "never flown: large/sim/2, large/sim/3, large/sim/4" in lines
    assert any(line.endswith("large/sim is 1/1 (needs 4/4)") for line in lines)
    assert lines[-1].startswith("not accepted; never flown: 3 of 5; required but")
    assert any("left out: large/wil" in line for line in lines)
    assert judge(tmp_path) == 3
    assert "has no run of this campaign, such as large/sim/1" in capsys.readouterr().err


def test_judge_leaves_out_no_repetition_that_was_flown(
    recorded: Path, tmp_path: Path, capsys: Any
) -> None:
    """The file says fewer than --repetitions of the flight said."""
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    shutil.copytree(folder / "large/sim/1", folder / "large/sim/2")
    document = json.loads((folder / "campaign.json").read_text())
    second = next(run for run in document["runs"] if run["run"] == "large/sim/1")
    document["runs"] += [{**second, "run": name} for name in ("large/sim/2", "large/sim/x")]
    (folder / "campaign.json").write_text(json.dumps(document))
    assert judge(folder) == 3
    said = "has 1 runs that would not be judged, such as large/sim/2: give --repetitions 2"
    assert said in capsys.readouterr().err
    assert judge(folder, repetitions=2) == 3
    assert "large/sim/2/result.json is of another run" in capsys.readouterr().err


DAMAGE: tuple[tuple[str, Callable[[bytes], bytes], str], ...] = (
    ("result.json", lambda data: data[:-20], "is truncated, damaged or of another version"),
    ("result.json", lambda data: data.replace(b'"PASS"', b'"FINE"'), "verdict"),
    ("result.json", lambda data: data.replace(b"\n", b" \n"), "was edited"),
    ("judged.msgpack", lambda data: data[:-30], "was cut before the end of the run"),
    ("judged.msgpack", lambda _: b"", "does not begin with wil/judged/2"),
    ("log.jsonl", lambda data: data[:-3], "log.jsonl cannot be read"),
    ("log.jsonl", lambda data: b"\n".join(data.splitlines()[:5]), "cut before the end"),
    (
        "log.jsonl",
        lambda data: data + b"[" * 100_000,
        "log.jsonl cannot be read: it is nested too deep",
    ),
)


def test_a_damaged_recording_is_refused(recorded: Path, tmp_path: Path) -> None:
    plan = replace(plan_of(()), case="large", mode="sim")
    shutil.copytree(recorded / "large" / "sim" / "1", tmp_path, dirs_exist_ok=True)
    judge_run_again(plan, tmp_path)
    _forget_own_files(tmp_path)
    for name, change, said in DAMAGE:
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(change(whole))
        with pytest.raises(RecordingError, match=said):
            judge_run_again(plan, tmp_path)
        (tmp_path / name).write_bytes(whole)


@pytest.mark.parametrize("name", ["judged.msgpack", "log.jsonl", "trajectory.csv"])
def test_a_whole_file_of_another_flight_is_refused(
    recorded: Path, tmp_path: Path, name: str
) -> None:
    plan = replace(plan_of(()), case="large", mode="sim")
    shutil.copytree(recorded / "large" / "sim" / "1", tmp_path, dirs_exist_ok=True)
    (control,) = (path for path in recorded.glob(f"*/sim/1/{name}") if "large" not in path.parts)
    shutil.copy(control, tmp_path / name)
    with pytest.raises(RecordingError, match=f"{name} is not that of this flight"):
        judge_run_again(plan, tmp_path)
    _forget_own_files(tmp_path)
    judge_run_again(plan, tmp_path)


def _forget_own_files(folder: Path) -> None:
    """Make a run's result one of an earlier version, which does not say which files are its own."""
    earlier = json.loads((folder / "result.json").read_text())
    del earlier["evidence_files"]
    (folder / "result.json").write_text(to_json(earlier))


@pytest.mark.parametrize("name", ["judged.msgpack", "log.jsonl", "trajectory.csv"])
def test_a_flipped_byte_or_a_cut_says_what_to_do(recorded: Path, tmp_path: Path, name: str) -> None:
    plan = replace(plan_of(()), case="large", mode="sim")
    shutil.copytree(recorded / "large" / "sim" / "1", tmp_path, dirs_exist_ok=True)
    path = tmp_path / name
    whole = path.read_bytes()
    places = [len(whole) * k // 9 for k in range(9)]
    flipped = [
        whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :] for at in places if at
    ]
    for content in (*flipped, *(whole[:at] for at in places), whole + whole, bytes(100)):
        path.write_bytes(content)
        with pytest.raises(RecordingError) as refused:
            judge_run_again(plan, tmp_path)
        said = str(refused.value)
        assert f"{name} is not that of this flight" in said
        assert said.endswith("; restore the file, or fly the campaign again")


@pytest.mark.parametrize("name", ["judged.msgpack", "log.jsonl", "result.json"])
@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, None])
@pytest.mark.parametrize("is_earlier", [False, True])
def test_what_is_no_file_is_not_waited_for(
    recorded: Path, tmp_path: Path, name: str, make: Callable[[Path], None] | None, is_earlier: bool
) -> None:
    plan = replace(plan_of(()), case="large", mode="sim")
    shutil.copytree(recorded / "large" / "sim" / "1", tmp_path, dirs_exist_ok=True)
    if is_earlier:
        _forget_own_files(tmp_path)
    (tmp_path / name).unlink()
    if make is not None:
        make(tmp_path / name)
    with pytest.raises(RecordingError, match="; restore the file, or fly the campaign again"):
        judge_run_again(plan, tmp_path)


def test_a_run_whose_log_lacks_what_decided_it_is_refused(recorded: Path, tmp_path: Path) -> None:
    for path in (recorded / "large" / "sim" / "1").iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    flown = read_result(tmp_path / "result.json")
    invalid = replace(flown, verdict="INVALID", reason="late frames", decided_by="mixing/camera")
    write_atomically(tmp_path / "result.json", to_json(invalid))
    with pytest.raises(RecordingError, match="lacks what decided the run: late frames"):
        judge_run_again(replace(plan_of(()), case="large", mode="sim"), tmp_path)


def log_also(folder: Path, *lines: dict[str, Any]) -> None:
    """Put lines before the end into the log of a run."""
    log = folder / "log.jsonl"
    first, *rest = log.read_text().splitlines()
    log.write_text("\n".join([first, *(json.dumps(line) for line in lines), *rest]) + "\n")


@pytest.mark.parametrize("with_flag", [False, True])
def test_an_event_of_another_part_stays_whatever_the_oracles_are_named(
    recorded: Path, tmp_path: Path, with_flag: bool
) -> None:
    """It was INVALID by sync/twin, or FAILed by the flag of an oracle `sync` of its file."""
    shutil.copytree(recorded / "large" / "sim" / "1", tmp_path, dirs_exist_ok=True)
    flown = read_result(tmp_path / "result.json")
    one = replace(flown.oracles[0], name="sync", vehicle="twin")
    kind: Verdict = "FAIL" if with_flag else "INVALID"
    said = "twin is 9 m high" if with_flag else "they were 2 m apart"
    decided = replace(
        flown,
        verdict=kind,
        reason=said,
        decided_by="sync/twin",
        oracles=(*flown.oracles, one),
        evidence_files={},  # of an earlier version: the log is changed below
    )
    write_atomically(tmp_path / "result.json", to_json(decided))
    event = {"t_s": 5.0, "event": "decisive", "kind": kind, "reason": said, "source": "sync/twin"}
    flag = {"t_s": 5.0, "event": "flag", "oracle": "sync", "vehicle": "twin", "text": said}
    log_also(tmp_path, *([flag, event] if with_flag else [event]))
    now = judge_run_again(replace(plan_of(()), case="large", mode="sim"), tmp_path).now
    expected = ("PASS", "", "") if with_flag else ("INVALID", said, "sync/twin")
    assert (now.verdict, now.reason, now.decided_by) == expected


def test_a_reason_quotes_the_note_of_the_moment_that_decided(fly_run: Fly) -> None:
    def near(north_m: float) -> tuple[str]:
        return (f"oracles.near={{stl: 'always (north_m < {north_m})'}}",)

    flown, folder = fly_run(sets=near(1.0))
    write_atomically(folder / "result.json", to_json(flown))
    rows = [row for row in read_trajectory(folder / "trajectory.csv").rows if row.vehicle == "real"]
    for result in (flown, judge_run_again(plan_of(near(0.9)), folder).now):
        oracle = next(each for each in result.oracles if each.name == "near")
        assert (result.verdict, result.decided_by) == ("FAIL", "near/real")
        assert oracle.at_s is not None
        until = [row.note for row in rows if row.t_s <= oracle.at_s]
        assert until[-1] == result.note != rows[-1].note
        assert result.reason.endswith(f"the autonomy's last note was '{result.note}'")
    # Before the goal the autonomy has not begun, whatever its first note was.
    early = {"t_s": -1.0, "event": "decisive", "kind": "FAIL", "reason": "no", "source": "guard"}
    log_also(folder, early)
    assert judge_run_again(plan_of(()), folder).now.reason == (
        "no; the autonomy had not begun to fly"
    )


def test_a_flight_proves_nothing_of_a_world_that_it_was_not_flown_in(
    recorded: Path, capsys: Any
) -> None:
    assert judge(recorded, "world.objects.gate.pose.north_m=2.9") == 3
    said = capsys.readouterr().err
    assert "large/sim/1 was flown in another world than its files describe now" in said


@pytest.mark.parametrize(
    "content",
    [
        *(None, "{", "[]", "{}", '{"runs": null}', '{"runs": 5}', '{"runs": [{"run": ["a"]}]}'),
        '{"runs": [{"run": "large/sim/1"}]}',
    ],
)
def test_a_run_without_a_record_of_its_world_is_refused(
    recorded: Path, tmp_path: Path, capsys: Any, content: str | None
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    if content is None:
        (folder / "campaign.json").unlink()
    else:
        (folder / "campaign.json").write_text(content)
    _assert_world_is_unknown(folder, capsys)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("files", None), ("files", [None]), ("versions", 5), ("document", None)),
        *(("runs", None), ("options", []), ("options", {"set": [5]}), ("options", {"set": None})),
    ],
)
def test_a_campaign_json_with_values_of_another_kind_is_refused(
    recorded: Path, tmp_path: Path, capsys: Any, key: str, value: Any
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    document = json.loads((folder / "campaign.json").read_text())
    (folder / "campaign.json").write_text(json.dumps({**document, key: value}))
    _assert_world_is_unknown(folder, capsys)


def _assert_world_is_unknown(folder: Path, capsys: Any) -> None:
    assert judge(folder) == 3
    assert judge(folder, "world.objects.gate.pose.north_m=2.9") == 3
    said = capsys.readouterr().err
    assert "campaign.json is missing, damaged, or does not say in which world large/sim/1" in said
    assert said.count("restore that file, or fly the campaign again") == 2


def test_a_judgement_by_other_options_says_so(recorded: Path, capsys: Any) -> None:
    assert judge(recorded) == 0
    assert "than flown" not in capsys.readouterr().out
    body = "vehicles.twin.body={width_m: 0.2, height_m: 0.1}"
    assert judge(recorded, body, "recipe.combine.0.min_rate_hz=9") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("accepted")
    said = (
        'vehicles.twin.body was null, now it is {"width_m": 0.2, "height_m": 0.1}',
        "--set recipe.combine.0.min_rate_hz=9 was not given",
    )
    assert f"judged by other options or files than flown: {', '.join(said)}" in lines
    assert "judged by other options or files than flown" in lines[-1]
    assert judge(recorded, body, json=True) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["changed_since_flight"] == [said[0]]
    assert document["accepted"]
    assert [run["verdict"] for run in document["runs"]] == ["PASS"]


def test_a_required_run_that_is_not_there_is_forgiven_by_no_share(
    recorded: Path, capsys: Any
) -> None:
    """The share 1/5 is that of flights that may FAIL, which these did not."""
    share = "accept={large: {sim: 1/5}}"
    assert judge(recorded, share) == 0
    capsys.readouterr()
    assert judge(recorded, share, repetitions=5) == 3
    lines = capsys.readouterr().out.splitlines()
    assert "never flown: large/sim/2, large/sim/3, large/sim/4, large/sim/5" in lines
    assert lines[-1].startswith("not accepted; never flown: 4 of 6")


def test_a_run_that_was_begun_and_lost_leaves_the_others_to_be_judged(
    recorded: Path, tmp_path: Path, capsys: Any
) -> None:
    folder = shutil.copytree(recorded, tmp_path / "cut")
    (folder / "large" / "sim" / "2").mkdir()
    assert judge(folder, repetitions=2) == 3
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("large/sim/1") for line in lines)
    assert "never flown: large/sim/2" in lines
    assert "begun and lost, without a result: large/sim/2" in lines
    assert lines[-1].startswith("not accepted; never flown")


def test_a_run_that_a_sequential_test_does_not_count_is_named(
    recorded: Path, tmp_path: Path, capsys: Any
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    shutil.copytree(folder / "large/sim/1", folder / "large/sim/2")
    second = folder / "large/sim/2/result.json"
    write_atomically(second, to_json(replace(read_result(second), rep=2)))
    document = json.loads((folder / "campaign.json").read_text())
    (first,) = (run for run in document["runs"] if run["run"] == "large/sim/1")
    document["runs"].append({**first, "run": "large/sim/2"})
    (folder / "campaign.json").write_text(json.dumps(document))
    test = "repetitions={until: decided, at_least: 0.6, against: 0.1, error: 0.2, most: 2}"
    sets = ("--set", test, "--set", "accept={large: {sim: decided}}")
    assert main(["judge", str(GATE), str(folder), *GATE_FLOWN, *sets]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "not counted, flown after the decision: large/sim/2" in lines


@pytest.mark.parametrize(
    "ended",
    [
        ({"stopped": "signal"}, 130, "stopped by Ctrl-C or SIGTERM"),
        ({"stopped": "command"}, 4, "stopped by an operator's command"),
        ({"broken": True}, 3, "an internal exception occurred outside of its runs"),
        ({"broken": None}, 3, "summary.json does not record the end of the campaign"),
        (None, 3, "it still flies, was cut off, or was flown by an earlier version"),
    ],
)
def test_judge_counts_the_end_of_a_campaign_outside_of_its_runs(
    recorded: Path, tmp_path: Path, capsys: Any, ended: tuple[dict[str, Any] | None, int, str]
) -> None:
    fields, code, said = ended
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    document = json.loads((folder / "summary.json").read_text())
    assert (document["stopped"], document["broken"], document["accepted"]) == (None, False, True)
    if fields is None:
        del document["stopped"], document["broken"]
    else:
        document |= fields
    (folder / "summary.json").write_text(json.dumps(document))
    assert judge(folder) == code
    printed = capsys.readouterr().out
    assert printed.splitlines()[-1].startswith("not accepted;")
    assert said in printed
    assert judge(folder, json=True) == code
    assert json.loads(capsys.readouterr().out)["accepted"] is False


@pytest.mark.parametrize("content", [None, "{", "{}"])
def test_a_folder_without_its_summary_is_refused(
    recorded: Path, tmp_path: Path, capsys: Any, content: str | None
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    if content is None:
        (folder / "summary.json").unlink()
    else:
        (folder / "summary.json").write_text(content)
    assert judge(folder) == 3
    outcome = capsys.readouterr()
    assert outcome.out == ""
    assert "summary.json" in outcome.err
    assert "without this file it is unknown how the campaign ended" in outcome.err


@pytest.mark.parametrize(
    "change", [{"verdict": "FAIL"}, {"duration_s": 1.0}, None], ids=["verdict", "figure", "gone"]
)
def test_a_summary_of_other_flights_is_refused(
    recorded: Path, tmp_path: Path, capsys: Any, change: dict[str, Any] | None
) -> None:
    """What it says of the end, and of who flew as the real vehicle, is not of these flights."""
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    document = json.loads((folder / "summary.json").read_text())
    document["runs"] = [] if change is None else [run | change for run in document["runs"]]
    (folder / "summary.json").write_text(json.dumps(document))
    assert judge(folder) == 3
    assert "summary.json is not of the flight of large/sim/1" in capsys.readouterr().err


def test_a_pass_at_a_second_attempt_keeps_its_reason(
    recorded: Path, tmp_path: Path, capsys: Any
) -> None:
    """The summary of a job had "PASS: " and nothing behind it."""
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    result, summary = folder / "large/sim/1/result.json", folder / "summary.json"
    before = EarlierAttempt("INVALID", "no pose", "earlier/large/sim/1-1")
    flown = after_attempts(read_result(result), (before,))
    result.write_text(to_json(flown))
    document = json.loads(summary.read_text())
    document["runs"] = [json.loads(to_json(flown))]
    summary.write_text(json.dumps(document))
    assert judge(folder) == 0
    assert "passed at attempt 2; before: INVALID (no pose)" in capsys.readouterr().out


def test_a_control_is_judged_again_as_a_control(recorded: Path, capsys: Any) -> None:
    assert judge(recorded) == 0
    assert "blind/sim/1  FAIL   FAIL" in capsys.readouterr().out
    assert judge(recorded, "oracles.reached.required=false") == 2, "it could not fail"


def test_a_record_of_documents_that_is_damaged_is_none(
    recorded: Path, tmp_path: Path, capsys: Any
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(recorded, folder)
    manifest = json.loads((folder / "campaign.json").read_bytes())
    for run in manifest["runs"]:
        run["documents"] = ["x"]
    (folder / "campaign.json").write_text(json.dumps(manifest))
    assert judge(folder) == 0
    assert "the files of large/sim/1 changed" in capsys.readouterr().out
