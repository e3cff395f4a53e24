"""What a run's positions have to show: one that touches something never passes for want of it."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.faults.motion_capture import Alter, captured
from tests.faults.relay import Change, Position, frozen, relay, stopped
from tests.orchestrator.conftest import BRIEF, FEW_PICTURES, ROOT, NoCommands, vehicles_on
from tests.orchestrator.wall import write_wall
from wil_campaign.campaigns.expansion.expansion import ExpansionOptions, RunPlan, load_campaign
from wil_campaign.foundation.files.document_writer import to_json, write_atomically
from wil_campaign.orchestrator.campaign.reevaluation import judge_run_again
from wil_campaign.orchestrator.run.flight.run import Disturb, fly_one_run
from wil_campaign.orchestrator.run.judging.run_evidence import signal_terms
from wil_campaign.orchestrator.run.judging.run_oracles import build_judge
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.orchestrator.state.run_state import Stage
from wil_campaign.vehicles.mavlink.framing import MavlinkFrame
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose

EXTENDED_SYS_STATE: int = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE


@pytest.fixture
def plan(tmp_path: Path) -> RunPlan:
    return load_campaign(write_wall(tmp_path), ExpansionOptions()).runs[0]


def flown(plan: RunPlan, folder: Path, disturb: Disturb | None = None) -> RunResult:
    folder.mkdir()
    order = RunOrder(plan=plan, folder=folder, clock="virtual")
    with vehicles_on():
        return fly_one_run(RunSetup.of(order), lambda _: None, NoCommands(), disturb=disturb)


def test_the_wall_is_touched(plan: RunPlan, tmp_path: Path) -> None:
    result = flown(plan, tmp_path / "run")
    assert (result.verdict, result.reason) == ("FAIL", "twin touched wall.box")
    found = [(one.signal, one.verdict) for one in result.evidence]
    assert found == [("pose", "PASS"), ("heartbeat", "PASS"), ("landed_state", "PASS")]
    compared_with = result.evidence[0].compared_with
    assert compared_with[:2] == ("mocap", "truth")
    assert {"gyroscopes", "magnetometer"} <= set(compared_with)


def test_positions_that_freeze_before_a_wall_prove_nothing(plan: RunPlan, tmp_path: Path) -> None:
    disturb = relay("twin", frozen(), stage="goal", after_s=1.5)
    result = flown(plan, tmp_path / "run", disturb)
    assert result.verdict == "INVALID"
    assert result.reason.startswith("pose of twin from mavlink: it repeats one position for ")
    pose = result.evidence[0]
    assert (pose.verdict, pose.required, pose.reason) == ("INVALID", True, result.reason)


def test_positions_that_stop_before_a_wall_prove_nothing(plan: RunPlan, tmp_path: Path) -> None:
    disturb = relay("twin", stopped(), stage="goal", after_s=1.5)
    result = flown(plan, tmp_path / "run", disturb)
    assert result.verdict == "INVALID"
    assert result.reason.startswith("pose of twin from mavlink: no sample for ")


TABLE = (
    "world.objects.wall.shape={box: {size_m: [3, 3, 0.6]}}",
    "world.objects.wall.pose={north_m: 6.5, east_m: 0, up_m: 0.3}",
)
"""Where it lands."""


@pytest.mark.parametrize("change", [frozen, stopped])
def test_a_table_touched_while_landing_unseen_is_no_pass_and_judged_again_alike(
    tmp_path: Path, change: Callable[[], Change]
) -> None:
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=TABLE)).runs[0]
    folder = tmp_path / "run"
    result = flown(plan, folder, relay("twin", change(), stage="land", after_s=0.2))
    assert result.verdict == "INVALID"
    write_atomically(folder / "result.json", to_json(result))
    assert judge_run_again(plan, folder).now == result


def silent(_: PoseReading) -> tuple[()]:
    return ()


def repeated() -> Alter:
    first: list[PoseReading] = []

    def alter(reading: PoseReading) -> tuple[PoseReading]:
        first.append(reading)
        return (replace(reading, pose=first[0].pose),)

    return alter


def biased(reading: PoseReading) -> tuple[PoseReading]:
    north_m, east_m, down_m = reading.pose.position_ned_m
    moved = Pose((north_m, east_m + 0.3, down_m), reading.pose.q_wxyz)
    return (replace(reading, pose=moved),)


@pytest.mark.parametrize(
    ("alter", "stage", "said"),
    [
        (silent, "takeoff", "no sample"),
        (repeated(), "land", "from the position by truth"),
        (biased, "goal", "from the position by truth"),
    ],
)
def test_motion_capture_counts_from_takeoff_to_landed(
    fly_run: Callable[..., tuple[RunResult, Path]], alter: Alter, stage: Stage, said: str
) -> None:
    sets = FEW_PICTURES if stage == "goal" else BRIEF
    disturb = captured("real", alter, stage=stage, after_s=0.3)
    result, _ = fly_run(disturb=disturb, sets=sets, boots=stage == "goal")
    assert result.verdict == "INVALID"
    assert result.reason.startswith("pose of real from mocap: ")
    assert said in result.reason


@pytest.mark.parametrize("source", ["simulator", "mavlink"])
def test_poses_that_stop_are_named_by_their_source(
    fly_run: Callable[..., tuple[RunResult, Path]], source: str
) -> None:
    """What the control `positions-stop` of the shipped campaigns expects as its cause."""
    stops = "faults.real.pose_source={stop: {on: goal, after_s: 0.2}}"
    sets = (*BRIEF, f"vehicles.real.pose_source={source}", stops)
    result, _ = fly_run(sets=sets)
    assert result.verdict == "INVALID"
    assert f"pose of real from {source}" in result.reason


def test_a_report_that_an_oracle_rests_on_must_not_end(plan: RunPlan, tmp_path: Path) -> None:
    change = relay("twin", stopped(), stage="takeoff", message_ids=(EXTENDED_SYS_STATE,))
    result = flown(plan, tmp_path / "run", change)
    reasons = (result.reason, *(late.reason for late in result.also))
    assert any("landed_state of twin" in reason for reason in reasons)


FREE = "world.objects.wall.pose.north_m=30"
DARK = "links.twin={blackouts: [{on: goal, after_s: 1, for_s: 0.3}]}"


@pytest.mark.parametrize(
    ("sets", "verdict", "limit_s"),
    [
        ((FREE,), "PASS", 0.062),
        ((FREE, DARK, "vehicles.twin.telemetry.max_gap_s=0.25"), "INVALID", 0.25),
        ((FREE, DARK, "vehicles.twin.telemetry.max_gap_s=0.4"), "PASS", 0.4),
        ((FREE, "vehicles.twin.telemetry.rate_hz=10"), "PASS", 0.302),
    ],
)
def test_a_radio_is_held_to_its_rate_or_to_what_the_campaign_says(
    tmp_path: Path, sets: tuple[str, ...], verdict: str, limit_s: float
) -> None:
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    result = flown(plan, tmp_path / "run")
    pose = result.evidence[0]
    assert (result.verdict, pose.verdict) == (verdict, verdict)
    assert pose.limit_s == pytest.approx(limit_s)
    if DARK in sets:
        assert 0.3 <= pose.largest_gap_s < 0.4


def stepped(offset_m: float) -> Change:
    """Return a change that puts the estimate this far to the north, at once and for good."""

    def change(frame: MavlinkFrame) -> Iterable[tuple[float, bytes]]:
        now = Position.of(frame)
        north_m, *others = now.values
        yield 0.0, Position(now.boot_ms, (north_m + offset_m, *others)).in_place_of(frame)

    return change


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_vehicle_is_judged_by_its_simulator_whatever_its_estimate_does(
    tmp_path: Path, autopilot: str
) -> None:
    sets = ("vehicles.twin.pose_source=simulator", f"vehicles.twin.autopilot={autopilot}")
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    disturb = relay("twin", stepped(1.5), stage="goal", after_s=0.5)
    result = flown(plan, tmp_path / "run", disturb)
    assert (result.verdict, result.reason) == ("FAIL", "twin touched wall.box")
    pose = result.evidence[0]
    assert (pose.signal, pose.source, pose.verdict) == ("pose", "simulator", "PASS")
    assert set(pose.compared_with) == {"mocap", "mavlink", "truth"}


def test_an_estimate_in_another_place_altogether_is_no_evidence(tmp_path: Path) -> None:
    sets = ("vehicles.twin.pose_source=simulator",)
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    disturb = relay("twin", stepped(9.0), stage="goal", after_s=0.5)
    result = flown(plan, tmp_path / "run", disturb)
    assert result.verdict == "INVALID"
    assert result.reason.startswith("pose of twin from simulator: it is 8.9")
    assert "from the position by mavlink" in result.reason


@pytest.mark.parametrize(("source", "velocity_m_s"), [("simulator", None), ("mocap", 0.1)])
def test_an_estimate_beside_a_simulator_is_not_held_to_its_velocity(
    tmp_path: Path, source: str, velocity_m_s: float | None
) -> None:
    sets = (f"vehicles.twin.pose_source={source}",)
    plan = load_campaign(write_wall(tmp_path), ExpansionOptions(sets=sets)).runs[0]
    setup = RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual"))
    pose = next(iter(signal_terms(setup, ())))
    assert (pose.source, pose.on_grid) == (source, source == "simulator")
    assert pose.references["mavlink"].position_m == 1.0
    assert pose.references["mavlink"].velocity_m_s == velocity_m_s
    signals = [signal_term.signal for signal_term in signal_terms(setup, ())]
    assert signals == (["pose", "velocity"] if source == "simulator" else ["pose"])


REPORTED = """{
    battery: {min_percent: 20, from: goal},
    modes: {required: false},
    collision: {},
}"""


def test_reports_are_expected_where_an_oracle_judges_them_and_as_long(tmp_path: Path) -> None:
    plan = load_campaign(
        write_wall(tmp_path), ExpansionOptions(sets=(f"oracles={REPORTED}",))
    ).runs[0]
    setup = RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual"))
    pose, *reports = signal_terms(setup, build_judge(setup, {}).oracles)
    assert (pose.signal, pose.required) == ("pose", True)
    assert [
        (report.signal, report.required, report.window.first, report.window.last)
        for report in reports
    ] == [
        ("heartbeat", False, "goal", "land"),
        ("battery", True, "goal", "landed"),
    ]


def test_a_required_oracle_needs_the_poses_of_the_vehicles_that_it_watches_alone(
    tmp_path: Path,
) -> None:
    options = ExpansionOptions(cases=("large",), modes=("wil",))
    plan = load_campaign(ROOT / "campaigns" / "gate.yaml", options).runs[0]
    setup = RunSetup.of(RunOrder(plan=plan, folder=tmp_path, clock="virtual"))
    terms = signal_terms(setup, build_judge(setup, {}).oracles)
    needed = {term.vehicle: term.required for term in terms if term.signal == "pose"}
    assert needed == {"real": True, "twin": False}
