"""A pose is judged in the window in which it was taken, however late it arrives."""

from typing import Any

import pytest

from tests.safety.oracles.oracle_rigs import FENCE
from wil_campaign.safety.evaluation.judge import Judge, OracleUse, build_oracles
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.samples import PoseSample, Stage, StageSample
from wil_campaign.safety.oracles.oracle import OracleContext
from wil_campaign.safety.oracles.registry import oracle_kinds
from wil_campaign.worlds.clearance.clearance import BoxShape, ClearanceProbe
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import room_shape

BODY = BoxShape((0.15, 0.15, 0.05))
CAGE = Scene((SceneObject(1, "cage", room_shape(8, 8, 5), Pose.of(0, 0, 0)),))
STAGES: tuple[tuple[float, Stage], ...] = (
    *((1.0, "takeoff"), (3.0, "at_height"), (5.0, "goal")),
    *((8.0, "done"), (9.0, "land"), (12.0, "landed"), (14.0, "end")),
)
BOX = {"north_m": (-2, 2), "east_m": (-2, 2), "up_m": (-1, 3)}
LATE_S = (0.3, 0.75, 1.4)


def up_m(t_s: float) -> float:
    """Return the height of the flight: 2.5 m just before the goal, 3.5 m just before the land."""
    high = ((4.8, 5.0, 2.5), (8.8, 9.0, 3.5))
    found = (up_m for begin_s, end_s, up_m in high if begin_s <= t_s < end_s)
    return 0.05 if t_s < 2.4 or t_s >= 10.0 else next(found, 1.2)


def judged(late_s: float, kind: str, **parameters: Any) -> tuple[OracleResult, list[Flag]]:
    """Return result and flags of an oracle where each pose arrives so late."""
    use = OracleUse(kind, kind, oracle_kinds()[kind].parameters.model_validate(parameters))
    context = OracleContext(
        mode="sim",
        subject="twin",
        vehicle="twin",
        probe=ClearanceProbe(CAGE, BODY),
        things=CAGE.names,
        probe_of=lambda _: ClearanceProbe(CAGE, BODY, within_m=1e6),
        target_ned_m=(0.0, 0.0, -3.5),
        fence=FENCE,
    )
    judge = Judge(build_oracles([use], {"twin": context}, collision_always=False))
    arriving: list[tuple[float, StageSample | PoseSample]]
    arriving = [(t_s, StageSample(t_s, stage)) for t_s, stage in STAGES]
    for tick in range(120):
        t_s = 0.05 + 0.1 * tick
        speed: Vec3 = (0.0, 0.0, -2.0 if up_m(t_s) > 2.0 else 0.0)
        pose = Pose((0.0, 0.0, -up_m(t_s)))
        arriving.append((t_s + late_s, PoseSample(t_s, "twin", pose, speed)))
    flags: list[Flag] = []
    for _, sample in sorted(arriving, key=lambda one: one[0]):
        if isinstance(sample, StageSample):
            flags += judge.stage(sample)
        else:
            flags += judge.pose(sample)
    return judge.results(14.0)[0], flags


@pytest.mark.parametrize("late_s", [0.0, *LATE_S])
@pytest.mark.parametrize(
    ("kind", "parameters", "verdict"),
    [
        ("altitude", {"max_m": 2, "from": "goal", "to": "done"}, "PASS"),
        ("altitude", {"max_m": 3, "from": "goal", "to": "land"}, "FAIL"),
        ("altitude", {"min_m": 1.0}, "PASS"),
        ("speed", {"max_m_s": 1, "from": "goal", "to": "land"}, "FAIL"),
        ("geofence", {"from": "goal", "to": "done"}, "PASS"),
        ("geofence", {"from": "goal", "to": "land"}, "FAIL"),
        ("area", {"keep": {"box": BOX}, "to": "goal"}, "PASS"),
        ("area", {"keep": {"box": BOX}, "to": "land"}, "FAIL"),
        ("distance", {"object": "cage", "min_m": 1.6, "from": "goal", "to": "land"}, "FAIL"),
        ("reached_position", {"tolerance_m": 0.1, "to": "land"}, "PASS"),
        ("reached_position", {"tolerance_m": 0.1, "to": "done"}, "FAIL"),
        ("collision", {}, "PASS"),
        ("stl", {"stl": "always (up_m < 3)"}, "FAIL"),
    ],
)
def test_how_late_poses_arrive_changes_no_verdict(
    kind: str, parameters: dict[str, Any], verdict: str, late_s: float
) -> None:
    in_time, flags = judged(0.0, kind, **parameters)
    late, late_flags = judged(late_s, kind, **parameters)
    assert in_time.verdict == verdict
    assert late == in_time
    assert late_flags == flags
