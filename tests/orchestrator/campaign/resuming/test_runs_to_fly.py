"""Campaigns that were cut off and are taken up: nothing twice, nothing lost, nothing mixed."""

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.orchestrator.hover import write_hover
from wil_campaign.campaigns.expansion.expansion import (
    Campaign,
    ExpansionOptions,
    RunPlan,
    load_campaign,
)
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator import installation
from wil_campaign.orchestrator.campaign.campaign_runner import fly_campaign
from wil_campaign.orchestrator.campaign.flight_options import ClearedCampaign, FlightOptions
from wil_campaign.orchestrator.campaign.folder.campaign_folder import (
    OutputError,
    locked_campaign_folder,
    locked_run_folder,
    newest_campaign_folder,
    set_run_folder_aside,
)
from wil_campaign.orchestrator.campaign.resuming import runs_to_fly
from wil_campaign.orchestrator.campaign.resuming.runs_to_fly import (
    ResumeRules,
    resume_campaign,
)
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import (
    ResumeError,
    resumed_folder,
)
from wil_campaign.orchestrator.campaign.workers import run_engine
from wil_campaign.orchestrator.campaign.workers.run_order import fly_order
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.cli.progress_display import SilentDisplay
from wil_campaign.orchestrator.operator.run_messages import OperatorInbox, Report
from wil_campaign.orchestrator.run_results.attempts import after_attempts
from wil_campaign.orchestrator.run_results.campaign_results import summarize
from wil_campaign.orchestrator.run_results.run_result import (
    EarlierAttempt,
    LaterEvent,
    RunResult,
    SyncResult,
)
from wil_campaign.orchestrator.state.run_setup import RunOrder
from wil_campaign.safety.model.oracle_results import Verdict

ROOT = Path(__file__).parents[4]
pytestmark = pytest.mark.usefixtures("forked_workers")


def result_of(plan: RunPlan, verdict: Verdict = "PASS", reason: str = "") -> RunResult:
    return RunResult(
        case=plan.case,
        mode=plan.mode,
        rep=plan.repetition,
        seed=plan.seed,
        verdict=verdict,
        reason=reason,
        also=(),
        required=plan.required,
        duration_s=1.0,
        wall_s=1.0,
        oracles=(),
        sync=SyncResult(),
        mixing=None,
    )


def quick_fly(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Stand in for a flight: as its campaign's description says; lives in the worker process.

    A verdict is that of the first attempt alone; "die" at every attempt is a lost process.
    """
    said = order.plan.files.campaign.get(("description",))
    if said == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    order.folder.mkdir(parents=True, exist_ok=True)
    first: Any = said if said and not order.attempts else "PASS"
    flown = result_of(order.plan, first, "" if first == "PASS" else "bad luck")
    result = after_attempts(flown, order.attempts)
    write_atomically(order.folder / "result.json", to_json(result))
    return result


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    return write_hover(tmp_path)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)


def run(campaign: Path, *options: str) -> int:
    out = str(campaign.parent / "out")
    jobs = () if "--jobs" in options else ("--jobs", "1")
    return main(["run", str(campaign), "--out", out, *jobs, *options])


def folder_of(campaign: Path) -> Path:
    (folder,) = (campaign.parent / "out" / "hover").iterdir()
    return folder


def summary_of(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return document


def resume(
    folder: Path, campaign: Campaign, *, retries: int = 0, may_repeat: bool = True
) -> tuple[runs_to_fly.ResumedCampaign, list[str]]:
    said: list[str] = []
    rules = ResumeRules(is_real=lambda _: not may_repeat)
    runs = tuple(replace(plan, retries=retries) for plan in campaign.runs)
    found = resume_campaign(replace(campaign, runs=runs), folder, rules, say=said.append)
    return found, said


def write_result(folder: Path, plan: RunPlan, verdict: Verdict, reason: str = "") -> None:
    home = folder / plan.name
    home.mkdir(parents=True)
    write_atomically(home / "result.json", to_json(result_of(plan, verdict, reason)))


@pytest.mark.parametrize("verdict", ["PASS", "FAIL", "INVALID", "ERROR"])
def test_a_resumption_keeps_finished_runs(campaign: Path, tmp_path: Path, verdict: Verdict) -> None:
    loaded = load_campaign(campaign)
    write_result(tmp_path, loaded.runs[0], verdict, "why")
    found, said = resume(tmp_path, loaded)
    assert set(found.results) == {"default/sim/1"}
    assert found.attempts == {"default/sim/2": ()}
    assert said == []


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "it has no result"),
        ("", "is truncated, damaged or of another version"),
        ("half", "is truncated, damaged or of another version"),
        ("other", "belongs to another run"),
    ],
)
def test_half_a_run_is_set_aside_and_reported(
    campaign: Path, tmp_path: Path, content: str | None, said: str
) -> None:
    loaded = load_campaign(campaign)
    plan = loaded.runs[1]
    home = tmp_path / plan.name
    home.mkdir(parents=True)
    (home / "log.jsonl").write_text("{}\n")
    text = to_json(result_of(replace(plan, seed=3)))
    written = {"": "", "half": text[:100], "other": text}
    if content is not None:
        (home / "result.json").write_text(written[content])
    found, told = resume(tmp_path, loaded)
    assert found.results == {}
    (attempt,) = found.attempts[plan.name]
    assert (attempt.verdict, attempt.folder) == (None, "earlier/default/sim/2-1")
    assert said in attempt.reason
    assert told == [f"default/sim/2: cut off, {attempt.reason}; kept in {attempt.folder}"]
    assert not home.exists()
    assert (tmp_path / attempt.folder / "log.jsonl").exists()
    again, _ = resume(tmp_path, loaded)
    assert [one.folder for one in again.attempts[plan.name]] == [attempt.folder]


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("is_replaced", [True, False])
def test_a_fail_that_was_replaced_or_removed_is_not_resumed(
    campaign: Path, is_replaced: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign.write_text(
        campaign.read_text().replace("campaign: hover", "campaign: hover\ndescription: FAIL")
    )
    assert run(campaign) == 1
    folder = folder_of(campaign)
    plan = load_campaign(campaign).runs[0]
    shutil.rmtree(folder / plan.name)
    if is_replaced:  # as of another campaign of the same seed
        write_result(folder, plan, "PASS")
    assert run(campaign, "--resume") == 2
    told = capsys.readouterr().err
    assert "default/sim/1/result.json is not the result that summary.json has (FAIL)" in told
    assert summary_of(folder)["accepted"] is False


def test_a_fail_that_was_set_aside_before_its_summary_is_resumed(
    campaign: Path, tmp_path: Path
) -> None:
    loaded = load_campaign(campaign)
    plan = loaded.runs[0]
    write_result(tmp_path, plan, "FAIL", "why")
    summary = summarize(
        [result_of(plan, "FAIL", "why")],
        loaded.requirements,
        campaign="hover",
        clock="virtual",
        surrogate=False,
        real_kind="embedded",
        sensors={},
    )
    (tmp_path / "summary.json").write_text(to_json(summary))
    set_run_folder_aside(tmp_path, plan.name)
    assert plan.name in resume(tmp_path, loaded)[0].attempts


def test_a_folder_in_which_nothing_was_flown_is_no_attempt(campaign: Path, tmp_path: Path) -> None:
    loaded = load_campaign(campaign)
    (tmp_path / loaded.runs[0].name).mkdir(parents=True)
    assert resume(tmp_path, loaded)[0].attempts["default/sim/1"] == ()


@pytest.mark.parametrize(
    ("verdict", "retries", "may_repeat", "kept"),
    [
        ("ABORTED", 0, True, False),
        ("ABORTED", 0, False, True),
        ("ERROR", 0, True, True),
        ("ERROR", 1, True, False),
        ("ERROR", 1, False, True),
        ("INVALID", 1, True, False),
        ("FAIL", 9, True, True),
    ],
)
def test_a_resumption_flies_a_run_again_by_verdict_and_retries(
    campaign: Path,
    tmp_path: Path,
    *,
    verdict: Verdict,
    retries: int,
    may_repeat: bool,
    kept: bool,
) -> None:
    loaded = load_campaign(campaign)
    plan = loaded.runs[0]
    write_result(tmp_path, plan, verdict, "why")
    found, _ = resume(tmp_path, loaded, retries=retries, may_repeat=may_repeat)
    assert (plan.name in found.results) is kept
    if not kept:
        place = "earlier/default/sim/1-1"
        assert found.attempts[plan.name] == (EarlierAttempt(verdict, "why", place),)


@pytest.mark.parametrize(
    ("repeats_cut_off", "is_real", "kept"),
    [(True, False, False), (True, True, True), (False, False, True)],
)
@pytest.mark.parametrize("verdict", ["FAIL", "ERROR"])
def test_a_search_repeats_runs_cut_off_after_their_verdict_but_no_real_ones(
    campaign: Path,
    tmp_path: Path,
    verdict: Verdict,
    *,
    repeats_cut_off: bool,
    is_real: bool,
    kept: bool,
) -> None:
    loaded = load_campaign(campaign)
    plan = loaded.runs[0]
    home = tmp_path / plan.name
    home.mkdir(parents=True)
    aborted = LaterEvent("ABORTED", "aborted by the run itself: its parent process died", 3.0)
    cut_off = replace(result_of(plan, verdict, "too high"), also=(aborted,))
    write_atomically(home / "result.json", to_json(cut_off))
    rules = ResumeRules(is_real=lambda _: is_real, repeats_cut_off=repeats_cut_off)
    found = resume_campaign(loaded, tmp_path, rules, say=lambda _: None)
    assert (plan.name in found.results) is kept
    if not kept:
        # No verdict: by one it would have spent a retry that the flight to its end still has.
        told = f"in flight, after {verdict}: too high"
        attempt = EarlierAttempt(None, told, "earlier/default/sim/1-1")
        assert found.attempts[plan.name] == (attempt,)
        again = resume_campaign(loaded, tmp_path, rules, say=lambda _: None)
        assert again.attempts[plan.name] == (attempt,)


def test_retries_are_counted_over_the_times_it_was_resumed(campaign: Path, tmp_path: Path) -> None:
    loaded = load_campaign(campaign)
    plan = loaded.runs[0]
    for count in (1, 2, 3):
        attempts = tuple(EarlierAttempt("ERROR", "why", "there") for _ in range(count - 1))
        (tmp_path / plan.name).mkdir(parents=True)
        result = after_attempts(result_of(plan, "ERROR", "why"), attempts)
        write_atomically(tmp_path / plan.name / "result.json", to_json(result))
        found, _ = resume(tmp_path, loaded, retries=2)
        assert (plan.name in found.results) is (count == 3)


def test_a_run_that_still_lands_is_waited_for(
    campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = load_campaign(campaign)
    home = tmp_path / loaded.runs[0].name
    home.mkdir(parents=True)
    waited: list[float] = []
    with locked_run_folder(home):
        monkeypatch.setattr(time, "sleep", waited.append)
        with pytest.raises(OutputError, match="is still in flight after 120 s"):
            resume(tmp_path, loaded)
        assert len(waited) == 600
    assert resume(tmp_path, loaded)[1] == []


def test_the_newest_folder_is_resumed(tmp_path: Path) -> None:
    with pytest.raises(ResumeError, match="there is nothing to resume"):
        resumed_folder(tmp_path, "hover")
    names = ["20260101T000000Z-2", "20260101T000000Z-10", "20260101T000000Z", "20251231T235959Z"]
    for name in names:
        (tmp_path / "hover" / name).mkdir(parents=True)
        (tmp_path / "hover" / name / "campaign.json").write_text("{}")
    (tmp_path / "hover" / "20270101T000000Z").mkdir()
    newest = newest_campaign_folder(tmp_path / "hover")
    assert newest is not None
    assert newest.name == names[1]
    assert resumed_folder(newest, "hover") == newest
    assert resumed_folder(tmp_path, "hover") == newest


def test_after_a_clock_was_set_back_the_folder_is_named(tmp_path: Path) -> None:
    """The newest by its name may be whole, and not the one that was interrupted."""
    for name in ("20260101T000000Z", "29990101T000000Z"):
        (tmp_path / "hover" / name).mkdir(parents=True)
        (tmp_path / "hover" / name / "campaign.json").write_text("{}")
    with pytest.raises(ResumeError, match="29990101T000000Z has a time that is still to come"):
        resumed_folder(tmp_path, "hover")
    older = tmp_path / "hover" / "20260101T000000Z"
    assert resumed_folder(older, "hover") == older


@pytest.mark.usefixtures("quick")
def test_a_resumption_flies_the_missing_runs_alone(campaign: Path) -> None:
    assert run(campaign, "--repetitions", "4") == 0
    folder = folder_of(campaign)
    kept = {path: path.read_bytes() for path in folder.glob("default/sim/[134]/result.json")}
    (folder / "default/sim/2/result.json").unlink()
    (folder / "default/sim/2").rmdir()
    (folder / "summary.json").unlink()
    assert run(campaign, "--repetitions", "4", "--resume") == 0
    assert folder_of(campaign) == folder
    assert {path: path.read_bytes() for path in kept} == kept
    summary = summary_of(folder)
    assert [run["rep"] for run in summary["runs"]] == [1, 2, 3, 4]
    assert (summary["totals"]["passed"], summary["totals"]["retried"]) == (4, 0)
    assert len(json.loads((folder / "campaign.json").read_text())["resumed_utc"]) == 1
    again = ["run", str(campaign), "--repetitions", "4", "--resume", "--out", str(folder)]
    assert main(again) == 0
    assert summary_of(folder) == summary


CHANGES: tuple[tuple[str | None, tuple[str, ...], str], ...] = (
    ("hover.yaml", (), "hover.yaml changed"),
    ("world.yaml", (), "world.yaml changed"),
    ("still.py", (), "still.py changed"),
    (None, ("--repetitions", "3"), "repetitions was 2, now it is 3"),
    (None, ("--seed", "5"), "its seed was 0, now it is 5"),
    (
        None,
        ("--set", "world.origin.altitude_m=5"),
        "--set was not given, now it is world.origin.altitude_m=5",
    ),
    (None, ("--clock", "wall"), "its clock was virtual, now it is wall"),
)


@pytest.mark.usefixtures("quick")
def test_a_campaign_that_has_changed_is_not_resumed(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(campaign) == 0
    folder = folder_of(campaign)
    before = sorted(folder.rglob("*"))
    for changed, options, said in CHANGES:
        path = campaign.parent / (changed or "hover.yaml")
        original = path.read_text()
        if changed is not None:
            path.write_text(original + "\n")
        assert run(campaign, "--resume", *options) == 2, said
        path.write_text(original)
        told = capsys.readouterr().err
        assert said in told
        assert "start anew without --resume" in told
        assert sorted(folder.rglob("*")) == before
    assert run(campaign, "--resume") == 0


def fly_while_edited(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Stand in for a flight during which a person changes the autonomy."""
    with (order.plan.files.folder / "still.py").open("a") as autonomy:
        autonomy.write("# changed\n")
    return quick_fly(order, report, inbox)


def test_no_run_flies_an_autonomy_that_was_changed_in_flight(
    campaign: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each run loads its files anew: two runs of one campaign would have flown two autonomies."""
    original = (campaign.parent / "still.py").read_text()
    monkeypatch.setattr(run_engine, "fly_order", fly_while_edited)
    assert run(campaign) == 3
    assert f"{campaign.parent / 'still.py'} changed while the campaign flew" in (
        capsys.readouterr().err
    )
    folder = folder_of(campaign)
    assert sorted(path.name for path in (folder / "default/sim").glob("[0-9]")) == ["1"]
    (campaign.parent / "still.py").write_text(original)
    monkeypatch.setattr(run_engine, "fly_order", quick_fly)
    assert run(campaign, "--resume") == 0
    assert [one["attempts"] for one in summary_of(folder)["runs"]] == [[], []]


def fly_while_another_is_edited(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Stand in for a flight that is in the air while a person changes the autonomy."""
    edited = order.folder.parents[2] / "edited"
    if order.plan.repetition == 1:
        result = fly_while_edited(order, report, inbox)
        edited.touch()
        return result
    while not edited.exists():
        time.sleep(0.01)
    time.sleep(0.5)  # the other's end is handled, and the change is found
    return quick_fly(order, report, inbox)


def test_a_run_in_the_air_is_flown_to_its_end_when_a_file_changes(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = campaign.read_text()
    campaign.write_text(text.replace("repetitions: 2", "repetitions: 4"))
    monkeypatch.setattr(run_engine, "fly_order", fly_while_another_is_edited)
    assert run(campaign, "--jobs", "2") == 3
    runs = summary_of(folder_of(campaign))["runs"]
    assert [one["verdict"] for one in runs] == ["PASS", "PASS"]


def fly_and_write(order: RunOrder, report: Report, inbox: OperatorInbox) -> RunResult:
    """Stand in for a flight in which the autonomy writes a file."""
    with (order.plan.files.folder / "flights.txt").open("a") as file:
        file.write("2")
    return quick_fly(order, report, inbox)


def test_a_file_that_the_autonomy_may_write_does_not_end_its_campaign(
    campaign: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is named by `autonomy.with`, as what the autonomy reads is."""
    (campaign.parent / "flights.txt").write_text("1")
    named = "autonomy: {use: still.py:Still, with: {log: flights.txt}}"
    campaign.write_text(campaign.read_text().replace("autonomy: still.py:Still", named))
    monkeypatch.setattr(run_engine, "fly_order", fly_and_write)
    assert run(campaign) == 0
    assert (campaign.parent / "flights.txt").read_text() == "122"


@pytest.mark.usefixtures("quick")
def test_other_versions_and_spoilt_manifests_are_not_resumed(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(campaign) == 0
    path = folder_of(campaign) / "campaign.json"
    document = json.loads(path.read_text())
    document["versions"]["numpy"] = "1.0"
    path.write_text(json.dumps(document))
    assert run(campaign, "--resume") == 2
    assert "numpy was 1.0, now it is" in capsys.readouterr().err
    for text in ("{", "[]", '{"campaign": "hover"}'):
        path.write_text(text)
        assert run(campaign, "--resume") == 2
    assert "Traceback" not in capsys.readouterr().err
    for key in ("files", "versions", "runs", "options", "document"):
        for value in (None, 5, "x"):
            path.write_text(json.dumps({**document, key: value}))
            assert run(campaign, "--resume") == 2
            assert f"is damaged at {key}: restore it, or start" in capsys.readouterr().err


@pytest.mark.usefixtures("quick")
def test_a_campaign_of_another_commit_is_not_resumed(
    campaign: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one version, as between two releases. Changed code has a digest: "dirty" says not how."""
    monkeypatch.setattr(installation, "program_version", lambda: "0.1.0")
    monkeypatch.setattr(installation, "program_commit", lambda: "a" * 40)
    assert run(campaign) == 0
    flown = json.loads((folder_of(campaign) / "campaign.json").read_text())["versions"]
    assert flown["wil-campaign"] == f"0.1.0 (commit {'a' * 40})"
    assert run(campaign, "--resume") == 0
    for commit in ("b" * 40, f"{'a' * 40}-dirty", installation.UNKNOWN_COMMIT):
        monkeypatch.setattr(installation, "program_commit", lambda found=commit: found)
        capsys.readouterr()
        assert run(campaign, "--resume") == 2
        reason = f"wil-campaign was 0.1.0 (commit {'a' * 40}), now it is 0.1.0 ("
        assert reason in (text := capsys.readouterr().err)
        assert commit in text


@pytest.mark.usefixtures("quick")
def test_two_programs_do_not_fly_into_one_folder(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(campaign) == 0
    with locked_campaign_folder(folder_of(campaign)):
        assert run(campaign, "--resume") == 3
    assert "is in use by another wil-campaign" in capsys.readouterr().err


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("verdict", ["ERROR", "INVALID"])
def test_a_retry_is_recorded_and_no_clean_pass(
    campaign: Path, capsys: pytest.CaptureFixture[str], verdict: str
) -> None:
    campaign.write_text(campaign.read_text() + f"retries: 1\ndescription: {verdict}\n")
    assert run(campaign, "--repetitions", "1") == 0
    folder = folder_of(campaign)
    summary = summary_of(folder)
    (flown,) = summary["runs"]
    place = "earlier/default/sim/1-1"
    assert flown["attempts"] == [{"verdict": verdict, "reason": "bad luck", "folder": place}]
    assert flown["reason"] == f"passed at attempt 2; before: {verdict} (bad luck)"
    assert summary["totals"]["retried"] == 1
    assert json.loads((folder / place / "result.json").read_text())["verdict"] == verdict
    junit = (folder / "junit.xml").read_text()
    assert 'name="1 (attempt 2)"' in junit
    said = f"default sim #1: PASS at attempt 2, after {verdict} (bad luck)"
    assert f'<property name="retried" value="{said}" />' in junit
    out = capsys.readouterr().out
    assert f"default/sim/1: {verdict}, bad luck; flown again" in out
    assert "PASS*, 2 attempts" in out
    assert f"1 not at the first attempt ({said})" in " ".join(out.split())
    assert "accepted of what was flown; 1 not at the first attempt" in out


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(("hardware", "retried"), [("", 1), ("real", 0)])
def test_hardware_is_never_flown_again_by_itself(
    campaign: Path, hardware: str, retried: int
) -> None:
    campaign.write_text(campaign.read_text() + "retries: 2\ndescription: ERROR\n")
    options = FlightOptions(out=campaign.parent / "out")
    cleared = ClearedCampaign("virtual", 1, hardware=hardware)
    loaded = load_campaign(campaign, ExpansionOptions(repetitions=1))
    outcome = fly_campaign(loaded, options, cleared, SilentDisplay())
    assert len(list(outcome.folder.rglob("result.json"))) == 1 + retried
    assert [len(one.attempts) for one in outcome.summary.runs] == [retried]
    assert outcome.exit_code == (0 if retried else 3)


@pytest.mark.usefixtures("quick")
def test_retries_come_to_an_end_and_a_fail_is_not_retried(campaign: Path) -> None:
    text = campaign.read_text()
    campaign.write_text(text + "retries: 2\ndescription: die\n")
    assert run(campaign, "--repetitions", "1") == 3
    (flown,) = summary_of(folder_of(campaign))["runs"]
    assert [one["verdict"] for one in flown["attempts"]] == ["ERROR", "ERROR"]
    assert flown["verdict"] == "ERROR"
    campaign.write_text(text + "retries: 2\ndescription: FAIL\n")
    assert main(["run", str(campaign), "--out", str(campaign.parent / "other")]) == 1
    assert not list((campaign.parent / "other").rglob("earlier"))


def test_attempts_are_numbered_as_they_come(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        (tmp_path / "a/sim/1").mkdir(parents=True)
        (tmp_path / "a/sim/1/log.jsonl").write_text(str(number))
        place = set_run_folder_aside(tmp_path, "a/sim/1")
        assert place == tmp_path / f"earlier/a/sim/1-{number}"
        assert (place / "log.jsonl").read_text() == str(number)


def test_a_finished_run_is_on_the_disk_before_its_result_is_reported(
    campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[str] = []
    fsync = os.fsync

    def noting(handle: int) -> None:
        synced.append(Path(f"/proc/self/fd/{handle}").readlink().name)
        fsync(handle)

    monkeypatch.setattr(os, "fsync", noting)
    (plan, *_) = load_campaign(campaign, ExpansionOptions(repetitions=1)).runs
    folder = tmp_path / "out" / plan.name
    fly_order(
        RunOrder(plan=plan, folder=folder, clock="virtual"), lambda _: None, quiet := NoCommands()
    )
    assert quiet.polled
    streams = {path.name for path in folder.iterdir()} - {"result.json"}
    told = next(at for at, name in enumerate(synced) if name.startswith(".result.json"))
    assert streams <= set(synced[:told])
    assert {"1", "sim", "default", "out"} <= set(synced)


class NoCommands:
    polled = False

    def poll(self) -> None:
        self.polled = True


class Killing(SilentDisplay):
    """Kills its process between two runs."""

    def finished(self, result: RunResult) -> None:
        if result.rep == 2:
            os.kill(os.getpid(), signal.SIGKILL)


def fly_until_killed(path: Path) -> None:
    campaign = load_campaign(path, ExpansionOptions(repetitions=4))
    options = FlightOptions(out=path.parent / "out")
    cleared = ClearedCampaign("virtual", 1)
    fly_campaign(campaign, options, cleared, Killing())


def resumed(campaign: Path) -> dict[str, Any]:
    assert run(campaign, "--repetitions", "4", "--resume") == 0
    folder = folder_of(campaign)
    summary = summary_of(folder)
    assert [one["rep"] for one in summary["runs"]] == [1, 2, 3, 4]
    assert {one["verdict"] for one in summary["runs"]} == {"PASS"}
    return summary


def test_a_resumption_keeps_the_runs_before_a_kill_between_two_runs(campaign: Path) -> None:
    context = multiprocessing.get_context("forkserver")
    process = context.Process(target=fly_until_killed, args=(campaign,))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    before = {path.parent.name for path in folder_of(campaign).glob("default/sim/*/result.json")}
    assert before >= {"1", "2"}
    summary = resumed(campaign)
    assert [bool(one["attempts"]) for one in summary["runs"]][:2] == [False, False]


@contextmanager
def slowed(campaign: Path, tick: str) -> Iterator[None]:
    """Have the campaign's flights stay at their goal meanwhile; later ones end by `tick`."""
    still, slow = campaign.parent / "still.py", campaign.parent / "slow"
    slow.touch()
    tick = f"ticks -= {tick} * (not pathlib.Path({str(slow)!r}).exists())"
    still.write_text("import pathlib\n" + still.read_text().replace("ticks -= 1", tick))
    yield
    slow.unlink()


def killed(campaign: Path, *options: str, when: Callable[[], object], all_at_once: bool) -> None:
    """Start the program, and kill it, or all of its processes."""
    command = [sys.executable, "-m", "wil_campaign", "run", str(campaign), "--jobs", "1"]
    with subprocess.Popen(  # noqa: S603 - our own interpreter
        [*command, "--out", str(campaign.parent / "out"), "--repetitions", "4", *options],
        cwd=ROOT,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
    ) as running:
        try:
            wait_for(when)
        except BaseException:
            os.killpg(running.pid, signal.SIGKILL)
            raise
        (os.killpg if all_at_once else os.kill)(running.pid, signal.SIGKILL)


def test_a_run_that_lands_after_a_kill_is_flown_again(campaign: Path) -> None:
    with slowed(campaign, "1"):
        at_goal = partial(reaches_goal, campaign)
        killed(campaign, when=at_goal, all_at_once=False)
    first = resumed(campaign)["runs"][0]
    (attempt,) = first["attempts"]
    assert attempt["verdict"] == "ABORTED"
    assert first["reason"].startswith("passed at attempt 2; before: ")


def test_no_run_counts_twice_after_two_kills_with_its_run(campaign: Path) -> None:
    """As when the power goes: in the middle of a run, and once more after it was flown again."""
    with slowed(campaign, "0.02"):
        killed(campaign, when=partial(reaches_goal, campaign), all_at_once=True)
    finished = partial(text_of, campaign, "default/sim/1/result.json")
    killed(campaign, "--resume", when=finished, all_at_once=True)
    summary = resumed(campaign)
    (attempt,) = summary["runs"][0]["attempts"]
    assert attempt["verdict"] is None
    assert summary["totals"]["runs"] == summary["totals"]["passed"] == 4
    # The first was whole before the second time; a later one may have been in flight then.
    assert summary["runs"][0]["reason"].startswith("passed at attempt 2; before: ")
    for one in summary["runs"][1:]:
        if one["attempts"]:
            assert one["reason"].startswith(f"passed at attempt {len(one['attempts']) + 1}; before")


def reaches_goal(campaign: Path) -> bool:
    return '"goal"' in text_of(campaign, "default/sim/1/log.jsonl")


def text_of(campaign: Path, name: str) -> str:
    return "".join(path.read_text() for path in (campaign.parent / "out").glob(f"hover/*/{name}"))


def wait_for(condition: Any) -> None:
    deadline_s = time.monotonic() + 100.0
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
