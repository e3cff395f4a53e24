"""The values that the plots of a run show, and the limits drawn with them."""

import json
import math
from collections.abc import Mapping, Sequence

import pytest

from tests.orchestrator.report.recorded_campaign import WORLD, write_campaign
from tests.safety.oracles.oracle_rigs import build
from wil_campaign.foundation.files.documents import Data, parse_document
from wil_campaign.orchestrator.reading.judged_motion import JudgedMotion
from wil_campaign.orchestrator.reading.results_folder import read_campaign_documents
from wil_campaign.orchestrator.recording.judge_log_file import JudgeLogWriter
from wil_campaign.orchestrator.report.model import Plot, RunReport, VerdictCause
from wil_campaign.orchestrator.report.reading.closeup import JudgedFlight, closeup_of
from wil_campaign.orchestrator.report.reading.distances import TimedPose
from wil_campaign.orchestrator.report.reading.held_limits import HeldLimit, held_limits
from wil_campaign.orchestrator.report.reading.run_reader import read_run
from wil_campaign.orchestrator.report.reading.sight_decoding import ImageSize
from wil_campaign.orchestrator.report.reading.signal_plots import motion_plots
from wil_campaign.orchestrator.report.reading.world_facts import recorded_body
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample, StageSample
from wil_campaign.safety.oracles.oracle import OracleContext
from wil_campaign.vehicles.embedded.physics.contact_world import BODY
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.parts import BoxShape
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import box_shape, room_shape
from wil_campaign.worlds.world_file.world import World

STAGES = {"takeoff": 0.0, "at_height": 1.0, "goal": 1.0, "land": 9.0, "landed": 10.0}


def plot_of(
    title: str,
    poses: Mapping[str, Sequence[TimedPose]],
    *,
    flight: JudgedFlight | None = None,
    limits: Sequence[HeldLimit] = (),
) -> Plot:
    nothing = JudgedFlight(JudgedMotion(), Scene(), {})
    found = motion_plots(poses, flight or nothing, "real", limits)
    return next(one for one in found if one.title == title)


def hovering(up_m: float, seconds: float = 10.0) -> list[TimedPose]:
    return [(k / 50, Pose.of(0.0, 0.0, up_m)) for k in range(round(seconds * 50) + 1)]


def test_the_limits_of_the_twins_oracles_are_not_drawn_for_the_real_vehicle() -> None:
    oracles: dict[str, Data] = {
        "altitude": {"max_m": 3.0},
        "low": {"use": "altitude", "max_m": 1.0, "vehicle": "twin"},
        "lower": {"stl": "always (up_m <= 0.5)", "vehicle": "twin"},
    }
    limits = held_limits(oracles, STAGES, 10.0, "real")
    poses = {"real": hovering(2.0), "twin": hovering(0.4)}
    height = plot_of("height", poses, limits=limits)
    assert height.judged == "real"
    assert [one.value for one in height.limits] == [3.0]
    assert [(one.oracle, one.vehicle) for one in limits] == [
        ("altitude", "real"),
        ("low", "twin"),
        ("lower", "twin"),
    ]


def fence(up_m: float) -> Fence:
    return Fence.box(north_m=(-9.0, 9.0), east_m=(-9.0, 9.0), up_m=(-9.0, up_m))


def test_a_fence_that_was_changed_in_flight_counts_from_then_on() -> None:
    fences = {"real": [(-math.inf, fence(1.8)), (4.0, fence(5.0))], "twin": [(6.0, fence(2.5))]}
    flight = JudgedFlight(JudgedMotion(), Scene(), fences)
    poses = {"real": hovering(2.0), "twin": hovering(2.0)}
    plot = plot_of("margin to the fence", poses, flight=flight)
    real, twin = (dict(curve.points) for curve in plot.curves)
    assert {round(margin, 6) for t_s, margin in real.items() if t_s < 4.0} == {-0.2}
    assert {round(margin, 6) for t_s, margin in real.items() if t_s >= 4.0} == {3.0}
    # What its fence was before is not recorded.
    assert min(twin) >= 6.0
    assert "in force at each time" in plot.note


def test_the_floor_of_a_fence_counts_between_at_height_and_land_as_for_the_oracle() -> None:
    """On the ground the plot was lower than the least that the oracle had measured."""
    low = Fence.box(north_m=(-9.0, 9.0), east_m=(-9.0, 9.0), up_m=(1.5, 9.0))
    motion = JudgedMotion(stages={"at_height": 2.0, "land": 5.0})
    flight = JudgedFlight(motion, Scene(), {"real": [(-math.inf, low)]})
    plot = plot_of("margin to the fence", {"real": hovering(2.0)}, flight=flight)
    margins = dict(plot.curves[0].points)
    in_flight = {round(one, 6) for t_s, one in margins.items() if 2.0 <= t_s < 5.0}
    near_ground = {round(one, 6) for t_s, one in margins.items() if not 2.0 <= t_s < 5.0}
    assert (in_flight, near_ground) == ({0.5}, {7.0})


WALL = Scene((SceneObject(1, "wall", box_shape((0.2, 6.0, 3.0)), Pose.of(5.0, 0.0, 1.5)),))


def clearance_judged(poses: Sequence[TimedPose], scene: Scene, body: BoxShape) -> float:
    """Return the least clearance of a flight as the oracle judges it."""
    probe = ClearanceProbe(scene, body)
    context = OracleContext(mode="wil", subject="real", vehicle="real", probe=probe)
    judge = build("clearance", context=context, min_m=1.0)
    judge.on_stage(StageSample(0.0, "takeoff"))
    for t_s, pose in poses:
        judge.on_pose(PoseSample(t_s, "real", pose, (0.0, 0.0, 0.0)))
    actual = judge.result(poses[-1][0]).actual
    assert actual is not None
    return actual


def test_clearance_is_that_of_the_body_by_which_the_vehicle_was_judged() -> None:
    poses = [(k / 50, Pose.of(4.0 - abs(k / 50 - 2.0), 0.0, 1.2)) for k in range(201)]
    campaign: dict[str, Data] = {"vehicles": {"real": {"body": {"width_m": 0.5, "height_m": 0.2}}}}
    flight = JudgedFlight(JudgedMotion(), WALL, {}, campaign)
    (curve,) = plot_of("clearance", {"real": poses}, flight=flight).curves
    shown_m = min(value for _, value in curve.points)
    judged_m = clearance_judged(poses, WALL, recorded_body(campaign, "real"))
    assert shown_m == pytest.approx(judged_m, abs=1e-6)
    assert judged_m == pytest.approx(0.65)


ROOM = Scene(
    (
        SceneObject(
            1, "hall", room_shape(size_north_m=12, size_east_m=5, height_m=3), Pose.of(0, 0, 0)
        ),
    )
)


def test_the_floor_that_a_clearance_was_judged_by_is_in_its_plot() -> None:
    """The plot showed 1.5 m to the wall, above the limit, where 0.66 m to the floor failed."""
    poses = [(k / 50, Pose.of(0.0, 0.0, 0.7 if 100 < k < 450 else 0.05)) for k in range(501)]
    limits = held_limits({"clearance": {"min_m": 1.0}}, STAGES, 10.0, "real")
    stages = {"takeoff": 0.0, "at_height": 3.0, "land": 8.0}
    flight = JudgedFlight(JudgedMotion(stages=stages), ROOM, {})
    (curve,) = plot_of("clearance", {"real": poses}, flight=flight, limits=limits).curves
    in_flight = [value for t_s, value in curve.points if 3.0 < t_s < 8.0]
    assert in_flight == [pytest.approx(0.65)] * len(in_flight)
    # Before at_height and from land on the ground is no obstacle.
    others = [value for t_s, value in curve.points if t_s < 3.0 or t_s >= 8.0]
    assert min(others) == pytest.approx(2.0)


def test_a_floor_that_came_too_near_has_a_closeup() -> None:
    poses = [(k / 50, Pose.of(0.0, 0.0, 0.7)) for k in range(501)]
    velocities = {"real": [(0.0, 0.0, 0.0)] * len(poses)}
    limits = held_limits({"clearance": {"min_m": 1.0}}, STAGES, 10.0, "real")
    motion = JudgedMotion({"real": poses}, velocities, stages=STAGES)
    worst = OracleResult("clearance", "real", True, "FAIL", 0.65, 1.0, "m", -0.35, 5.0, "")
    cause = VerdictCause("clearance of real", "", (), 5.0)
    found = closeup_of(cause, worst, limits, JudgedFlight(motion, ROOM, {}))
    assert found is not None
    assert found.worst[1] == pytest.approx(0.65)


@pytest.mark.parametrize(
    "vehicles", [{}, {"real": {}}, {"real": {"body": {"width_m": "wide"}}}, {"real": 5}, []]
)
def test_a_body_that_is_not_recorded_is_that_of_the_embedded_vehicle(vehicles: Data) -> None:
    assert recorded_body({"vehicles": vehicles}, "real") == BODY


def circling(t_s: float, up_m: float) -> Pose:
    """Round the gate in 4 s; 1.2 m higher for 0.2 s."""
    turn_rad = t_s * math.tau / 4.0
    higher_m = 1.2 if 60.97 < t_s < 61.17 else 0.0
    return Pose.of(2.0 + 1.6 * math.cos(turn_rad), 1.6 * math.sin(turn_rad), up_m + higher_m)


@pytest.fixture(scope="module")
def long_flight(tmp_path_factory: pytest.TempPathFactory) -> RunReport:
    """Two minutes round the gate; the twin 0.5 m lower, and never higher."""
    folder = write_campaign(tmp_path_factory.mktemp("long") / "gate")
    path = folder / "large/wil/1/judged.msgpack"
    path.unlink()
    with JudgeLogWriter(path=path) as judged:
        for k in range(6000):
            t_s = k / 50
            judged.write(PoseSample(t_s, "real", circling(t_s, 1.2), (0.0, 0.0, 0.0)))
            lower = circling(t_s % 4.0, 0.7)
            judged.write(PoseSample(t_s, "twin", lower, (0.0, 0.0, 0.0)))
    entry = next(
        one for one in read_campaign_documents(folder).entries if one.name == "large/wil/1"
    )
    return read_run(folder, entry, ImageSize.for_runs(1))


def values_of(run: RunReport, title: str, subject: str) -> list[float]:
    plot = next(one for one in run.plots if one.title == title)
    curve = next(one for one in plot.curves if one.subject == subject)
    assert len(curve.points) <= 500
    return [value for _, value in curve.points]


def test_a_long_flight_shows_what_lasted_a_fifth_of_a_second(long_flight: RunReport) -> None:
    assert max(values_of(long_flight, "height", "real")) == pytest.approx(2.4)
    assert max(values_of(long_flight, "height", "twin")) == pytest.approx(0.7)
    assert max(values_of(long_flight, "real to twin", "pair")) == pytest.approx(1.7)
    assert min(values_of(long_flight, "real to twin", "pair")) == pytest.approx(0.5)
    assert min(values_of(long_flight, "margin to the fence", "real")) == pytest.approx(-0.4)


def test_a_long_flight_shows_the_clearance_that_was_judged(long_flight: RunReport) -> None:
    poses = [(k / 50, circling(k / 50, 1.2)) for k in range(25, 6000)]
    document = parse_document(json.dumps(WORLD).encode(), name="world")
    judged_m = clearance_judged(poses, World.parse(document).scene("wil", "Wv"), BODY)
    assert min(values_of(long_flight, "clearance", "real")) == pytest.approx(judged_m, abs=0.003)


def test_the_distance_of_the_pair_is_not_known_while_the_twin_has_no_poses() -> None:
    real, twin = hovering(2.0), hovering(1.5)
    twin = [(t_s + 0.01, pose) for t_s, pose in twin if not 4.0 < t_s < 6.0]
    apart = plot_of("real to twin", {"real": real, "twin": twin}).curves[0]
    assert {round(value, 6) for _, value in apart.points} == {0.5}
    before, after = apart.stretches
    assert before[-1][0] == pytest.approx(4.0, abs=0.05)
    assert after[0][0] == pytest.approx(6.02, abs=0.05)
