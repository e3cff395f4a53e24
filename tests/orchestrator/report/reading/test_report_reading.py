"""The reading model: what a recorded folder tells, and what a damaged one still does."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import shapely

from tests.orchestrator.report.recorded_campaign import (
    FENCE,
    GOAL_S,
    TOUCHED_S,
    record_readings,
    touched,
    write_campaign,
)
from wil_campaign.foundation.files.document_writer import to_json
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.model import CampaignDocuments
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.report.campaign_report import write_report
from wil_campaign.orchestrator.report.model import LogEvent, PageImage, RunReport
from wil_campaign.orchestrator.report.reading.cause import (
    ContactFacts,
    NearestPass,
    verdict_cause_of,
    verdict_notes_of,
)
from wil_campaign.orchestrator.report.reading.outlines import ring_of_outline
from wil_campaign.orchestrator.report.reading.run_reader import read_run
from wil_campaign.orchestrator.report.reading.sight_decoding import ImageSize
from wil_campaign.orchestrator.report.reading.world_facts import recorded_world
from wil_campaign.orchestrator.report.rendering.page import render_run
from wil_campaign.orchestrator.run_results.evidence_files import EVIDENCE_FILES, evidence_digests
from wil_campaign.orchestrator.run_results.result_parts import DropOut, TwinResult
from wil_campaign.orchestrator.run_results.run_result import (
    LaterEvent,
    RunResult,
    SyncResult,
    with_note,
)
from wil_campaign.safety.evaluation.judge_log import read_judge_log
from wil_campaign.safety.fence.fence_values import plain_fence
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import FenceSample

SIZE = ImageSize.for_runs(1)
FAILED = "large/wil/1"
WORLD = {"schema": "wil/world/1", "origin": {"latitude_deg": 47.4, "longitude_deg": 8.5}}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_campaign(tmp_path_factory.mktemp("results") / "gate")


@pytest.fixture
def copied(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "gate"))


def run_of(folder: Path, name: str = FAILED) -> RunReport:
    campaign = read_campaign_documents(folder)
    return read_run(folder, next(entry for entry in campaign.entries if entry.name == name), SIZE)


def plot_of(run: RunReport, title: str) -> dict[str, dict[float, float]]:
    plot = next(one for one in run.plots if one.title == title)
    return {curve.subject: dict(curve.points) for curve in plot.curves}


def test_the_campaign_has_its_runs_in_the_order_of_its_manifest(recorded: Path) -> None:
    campaign = read_campaign_documents(recorded)
    assert [entry.name for entry in campaign.entries] == ["large/sim/1", FAILED]
    assert campaign.entries[1].result == touched()
    assert campaign.summary is not None
    assert not campaign.problems


def test_a_failed_run_tells_what_when_and_by_how_much(recorded: Path) -> None:
    run = run_of(recorded)
    assert run.cause is not None
    assert run.moment is not None
    assert not run.problems
    facts = dict(run.cause.facts)
    assert run.cause.violated == "collision of real"
    assert facts["where"] == "touched gate.left"
    assert facts["when"] == "2.00 s after the goal was given"
    assert run.moment.t_s == TOUCHED_S
    assert run.goal_s == GOAL_S


def test_the_image_and_the_command_shown_are_those_of_the_moment(recorded: Path) -> None:
    run = run_of(recorded)
    assert run.sight is not None
    seen = run.sight.perceived
    assert isinstance(seen, PageImage)
    # Delivered 0.05 s after its exposure: the last by 4.0 s was exposed at 3.9 s.
    assert (seen.source, seen.t_s) == ("mixed", 3.9)
    assert seen.delivered_s == pytest.approx(3.95)
    assert [(one.source, one.t_s) for one in run.sight.beside] == [("real", 3.9), ("twin", 3.9)]
    assert ("exposure skew", "1.5 ms") in run.sight.figures
    real = next(one for one in run.at_moment if one.vehicle == "real")
    facts = dict(real.facts)
    assert facts["commanded"].startswith("velocity: north +0.80 m/s".removesuffix(" m/s"))
    assert facts["was at"] == "north 2.00 m, east 0.50 m, up 1.20 m"
    times = [sight.perceived.t_s for sight in run.strip]
    assert times == sorted(times)
    assert len(times) == 7


def test_a_moment_after_the_images_have_ended_is_shown_by_none(copied: Path) -> None:
    """The last image before the landing does not show what was touched in the landing."""
    place = copied / FAILED
    (place / "run.mcap").unlink()
    record_readings(place, "wil", until_s=3.2)
    with (place / "log.jsonl").open("a", encoding="utf-8") as log:
        log.write(json.dumps({"t_s": 3.2, "event": "images_ended", "topics": "/mixed/camera"}))
    run = run_of(copied)
    assert run.moment is not None
    assert run.moment.t_s == TOUCHED_S == 4.0
    assert (run.sight, run.images_end_s) == (None, 3.2)
    assert [sight.wanted_s for sight in run.strip] == [2.0, 3.0]
    page = render_run(run, anchor="run").html
    assert "No image shows this moment: drawn images ended with the goal, at +1.20 s." in page


def test_clearance_and_margins_are_those_of_the_world_that_was_flown_in(recorded: Path) -> None:
    run = run_of(recorded)
    clearance = plot_of(run, "clearance")
    # real flies along the inner edge of the left bar's neighbour: it touches; twin flies through.
    assert min(clearance["real"].values()) == 0.0
    assert 0.2 < min(clearance["twin"].values()) < 0.5
    fence = plot_of(run, "margin to the fence")
    assert min(fence["real"].values()) == pytest.approx(0.0, abs=0.11)
    assert set(plot_of(run, "registration error")["mixed"].values()) == {2.0}
    (gate,) = run.world.outlines
    assert gate.is_virtual


def test_an_opening_is_drawn_open_from_above_and_from_the_side(recorded: Path) -> None:
    (gate,) = run_of(recorded).world.outlines
    # The gate stands across the path, at north 2 m: its lintel does not close the plan, nor do its
    # posts the view from the side.
    views = (gate.above_m, gate.side_m)
    above, side = ([shapely.Polygon(one) for one in view if len(one) > 2] for view in views)
    assert not any(one.intersects(shapely.Point(0.0, 2.0)) for one in above)
    assert not any(one.intersects(shapely.Point(2.0, 1.2)) for one in side)
    # A line leads from side to side, as in a floor plan.
    (above_line,), (side_line,) = ([one for one in view if len(one) == 2] for view in views)
    assert shapely.LineString(above_line).equals(shapely.LineString([(-0.5, 2.0), (0.5, 2.0)]))
    assert shapely.LineString(side_line).equals(shapely.LineString([(2.0, 0.7), (2.0, 1.7)]))
    assert shapely.union_all(above).bounds == pytest.approx((-0.6, 1.95, 0.6, 2.05))
    assert shapely.union_all(side).bounds == pytest.approx((1.95, 0.6, 2.05, 1.8))


def test_colours_of_depths_have_their_scale(recorded: Path) -> None:
    run = run_of(recorded)
    assert run.sight is not None
    assert isinstance(run.sight.perceived, PageImage)
    words = "3 m or farther, or no echo"
    assert words not in render_run(run, anchor="run").html
    deep = replace(run.sight, perceived=replace(run.sight.perceived, far_m=3.0))
    assert words in render_run(replace(run, sight=deep), anchor="run").html


def test_a_hole_is_joined_to_its_outline_by_the_shortest_line() -> None:
    square = shapely.box(0.0, 0.0, 4.0, 4.0)
    drawn = ring_of_outline(square.difference(shapely.box(2.5, 1.0, 3.5, 2.0)))
    filled = shapely.make_valid(shapely.Polygon(drawn))
    assert shapely.area(filled) == pytest.approx(15.0)
    assert not filled.contains(shapely.Point(3.0, 1.5))


def test_the_fence_drawn_is_that_of_the_moment_and_the_page_says_when_it_changed(
    copied: Path,
) -> None:
    path = copied / FAILED / "judged.msgpack"
    with path.open("rb") as stream:
        samples = list(read_judge_log(stream))
    path.unlink()
    tighter = Fence.box(north_m=(-1.0, 2.5), east_m=(-2.0, 2.0), up_m=(-0.5, 2.0))
    with JudgeLogWriter(path=path) as judged:
        for sample in (*samples, FenceSample(TOUCHED_S + 0.5, "real", tighter)):
            judged.write(sample)
    run = run_of(copied)
    drawn = {vehicle: plain_fence(fence) for vehicle, fence in run.world.fences.items()}
    assert drawn == {"real": plain_fence(FENCE), "twin": plain_fence(FENCE)}
    note = "in force at the moment; it was changed in flight at +2.50 s"
    assert run.world.fence_note == note
    margins = plot_of(run, "margin to the fence")
    # It flew on north beyond the changed fence, within the one of before.
    assert margins["real"][6.0] == pytest.approx(-1.5, abs=0.06)
    assert margins["twin"][6.0] == pytest.approx(0.0, abs=0.06)
    assert f"geofence {note}" in write_report(copied).path.read_text()


def test_in_mode_sim_the_twin_perceives_its_own_images(recorded: Path) -> None:
    run = run_of(recorded, "large/sim/1")
    assert run.cause is None
    assert run.sight is not None
    assert run.sight.perceived.source == "twin"
    assert run.sight.beside == ()


@pytest.mark.parametrize("file", ["run.mcap", "judged.msgpack", "log.jsonl", "trajectory.csv"])
@pytest.mark.parametrize("damage", ["cut", "empty", "foreign", "missing", "folder", "pipe"])
def test_a_damaged_file_takes_nothing_but_itself(copied: Path, file: str, damage: str) -> None:
    path = copied / FAILED / file
    whole = path.read_bytes()
    path.unlink()
    if damage == "folder":
        path.mkdir()
    elif damage == "pipe":  # nobody writes into it
        os.mkfifo(path)
    elif damage != "missing":
        content = {"cut": whole[: len(whole) // 2 + 3], "empty": b"", "foreign": b"\x00\xff{" * 999}
        path.write_bytes(content[damage])
    run = run_of(copied)
    assert any(file in problem or "world" in problem for problem in run.problems)
    assert run.cause is not None
    assert run.cause.violated == "collision of real"
    assert bool(run.tracks)
    assert bool(run.strip) == (file != "run.mcap" or damage == "cut")


def test_a_recording_of_another_run_is_named(copied: Path) -> None:
    """Its images and its world are in the report, and no digest of it is in the result."""
    place = copied / FAILED
    (place / "run.mcap").unlink()
    record_readings(place, "sim")
    run = run_of(copied)
    says = f"run.mcap is not that of this flight: it is of {FAILED.replace('wil', 'sim')} with seed"
    assert any(problem.startswith(says) for problem in run.problems)


@pytest.mark.parametrize("file", EVIDENCE_FILES)
def test_a_file_that_the_flight_did_not_write_is_named(copied: Path, file: str) -> None:
    place = copied / FAILED
    own = replace(touched(), evidence_files=evidence_digests(place))
    (place / "result.json").write_text(to_json(own))
    assert run_of(copied).problems == ()
    with (place / file).open("ab") as stream:
        stream.write(b"\n")
    says = f"{file} is not that of this flight"
    assert any(problem.startswith(says) for problem in run_of(copied).problems)


@pytest.mark.parametrize(
    ("content", "says"),
    [("{", "EOF"), ("[]", "object"), ('{"verdict": "GOOD"}', "case"), ("\x00", "result.json")],
)
def test_a_result_that_cannot_be_read_is_taken_from_the_summary(
    copied: Path, content: str, says: str
) -> None:
    (copied / FAILED / "result.json").write_text(content)
    run = run_of(copied)
    assert run.result == touched()
    assert any(says in problem for problem in run.problems), run.problems
    (copied / "summary.json").write_text(content)
    without = run_of(copied)
    assert without.result is None
    assert without.tracks
    campaign = read_campaign_documents(copied)
    assert campaign.summary is None
    assert any("summary.json" in problem for problem in campaign.problems)


def test_a_folder_that_was_cut_off_is_shown_as_far_as_it_goes(copied: Path) -> None:
    shutil.rmtree(copied / FAILED)
    (copied / "summary.json").unlink()
    written = write_report(copied)
    assert "NO RESULT" in written.path.read_text()
    assert any("1 of 2 runs have no readable result" in problem for problem in written.problems)
    assert any("was not flown" in problem for problem in written.problems)


@pytest.mark.parametrize("manifest", [{"runs": [{"run": "../../etc/1"}, {"run": 5}, 7]}, {}, []])
def test_a_manifest_leads_nowhere_else(copied: Path, manifest: object) -> None:
    (copied / "campaign.json").write_text(json.dumps(manifest))
    names = {entry.name for entry in read_campaign_documents(copied).entries}
    assert names == {"large/sim/1", FAILED}


def test_a_folder_of_no_campaign_is_refused_in_words(recorded: Path, tmp_path: Path) -> None:
    for folder, says in (
        (tmp_path / "nowhere", "does not exist"),
        (tmp_path, "not the results folder"),
        (recorded / FAILED, "the folder of one run"),
        (recorded / "summary.json", "is a file"),
        (recorded.parent, "did you mean"),
    ):
        with pytest.raises(ResultsFolderError, match=says):
            read_campaign_documents(folder)


def test_a_campaign_without_runs_says_so(tmp_path: Path) -> None:
    (tmp_path / "campaign.json").write_text('{"campaign": "empty"}')
    campaign: CampaignDocuments = read_campaign_documents(tmp_path)
    assert campaign.name == "empty"
    assert "no run was started in this folder" in campaign.problems


def test_a_run_that_the_guard_ended_says_when_though_its_reason_has_a_note(recorded: Path) -> None:
    result = run_of(recorded).result
    assert result is not None
    breach = "real cannot stop before the fence's north side, 0.99 m away"
    guarded = replace(
        result,
        reason=with_note(breach, "through", has_begun=True),
        note="through",
        decided_by="guard.fence/real",
    )
    events = [LogEvent(20.0, "decisive", "", f"kind FAIL · {breach} · source guard.fence/real")]
    cause = verdict_cause_of(guarded, events, goal_s=15.0, passed=NearestPass(18.0, 0.7))
    assert cause is not None
    assert cause.at_s == 20.0
    assert ("last note", "through") in cause.facts


def failed(oracle: OracleResult) -> RunResult:
    """Return a run that one oracle failed."""
    return RunResult(
        case="a",
        mode="wil",
        rep=1,
        seed=1,
        verdict="FAIL",
        reason=oracle.detail,
        also=(),
        required=True,
        duration_s=10.0,
        wall_s=1.0,
        oracles=(oracle,),
        sync=SyncResult(),
        mixing=None,
        decided_by=f"{oracle.name}/{oracle.vehicle}",
    )


def test_a_cause_names_the_rule_in_words_and_what_a_limit_of_contact_means() -> None:
    touch = OracleResult("collision", "real", True, "FAIL", 0.0, 0.0, "m", 0.0, 8.0, "touched gate")
    cause = verdict_cause_of(failed(touch), (), goal_s=0.0, passed=NearestPass(7.0, 0.4))
    assert cause is not None
    facts = dict(cause.facts)
    assert facts["rule"] == "real touches nothing of the judged world"
    assert facts["by how much"] == "contact: any contact is a violation"
    assert not {"nearest", "at worst", "limit"} & set(facts)


def test_a_rule_has_the_value_of_its_limit() -> None:
    near = OracleResult("clearance", "twin", True, "FAIL", 0.2, 0.35, "m", -0.15, 8.0, "gate")
    cause = verdict_cause_of(failed(near), (), goal_s=0.0, passed=None)
    assert cause is not None
    assert dict(cause.facts)["rule"] == "twin keeps at least 0.35 m from everything"


def test_an_error_is_not_explained_by_an_oracle_that_never_began() -> None:
    missed = OracleResult("reached_position", "twin", True, "FAIL", None, 0.5, "m", None, None, "-")
    reason = "twin: not at 1.2 m within 30 s; last STATUSTEXT: none"
    result = replace(failed(missed), verdict="ERROR", reason=reason, decided_by="")
    cause = verdict_cause_of(result, (), goal_s=None, passed=None)
    assert cause is not None
    assert (cause.oracle, cause.violated) == ("", "twin: not at 1.2 m within 30 s")


def test_a_physical_contact_is_explained_by_its_oracle_and_in_the_order_of_time() -> None:
    touch = OracleResult(
        "collision", "real", True, "FAIL", 0.0, 0.0, "m", 0.0, 8.0, "touched gate.left"
    )
    result = replace(
        failed(touch),
        reason="real physically touched gate.left",
        decided_by="contact/real",
        also=(
            LaterEvent("FAIL", "real: failsafe", 8.5),
            LaterEvent("FAIL", "real touched gate.left", 8.0),
        ),
    )
    cause = verdict_cause_of(
        result,
        (),
        goal_s=2.0,
        passed=None,
        outcome=((9.5, "the run counts as landed"),),
        contact_at=lambda vehicle, t_s: ContactFacts(0.39, t_s + 0.25, 9.5),
    )
    assert cause is not None
    facts = dict(cause.facts)
    assert cause.violated == "collision of real"
    assert facts["where"] == "touched gate.left"
    assert facts["by how much"] == "contact at 0.39 m/s for 0.25 s: any contact is a violation"
    assert cause.sequence == (
        (8.0, "FAIL: real physically touched gate.left"),
        (8.0, "FAIL: real touched gate.left"),
        (8.5, "FAIL: real: failsafe"),
        (9.5, "the run counts as landed"),
    )


def test_a_formula_is_its_own_rule_and_its_figures_stand_once() -> None:
    said = "up_m <= 1.3 is violated: 1.650 m against 1.3 m"
    waits = OracleResult("waits", "real", True, "FAIL", 1.65, (None, 1.3), "m", -0.35, 8.0, said)
    cause = verdict_cause_of(
        failed(waits), (), goal_s=2.0, passed=None, formulas={"waits": "always[0,3] (up_m <= 1.3)"}
    )
    assert cause is not None
    facts = dict(cause.facts)
    assert facts["rule"] == "always[0,3] (up_m <= 1.3) (seconds since its window opened)"
    plain = {"waits": "always (up_m <= 1.3)"}
    whole = verdict_cause_of(failed(waits), (), goal_s=2.0, passed=None, formulas=plain)
    assert whole is not None
    assert dict(whole.facts)["rule"] == "always (up_m <= 1.3)", "it has no seconds to explain"
    assert facts["broken part"] == "up_m <= 1.3"
    assert facts["crossed"] == "6.00 s after the goal was given"
    assert "where" not in facts


def test_a_limit_crossed_before_its_worst_has_both_times() -> None:
    high = OracleResult("altitude", "real", True, "FAIL", 2.5, (None, 2.3), "m", -0.2, 9.0, "")
    events = [LogEvent(8.0, "flag", "real", "oracle altitude · real too high", "altitude")]
    cause = verdict_cause_of(failed(high), events, goal_s=2.0, passed=None)
    assert cause is not None
    facts = dict(cause.facts)
    assert facts["crossed"] == "6.00 s after the goal was given"
    assert facts["worst"] == "7.00 s after the goal was given"


def test_a_twin_that_dropped_out_and_reported_oracles_are_noted() -> None:
    floor = OracleResult(
        "collision", "twin", False, "FAIL", 0.0, 0.0, "m", 0.0, 8.0, "touched cage.floor"
    )
    left = TwinResult("follow", 0.1, 0.2, 0.3, 1.0, DropOut(7.5, "the guard landed it"))
    notes = verdict_notes_of(replace(failed(floor), twin=left), at_s=8.0, goal_s=2.0)
    assert notes == (
        (
            "The twin dropped out 5.50 s after the goal was given, 0.50 s before the decisive "
            "event: the guard landed it"
        ),
        "Reported only, without a say in the verdict: collision of twin FAIL (touched cage.floor)",
    )
    passed = replace(failed(replace(floor, verdict="PASS")), verdict="PASS")
    assert verdict_notes_of(passed, at_s=None, goal_s=2.0) == ()


def test_a_failure_whose_evidence_is_unsound_says_so_first() -> None:
    unseen = LaterEvent("INVALID", "mixing of camera: the mixture never showed gate", 9.0)
    floor = OracleResult("clearance", "real", True, "FAIL", 0.0, 0.3, "m", -0.3, 8.0, "")
    notes = verdict_notes_of(replace(failed(floor), also=(unseen,)), at_s=8.0, goal_s=2.0)
    assert notes[0] == (
        "The fault may not be the autonomy's: INVALID too, for mixing of camera: the mixture never "
        "showed gate"
    )


def test_the_rule_of_a_largest_height_names_no_least_one() -> None:
    high = OracleResult("altitude", "real", True, "FAIL", 1.2, 1.0, "m", -0.2, 8.0, "")
    cause = verdict_cause_of(failed(high), (), goal_s=2.0, passed=None)
    assert cause is not None
    facts = dict(cause.facts)
    assert facts["rule"] == "real stays between min_m and max_m over the world's origin"
    assert facts["limit"] == "at most 1 m"


def test_a_missed_goal_says_how_near_the_vehicle_came() -> None:
    missed = OracleResult("reached", "real", True, "FAIL", None, 0.5, "m", None, None, "never")
    cause = verdict_cause_of(failed(missed), (), goal_s=2.0, passed=NearestPass(6.5, 1.234))
    assert cause is not None
    facts = dict(cause.facts)
    assert (facts["at worst"], facts["limit"]) == ("not measured", "0.5 m")
    assert facts["when"] == "at the end of the run"
    assert facts["nearest"] == (
        "1.23 m from the goal's first gate or position, 4.50 s after the goal was given"
    )
    own = replace(missed, name="through the ring")
    cause = verdict_cause_of(failed(own), (), goal_s=2.0, passed=None)
    assert cause is not None
    assert "rule" not in dict(cause.facts)


def test_a_video_is_shown_where_it_is_one(copied: Path) -> None:
    video = copied / FAILED / "mixed.mp4"
    video.write_bytes(b"\0\0\0\x1cftypiso5" + bytes(100))
    run = run_of(copied)
    assert (run.video, run.video_bytes) == ("mixed.mp4", 112)
    video.write_bytes(b"no video at all")
    run = run_of(copied)
    assert run.video is None
    assert run.problems == ("mixed.mp4 is not an MP4 file",)


@pytest.mark.parametrize(
    ("case", "told"),
    [
        ("one.b.c", ("goal.altitude_m: 2.0",)),
        ("b.c", ("goal.altitude_m: 2.0",)),
        ("one.late", ("retries: 3",)),
        ("one.d", ()),
    ],
)
def test_a_run_of_a_composition_tells_what_its_case_changes(
    case: str, told: tuple[str, ...]
) -> None:
    controls = {"late": {"set": {"retries": 3}}}
    campaign = {"cases": {"b.c": {"goal.altitude_m": 2.0}}, "controls": controls}
    facts = {"world": json.dumps(WORLD), "campaign": json.dumps(campaign)}
    assert recorded_world(facts, case, "sim").overrides == told
