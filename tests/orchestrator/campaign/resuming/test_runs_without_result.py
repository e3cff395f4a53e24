"""Runs whose program was killed: each accounted for, and none with a real vehicle flown again."""

import json
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.full_disk import files_no_larger_than
from tests.orchestrator.campaign.resuming.test_runs_to_fly import result_of
from tests.orchestrator.hover import write_hover
from tests.plugins.cluster.bench.test_bench_engine import write_bench, write_campaign
from wil_campaign.campaigns.expansion.expansion import Campaign, ExpansionOptions, load_campaign
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.campaign.folder.campaign_folder import set_run_folder_aside
from wil_campaign.orchestrator.campaign.resuming.cluster_ledger import (
    RunLedger,
    open_orders,
)
from wil_campaign.orchestrator.campaign.resuming.runs_to_fly import (
    ResumedCampaign,
    ResumeRules,
    resume_campaign,
)
from wil_campaign.orchestrator.campaign.resuming.runs_without_result import real_runs
from wil_campaign.orchestrator.campaign.resuming.unchanged_campaign import ResumeError
from wil_campaign.orchestrator.cli import main
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.run_results.result_reader import read_result
from wil_campaign.safety.model.oracle_results import Verdict

FIRST, SECOND = "default/sim/1", "default/sim/2"


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    """Two runs, of which the first was cut off."""
    home = tmp_path / FIRST
    home.mkdir(parents=True)
    (home / "log.jsonl").write_text("{}\n")
    return load_campaign(write_hover(tmp_path))


def finish(folder: Path, campaign: Campaign, number: int, verdict: Verdict) -> None:
    plan = campaign.runs[number]
    (folder / plan.name).mkdir(parents=True, exist_ok=True)
    (folder / plan.name / "result.json").write_text(to_json(result_of(plan, verdict, "why")))


def resume(
    folder: Path, campaign: Campaign, *, real: bool = True, again: Collection[str] = ()
) -> ResumedCampaign:
    rules = ResumeRules(is_real=lambda _: real, again=again)
    return resume_campaign(campaign, folder, rules, say=lambda _: None)


def ledger(folder: Path) -> list[tuple[str, str, str]]:
    lines: list[dict[str, Any]] = [
        json.loads(one) for one in (folder / "ledger.jsonl").read_text().splitlines()
    ]
    return [(line["session"], line["event"], line.get("run", "")) for line in lines]


def test_a_real_run_without_a_result_is_lost_and_flown_again_by_its_name_alone(
    campaign: Campaign, tmp_path: Path
) -> None:
    found = resume(tmp_path, campaign)
    assert dict(found.attempts) == {SECOND: ()}
    lost = found.results[FIRST]
    assert (lost.verdict, lost.required) == ("ERROR", True)
    assert "its program was killed, and it has no result" in lost.reason
    assert f"--resume --again {FIRST}" in lost.reason
    assert read_result(tmp_path / FIRST / "result.json") == lost
    assert (tmp_path / FIRST / "log.jsonl").is_file()  # what it flew stays in its place
    assert resume(tmp_path, campaign).results == found.results
    named = resume(tmp_path, campaign, again=[FIRST])
    (attempt,) = named.attempts[FIRST]
    assert (attempt.verdict, attempt.folder) == ("ERROR", f"earlier/{FIRST}-1")


def test_a_run_that_a_killed_resumption_had_set_aside_is_lost(
    campaign: Campaign, tmp_path: Path
) -> None:
    set_run_folder_aside(tmp_path, FIRST)  # and there the program was killed
    lost = resume(tmp_path, campaign).results[FIRST]
    assert "it had been set aside for another flight" in lost.reason
    assert [attempt.folder for attempt in lost.attempts] == [f"earlier/{FIRST}-1"]


def test_a_simulated_run_is_flown_again(campaign: Campaign, tmp_path: Path) -> None:
    assert set(resume(tmp_path, campaign, real=False).attempts) == {FIRST, SECOND}
    assert not (tmp_path / FIRST).exists()


@pytest.mark.parametrize("real", [True, False])
def test_a_cut_off_run_whose_subject_had_failed_is_not_flown_again(
    campaign: Campaign, tmp_path: Path, real: bool
) -> None:
    """Else a campaign that is killed at each touch, and resumed, would pass."""
    touched = {"t_s": 9.0, "event": "decisive", "kind": "FAIL", "reason": "twin touched wall"}
    (tmp_path / FIRST / "log.jsonl").write_text(json.dumps(touched) + "\n")
    with pytest.raises(ResumeError, match="the subject failed, too: twin touched wall"):
        resume(tmp_path, campaign, real=real, again=[FIRST])
    found = resume(tmp_path, campaign, real=real)
    assert dict(found.attempts) == {SECOND: ()}
    failed = found.results[FIRST]
    assert (failed.verdict, failed.reason) == ("FAIL", "twin touched wall")
    assert "its program was killed, and it has no result" in failed.also[0].reason


def test_an_aborted_run_whose_subject_failed_is_not_flown_again(
    campaign: Campaign, tmp_path: Path
) -> None:
    aborted = replace(result_of(campaign.runs[0], "ABORTED", "by anna"), no_retry="it touched")
    (tmp_path / FIRST / "result.json").write_text(to_json(aborted))
    assert resume(tmp_path, campaign, real=False).results[FIRST] == aborted
    with pytest.raises(ResumeError, match="it touched; such a run is not flown again"):
        resume(tmp_path, campaign, real=False, again=[FIRST])


def test_a_damaged_result_of_a_real_run_is_kept_beside_the_error(
    campaign: Campaign, tmp_path: Path
) -> None:
    (tmp_path / FIRST / "result.json").write_text("half")
    lost = resume(tmp_path, campaign).results[FIRST]
    assert "is truncated, damaged" in lost.reason
    assert (tmp_path / FIRST / "result.damaged.json").read_text() == "half"


@pytest.mark.parametrize(
    ("verdict", "said"),
    [("PASS", "it is PASS, which counts"), ("FAIL", "it is FAIL, which counts")],
)
def test_a_run_that_is_pass_or_fail_is_not_flown_again_by_name(
    campaign: Campaign, tmp_path: Path, verdict: Verdict, said: str
) -> None:
    finish(tmp_path, campaign, 0, verdict)
    with pytest.raises(ResumeError, match=said):
        resume(tmp_path, campaign, again=[FIRST])
    with pytest.raises(ResumeError, match="no such run"):
        resume(tmp_path, campaign, again=["default/sim/9"])
    assert read_result(tmp_path / FIRST / "result.json").verdict == verdict


@pytest.mark.parametrize("real", [True, False])
def test_each_order_of_a_killed_program_has_one_outcome_after_a_resumption(
    campaign: Campaign, tmp_path: Path, *, real: bool
) -> None:
    killed = RunLedger(tmp_path, "killed")
    killed.write("ordered", FIRST, "hall")
    killed.write("ordered", SECOND, "hall")
    finish(tmp_path, campaign, 1, "PASS")
    assert set(open_orders(tmp_path)) == {FIRST, SECOND}
    for _ in range(2):
        resume(tmp_path, campaign, real=real)
        outcomes = sorted(ledger(tmp_path)[3:])
        assert outcomes == [("killed", "found", SECOND), ("killed", "lost", FIRST)]
    assert open_orders(tmp_path) == {}


def test_a_real_run_that_was_ordered_and_left_no_folder_is_lost(tmp_path: Path) -> None:
    campaign = load_campaign(write_hover(tmp_path))
    RunLedger(tmp_path, "killed").write("ordered", FIRST, "hall")
    lost = resume(tmp_path, campaign).results[FIRST]
    assert "it was ordered from hall and has no folder" in lost.reason
    assert ledger(tmp_path)[-1] == ("killed", "lost", FIRST)


def test_a_run_that_a_sequential_test_set_aside_is_not_lost(tmp_path: Path) -> None:
    path = write_hover(tmp_path)
    test = "repetitions: {until: decided, at_least: 0.9, against: 0.3, most: 9}"
    path.write_text(path.read_text().replace("repetitions: 2", test))
    campaign = load_campaign(path)
    for number in range(9):
        finish(tmp_path, campaign, number, "PASS")
    last = campaign.runs[-1].name
    set_run_folder_aside(tmp_path, last)
    # Eight passes have decided: that it is missing is no loss.
    assert last not in resume(tmp_path, campaign).results


def test_a_start_after_a_line_that_was_cut_off_is_read(tmp_path: Path) -> None:
    RunLedger(tmp_path, "first")
    with (tmp_path / "ledger.jsonl").open("a") as file:
        file.write('{"session": "fi')
    RunLedger(tmp_path, "second").write("ordered", "a/sim/1", "node")
    assert open_orders(tmp_path)["a/sim/1"].session == "second"


def test_a_run_is_real_where_a_real_vehicle_flies(tmp_path: Path) -> None:
    sim = load_campaign(write_hover(tmp_path))
    assert not any(map(real_runs(sim, "real"), sim.plans))
    path, bench = write_campaign(tmp_path), write_bench(tmp_path)
    twin = "twin: {link: embedded, autopilot: px4}"
    text = path.read_text().replace("modes: [real]", "modes: [sim, real]")
    path.write_text(text.replace("vehicles: {}", f"vehicles: {{{twin}}}"))
    hall = load_campaign(path, ExpansionOptions(benches=(bench,)))
    # On a bench whatever its vehicle is, and not where the twin flies alone.
    assert {plan.mode: real_runs(hall, "")(plan) for plan in hall.plans} == {
        "sim": False,
        "real": True,
    }
    real = "real: {link: 'udpin://127.0.0.1:14999', autopilot: px4}"
    text = text.replace("bench: hall-a\nvehicles: {}", f"vehicles: {{{twin}, {real}}}")
    path.write_text(text.replace(", geofence: {}", ""))
    attached = load_campaign(path)
    in_real = next(plan for plan in attached.plans if plan.mode == "real")
    assert real_runs(attached, "real")(in_real)
    assert not any(map(real_runs(attached, ""), attached.plans))


def test_a_reader_names_what_was_begun_and_has_no_result(
    campaign: Campaign, tmp_path: Path
) -> None:
    finish(tmp_path, campaign, 1, "PASS")
    problems = read_campaign_documents(tmp_path).run_problems
    assert [problem.partition(": ")[0] for problem in problems] == [FIRST, FIRST]
    assert "was started and has no result" in problems[1]


def test_a_run_is_named_with_resume_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", str(write_hover(tmp_path)), "--out", str(tmp_path / "out"), "--again", FIRST]
    assert main(words) == 2
    assert "needs --resume" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_order_of_which_a_disk_takes_a_part_alone_is_an_error(tmp_path: Path) -> None:
    """It would be sent, and after a kill nobody would know of the flight."""
    orders = RunLedger(tmp_path, "first")
    begun = (tmp_path / "ledger.jsonl").stat().st_size
    with files_no_larger_than(begun + 20), pytest.raises(OSError, match="too large"):
        orders.write("ordered", FIRST, "node")
    assert open_orders(tmp_path) == {}
    orders.write("ordered", SECOND, "node")
    assert [*open_orders(tmp_path)] == [SECOND]
