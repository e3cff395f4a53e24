import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from safety.geofence import Fence
from safety.oracles import Oracle, OracleContext, OracleError, registry
from safety.oracles.base import Parameters, oracle
from safety.oracles.gates import SceneGate, gates_of
from safety.results import Flag, OracleResult
from safety.samples import HeardSample, PoseSample, Stage, StageSample, StateSample
from vehicles.autopilots.base import Mode
from worlds.clearance import BoxShape, Clearance, ClearanceProbe
from worlds.frames import Pose, Vec3
from worlds.motion import Motion, StartOn, Waypoint
from worlds.scene import Scene, SceneObject
from worlds.shapes import gate, room

FENCE = Fence.box(north_m=(-1, 4), east_m=(-2, 2), up_m=(-0.5, 2.5))


@dataclass(frozen=True)
class Near:
    object_name: str
    part_name: str
    clearance_m: float
    at_s: float
    is_floor: bool


@dataclass
class ScriptedProbe:
    """Answers each sweep with what the script has for the time of its end."""

    script: dict[float, list[tuple[str, str, float]]]
    asked: list[tuple[float, float]] = field(default_factory=list)

    def sweep(
        self,
        pose_0: Pose,
        t_0_s: float,
        pose_1: Pose,
        t_1_s: float,
        events: Mapping[str, float],
        *,
        below_m: Mapping[tuple[str, bool], float] | None = None,
    ) -> tuple[Near, ...]:
        self.asked.append((t_0_s, t_1_s))
        near = [Near(*each, t_1_s, each[1] == "floor") for each in self.script.get(t_1_s, [])]
        limits = below_m or {}
        return tuple(
            n for n in near if n.clearance_m < limits.get((n.object_name, n.is_floor), math.inf)
        )


def build(kind: str, *, context: OracleContext | None = None, **parameters: object) -> Oracle:
    spec = registry[kind]
    model = spec.parameters.model_validate(parameters)
    used = context or OracleContext(mode="wil", subject="real", vehicle="real", fence=FENCE)
    return spec.factory(kind, model.required, model, used)


def pose(t_s: float, at: Vec3 = (0, 0, -1), velocity: Vec3 = (0, 0, 0)) -> PoseSample:
    return PoseSample(t_s, "real", Pose(at), velocity)


def state(
    t_s: float, *, armed: bool = True, landed: bool | None = False, fault: str | None = None
) -> StateSample:
    return StateSample(t_s, "real", armed, Mode.GUIDED, "OFFBOARD", landed, fault)


def stage(oracle: Oracle, **times: float) -> list[Flag]:
    flags: list[Flag] = []
    for name, t_s in times.items():
        flags += oracle.on_stage(StageSample(t_s, stage_of(name)))
    return flags


def stage_of(name: str) -> Stage:
    names: dict[str, Stage] = {
        "takeoff": "takeoff",
        "at_height": "at_height",
        "goal": "goal",
        "done": "done",
        "land": "land",
        "landed": "landed",
        "end": "end",
    }
    return names[name]


def numbers(result: OracleResult) -> tuple[object, ...]:
    return (result.verdict, result.actual, result.limit, result.margin, result.at_s)


def contact(script: dict[float, list[tuple[str, str, float]]]) -> tuple[Oracle, ScriptedProbe]:
    probe = ScriptedProbe(script)
    context = OracleContext(mode="wil", subject="real", vehicle="real", probe=probe)
    return build("collision", context=context), probe


def test_registry_names_and_describes_every_oracle() -> None:
    assert set(registry) == {
        "collision", "clearance", "reached", "reached_position", "time_limit", "geofence",
        "altitude", "vehicle_fault", "link", "landed", "twin_divergence",
    }  # fmt: skip
    assert all(spec.summary and spec.name == name for name, spec in registry.items())


def test_a_name_cannot_be_registered_twice() -> None:
    with pytest.raises(ValueError, match="twice"):
        oracle("collision", "again", Parameters)(registry["collision"].factory)


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("collision", {"colour": "red"}),
        ("clearance", {}),
        ("clearance", {"min_m": 0}),
        ("clearance", {"min_m": math.nan}),
        ("time_limit", {"limit_s": -1}),
        ("altitude", {}),
        ("altitude", {"min_m": 3, "max_m": 2}),
        ("link", {"max_gap_s": math.inf}),
        ("landed", {"vehicle": "both"}),
        ("reached", {"direction": "up"}),
    ],
)
def test_wrong_parameters_are_refused(kind: str, parameters: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        registry[kind].parameters.model_validate(parameters)


NEVER_FED = [
    ("collision", {}),
    ("clearance", {"min_m": 0.1}),
    ("reached", {}),
    ("reached_position", {"tolerance_m": 0.1}),
    ("time_limit", {"limit_s": 1}),
    ("geofence", {}),
    ("altitude", {"max_m": 2}),
    ("vehicle_fault", {}),
    ("link", {"max_gap_s": 1}),
    ("landed", {}),
    ("twin_divergence", {}),
]


@pytest.mark.parametrize(("kind", "parameters"), NEVER_FED)
def test_an_oracle_that_saw_nothing_fails_and_says_so(
    kind: str, parameters: dict[str, object]
) -> None:
    context = OracleContext(
        mode="wil",
        subject="real",
        vehicle="real",
        probe=ScriptedProbe({}),
        gates=gates_of(SCENE),
        route=("gate",),
        target_ned_m=(1, 0, -1),
        fence=FENCE,
    )
    result = build(kind, context=context, **parameters).result(9.0)
    assert (result.verdict, result.actual, result.margin) == ("FAIL", None, None)
    assert result.detail


def test_every_oracle_is_in_the_test_of_seeing_nothing() -> None:
    assert {kind for kind, _ in NEVER_FED} == set(registry)


# Contact


def test_contact_is_flagged_once_per_episode_and_named() -> None:
    touching = {
        t: [("gate", "left", c), ("wall", "", 2.0)]
        for t, c in [(3.0, 0.1), (4.0, -0.02), (5.0, -0.05), (6.0, 0.01), (7.0, 0.0), (8.0, 0.5)]
    }
    touching[9.0] = [("gate", "top", 0.0)]
    judge, _ = contact(touching)
    stage(judge, takeoff=1.0, at_height=2.0)
    flags = [
        flag for t_s in (3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0) for flag in judge.on_pose(pose(t_s))
    ]
    assert [(f.t_s, f.text, f.decisive) for f in flags] == [
        (4.0, "real touched gate.left", True),
        (9.0, "real touched gate.top", True),
    ]
    result = judge.result(10.0)
    assert numbers(result) == ("FAIL", 0.0, 0.0, 0.0, 5.0)
    assert result.detail == "touched gate.left"


def test_a_contact_that_ends_out_of_sight_is_a_new_one_next_time() -> None:
    judge, _ = contact({3.0: [("post", "", 0.0)], 5.0: [("post", "", 0.0)]})
    stage(judge, takeoff=1.0, at_height=2.0)
    flags = [f for t_s in (3.0, 4.0, 5.0) for f in judge.on_pose(pose(t_s))]
    assert [f.t_s for f in flags] == [3.0, 5.0]


def test_no_contact_reports_the_smallest_clearance() -> None:
    judge, probe = contact({2.0: [("gate", "left", 0.3)], 3.0: [("gate", "right", 0.2)]})
    judge.on_pose(pose(0.0))
    stage(judge, takeoff=1.0)
    for t_s in (2.0, 3.0, 4.0):
        judge.on_pose(pose(t_s))
    result = judge.result(5.0)
    assert numbers(result) == ("PASS", 0.2, 0.0, 0.2, 3.0)
    assert result.detail == "closest to gate.right"
    assert probe.asked == [(0.0, 2.0), (2.0, 3.0), (3.0, 4.0)]


def test_the_ground_counts_between_at_height_and_land_only() -> None:
    floor = [("cage", "floor", 0.0)]
    judge, _ = contact(dict.fromkeys((2.0, 4.0, 6.0), floor))
    stage(judge, takeoff=1.0)
    assert not judge.on_pose(pose(2.0))
    stage(judge, at_height=3.0)
    assert [f.text for f in judge.on_pose(pose(4.0))] == ["real touched cage.floor"]
    stage(judge, land=5.0)
    assert not judge.on_pose(pose(6.0))


def test_a_wall_counts_while_landing_too() -> None:
    judge, _ = contact({4.0: [("cage", "north wall", 0.0)]})
    stage(judge, takeoff=1.0, at_height=2.0, land=3.0)
    assert judge.on_pose(pose(4.0))


def test_named_ground_and_excluded_objects_do_not_count() -> None:
    script = {2.0: [("pad", "", 0.0), ("net", "west", 0.0)], 4.0: [("net", "west", 0.0)]}
    context = OracleContext(mode="wil", subject="real", vehicle="real", probe=ScriptedProbe(script))
    judge = build("collision", context=context, ground=("pad",), exclude=("net",))
    stage(judge, takeoff=1.0)
    assert not judge.on_pose(pose(2.0))
    stage(judge, at_height=3.0)
    assert not judge.on_pose(pose(4.0))
    assert judge.result(5.0).verdict == "PASS"


def test_nothing_counts_before_takeoff_and_after_landing() -> None:
    judge, probe = contact({0.5: [("gate", "left", 0.0)], 9.0: [("gate", "left", 0.0)]})
    judge.on_pose(pose(0.5))
    stage(judge, takeoff=1.0, at_height=2.0, land=3.0, landed=4.0)
    judge.on_pose(pose(9.0))
    assert not probe.asked
    assert judge.result(9.0).detail == "no pose seen"


@pytest.mark.parametrize(("clearance_m", "verdict"), [(0.1, "PASS"), (0.0999, "FAIL")])
def test_clearance_holds_a_limit(clearance_m: float, verdict: str) -> None:
    probe = ScriptedProbe({2.0: [("gate", "left", clearance_m)]})
    context = OracleContext(mode="sim", subject="twin", vehicle="twin", probe=probe)
    judge = build("clearance", context=context, min_m=0.1)
    stage(judge, takeoff=1.0)
    flags = judge.on_pose(PoseSample(2.0, "twin", Pose((0, 0, -1)), (0, 0, 0)))
    assert bool(flags) == (verdict == "FAIL")
    result = judge.result(3.0)
    assert result.verdict == verdict
    assert result.margin == pytest.approx(clearance_m - 0.1)


def test_an_empty_world_is_passed_and_said_to_be() -> None:
    judge, _ = contact({})
    stage(judge, takeoff=1.0)
    judge.on_pose(pose(2.0))
    assert numbers(judge.result(3.0)) == ("PASS", None, 0.0, None, None)


# Reached

SCENE = Scene(
    (
        SceneObject(1, "gate", gate("square", 1.0, 0.1), Pose.of(3, 0, 1)),
        SceneObject(2, "ring", gate("ring", 1.0, 0.1), Pose.of(6, 0, 1, yaw_rad=math.pi)),
    )
)


def reached(route: tuple[str, ...] = ("gate",), **parameters: object) -> Oracle:
    context = OracleContext(
        mode="wil", subject="real", vehicle="real", gates=gates_of(SCENE), route=route
    )
    return build("reached", context=context, **parameters)


def fly(judge: Oracle, *points: Vec3, start_s: float = 3.0) -> list[str]:
    flags: list[Flag] = []
    for i, point in enumerate(points):
        flags += judge.on_pose(pose(start_s + i, point))
    return [flag.text for flag in flags]


def test_through_a_gate_reports_offset_and_time() -> None:
    judge = reached()
    stage(judge, takeoff=0.0, at_height=1.0, goal=2.0)
    assert fly(judge, (0, 0, -1), (2.5, 0.2, -1), (3.5, 0.2, -1.3)) == ["real flew through gate"]
    result = judge.result(9.0)
    assert result.verdict == "PASS"
    assert result.actual == pytest.approx(0.2)
    assert result.limit == pytest.approx(0.5)
    assert result.margin == pytest.approx(0.3)
    assert result.at_s == pytest.approx(4.5)


def test_beside_the_gate_is_not_through_and_the_way_back_does_not_count() -> None:
    judge = reached()
    stage(judge, goal=2.0)
    assert fly(judge, (2, 0.8, -1), (4, 0.8, -1)) == ["real passed beside gate"]
    assert fly(judge, (4, 0, -1), (2, 0, -1), start_s=6.0) == []
    result = judge.result(9.0)
    assert numbers(result) == ("FAIL", None, 0.5, None, None)
    assert "passed 0.80 m beside" in result.detail
    assert fly(judge, (2, 0, -1), (4, 0, -1), start_s=8.0) == ["real flew through gate"]
    assert judge.result(12.0).verdict == "PASS"


def test_gates_count_in_order_only() -> None:
    judge = reached(("ring", "gate"))
    stage(judge, goal=2.0)
    assert fly(judge, (0, 0, -1), (4, 0, -1)) == []
    assert "ring (0 of 2 gates)" in judge.result(9.0).detail
    # After the ring the gate lies behind it: away from there is southwards.
    assert fly(judge, (5, 0, -1), (7, 0, -1), (5, 1, -1), (2, -0.2, -1), start_s=5.0) == [
        "real flew through ring",
        "real flew through gate",
    ]
    result = judge.result(12.0)
    assert result.verdict == "PASS"
    assert result.detail == "through gate"


@pytest.mark.parametrize(
    ("direction", "name", "passes"),
    [
        ("along", "gate", True),
        ("against", "gate", False),
        ("along", "ring", False),
        ("against", "ring", True),
        ("either", "ring", True),
        ("away", "ring", True),
    ],
)
def test_direction(direction: str, name: str, passes: bool) -> None:
    judge = reached((name,), direction=direction)
    stage(judge, goal=2.0)
    fly(judge, (2, 0, -1), (8, 0, -1))
    assert (judge.result(9.0).verdict == "PASS") == passes


def test_a_gate_before_the_goal_or_after_land_does_not_count() -> None:
    judge = reached()
    fly(judge, (2, 0, -1), (4, 0, -1), start_s=0.0)
    stage(judge, goal=2.0)
    fly(judge, (4, 0, -1))
    stage(judge, land=4.0)
    fly(judge, (4, 2, -1), (2, 2, -1), (2, 0, -1), (4, 0, -1), start_s=5.0)
    assert judge.result(9.0).verdict == "FAIL"


def test_the_pose_before_the_goal_begins_the_first_way() -> None:
    judge = reached()
    fly(judge, (2, 0, -1), start_s=1.0)
    stage(judge, goal=2.0)
    assert fly(judge, (4, 0, -1)) == ["real flew through gate"]


@pytest.mark.parametrize("north_m", [3.0, 3.0 + 1e-16, 3.0 - 4e-16])
def test_a_pose_in_the_plane_is_crossed_once(north_m: float) -> None:
    judge = reached()
    stage(judge, goal=2.0)
    assert fly(judge, (2.9, 0, -1), (north_m, 0, -1), (3.1, 0, -1)) == ["real flew through gate"]


def test_a_moving_gate_is_where_it_is_at_the_time() -> None:
    begin = Pose.of(3, 0, 1)
    motion = Motion(begin, (Waypoint((3, 5, -1), 1.0),), StartOn("goal"))
    thing = SceneObject(1, "gate", gate("square", 1.0, 0.1), begin, motion)
    gates = {"gate": SceneGate(thing, thing.shape.openings[0])}
    events = {"goal": 2.0}
    context = OracleContext(
        mode="wil", subject="real", vehicle="real", gates=gates, route=("gate",), events=events
    )
    still, chasing = (build("reached", context=context) for _ in range(2))
    stage(still, goal=2.0)
    stage(chasing, goal=2.0)
    assert fly(still, (2.5, 0, -1), (3.5, 0, -1), start_s=5.0) == ["real passed beside gate"]
    assert fly(chasing, (2.5, 3, -1), (3.5, 4, -1), start_s=5.0) == ["real flew through gate"]


def test_a_gate_that_is_not_there_is_refused() -> None:
    with pytest.raises(OracleError, match=r"no gate 'gat' \(it has gate, ring\)"):
        reached(("gat",))
    with pytest.raises(OracleError, match="names no gate"):
        reached(())


def test_reached_position() -> None:
    context = OracleContext(mode="real", subject="real", vehicle="real", target_ned_m=(2, 0, -1))
    judge = build("reached_position", context=context, tolerance_m=0.25)
    stage(judge, goal=2.0)
    assert fly(judge, (0, 0, -1), (1.5, 0, -1)) == []
    assert numbers(judge.result(4.0)) == ("FAIL", 0.5, 0.25, -0.25, 4.0)
    assert fly(judge, (1.8, 0, -1), (1.9, 0, -1), (0, 0, -1), start_s=5.0) == [
        "real reached its goal"
    ]
    result = judge.result(9.0)
    assert result.verdict == "PASS"
    assert result.actual == pytest.approx(0.1)
    with pytest.raises(OracleError, match="no position"):
        build("reached_position", tolerance_m=0.25)


def test_time_limit_kept() -> None:
    judge = build("time_limit", limit_s=10)
    assert not stage(judge, takeoff=0.0, goal=2.0, done=9.0)
    assert not judge.on_tick(30.0)
    assert numbers(judge.result(31.0)) == ("PASS", 7.0, 10.0, 3.0, 9.0)


def test_time_limit_passed_is_flagged_when_it_happens() -> None:
    judge = build("time_limit", limit_s=10)
    stage(judge, goal=2.0)
    assert not judge.on_tick(12.0)
    assert [(f.t_s, f.decisive) for f in judge.on_tick(12.1)] == [(12.0, True)]
    assert not judge.on_tick(12.2)
    stage(judge, done=14.0)
    assert numbers(judge.result(15.0)) == ("FAIL", 12.0, 10.0, -2.0, 14.0)


def test_never_done_in_time_is_no_margin() -> None:
    judge = build("time_limit", limit_s=10)
    stage(judge, goal=2.0)
    assert numbers(judge.result(6.0)) == ("FAIL", 4.0, 10.0, None, 6.0)


# Area


def test_geofence_worst_margin_and_each_exit() -> None:
    judge = build("geofence")
    stage(judge, takeoff=1.0)
    texts = fly(judge, (0, 0, -1), (3.8, 0, -1), (4.3, 0, -1), (4.4, 0, -1), (0, 0, -1), (0, 0, -3))
    assert texts == ["real left the fence by its side", "real left the fence by its ceiling"]
    result = judge.result(9.0)
    assert result.verdict == "FAIL"
    assert result.margin == result.actual == pytest.approx(-0.5)
    assert result.at_s == 8.0


def test_geofence_needs_a_fence() -> None:
    with pytest.raises(OracleError, match="no geofence"):
        build("geofence", context=OracleContext(mode="sim", subject="twin", vehicle="twin"))


def test_altitude_band() -> None:
    judge = build("altitude", min_m=0.5, max_m=2.0)
    stage(judge, takeoff=1.0)
    assert fly(judge, (0, 0, 0), (0, 0, -1.9)) == []
    stage(judge, at_height=5.0)
    assert fly(judge, (0, 0, -1), (0, 0, -0.4), (0, 0, -0.3), start_s=5.0) == [
        "real is 0.40 m high"
    ]
    stage(judge, land=8.0)
    assert fly(judge, (0, 0, 0), start_s=9.0) == []
    result = judge.result(9.0)
    assert (result.verdict, result.limit, result.at_s) == ("FAIL", (0.5, 2.0), 7.0)
    assert result.margin == pytest.approx(-0.2)


def test_altitude_with_one_limit() -> None:
    judge = build("altitude", max_m=2.3)
    stage(judge, takeoff=1.0)
    fly(judge, (0, 0, -1.2))
    result = judge.result(9.0)
    assert (result.verdict, result.limit) == ("PASS", 2.3)
    assert result.margin == pytest.approx(1.1)


# Vehicle


def test_faults_are_flagged_once_each() -> None:
    judge = build("vehicle_fault")
    judge.on_state(state(0.0, fault="before takeoff"))
    stage(judge, takeoff=1.0)
    judge.on_state(state(2.0))
    assert [f.text for f in judge.on_state(state(3.0, fault="low battery"))] == [
        "real: low battery"
    ]
    assert not judge.on_state(state(4.0, fault="low battery"))
    assert judge.on_state(state(5.0, fault="EKF"))
    result = judge.result(9.0)
    assert (result.verdict, result.at_s, result.detail) == ("FAIL", 3.0, "low battery; EKF")


def test_disarming_in_flight_is_a_fault_and_after_landing_is_not() -> None:
    crashed, fine = build("vehicle_fault"), build("vehicle_fault")
    for judge in (crashed, fine):
        stage(judge, takeoff=1.0)
        judge.on_state(state(2.0))
    assert crashed.on_state(state(3.0, armed=False))
    assert not fine.on_state(state(3.0, landed=True))
    assert not fine.on_state(state(4.0, armed=False, landed=True))
    assert crashed.result(5.0).detail == "disarmed in flight"
    assert fine.result(5.0).verdict == "PASS"


def test_a_link_gap_is_flagged_when_it_is_over() -> None:
    judge = build("link", max_gap_s=1.0)
    judge.on_heard(HeardSample(0.0, "real"))
    stage(judge, takeoff=5.0)
    for t_s in (5.2, 5.4, 6.4):
        assert not judge.on_heard(HeardSample(t_s, "real"))
    flags = judge.on_heard(HeardSample(8.4, "real"))
    assert [(f.t_s, f.text) for f in flags] == [(8.4, "real was silent for 2.0 s, more than 1 s")]
    assert not judge.on_heard(HeardSample(8.5, "real"))
    result = judge.result(9.0)
    assert result.verdict == "FAIL"
    assert result.actual == pytest.approx(2.0)
    assert result.at_s == 8.4
    assert result.margin == pytest.approx(-1.0)


def test_a_link_gap_that_does_not_end_is_no_flag_but_fails() -> None:
    # Who never comes back is lost: an ERROR of the guard's, which a flag must not forestall.
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_heard(HeardSample(0.5, "real"))
    assert not judge.on_tick(30.0)
    assert judge.result(30.0).verdict == "FAIL"


def test_silence_until_the_end_counts() -> None:
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_heard(HeardSample(0.5, "real"))
    assert judge.result(1.2).verdict == "PASS"
    assert judge.result(4.0).actual == 3.5


def test_silence_after_landing_does_not_count() -> None:
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_heard(HeardSample(0.5, "real"))
    stage(judge, land=0.7, landed=1.0)
    assert numbers(judge.result(60.0)) == ("PASS", 0.5, 1.0, 0.5, 0.5)


@pytest.mark.parametrize(
    ("armed", "landed", "detail"),
    [
        (False, True, ""),
        (True, True, "still armed"),
        (True, False, "still armed and not on the ground"),
        (False, False, "not on the ground"),
        (False, None, "never said whether it is on the ground"),
    ],
)
def test_landed(armed: bool, landed: bool | None, detail: str) -> None:
    judge = build("landed")
    judge.on_state(state(1.0))
    judge.on_state(state(2.0, armed=armed, landed=landed))
    result = judge.result(3.0)
    assert (result.verdict, result.detail) == ("FAIL" if detail else "PASS", detail)


# Pair


def twin(t_s: float, at: Vec3, velocity: Vec3 = (0, 0, 0)) -> PoseSample:
    return PoseSample(t_s, "twin", Pose(at), velocity)


def test_divergence_carries_the_older_pose_on() -> None:
    judge = build("twin_divergence")
    assert judge.watches == ("real", "twin")
    stage(judge, takeoff=0.0)
    judge.on_pose(pose(1.0, (0, 0, -1), (1, 0, 0)))
    judge.on_pose(twin(1.5, (0.5, 0.3, -1)))
    result = judge.result(2.0)
    assert (result.verdict, result.required, result.margin) == ("PASS", False, None)
    assert result.actual == pytest.approx(0.3)


def test_divergence_with_a_limit() -> None:
    judge = build("twin_divergence", max_m=0.5)
    stage(judge, takeoff=0.0)
    judge.on_pose(twin(1.0, (0, 0, -1)))
    assert [f.text for f in judge.on_pose(pose(1.0, (0, 1, -1)))] == [
        "real and twin are 1.00 m apart"
    ]
    stage(judge, land=2.0)
    judge.on_pose(pose(3.0, (0, 9, -1)))
    assert numbers(judge.result(4.0)) == ("FAIL", 1.0, 0.5, -0.5, 1.0)


def test_a_value_that_is_not_finite_never_reaches_a_result() -> None:
    judge = build("time_limit", limit_s=1)
    result = judge.verdict(passed=True, actual=math.nan, margin=1.0)
    assert (result.verdict, result.actual, result.margin) == ("FAIL", None, None)
    assert "not finite" in result.detail


# Against the real probe


def probed(inner_size_m: float) -> Oracle:
    things = (
        SceneObject(1, "cage", room(6, 6, 2.5), Pose.of(1.5, 0, 0)),
        SceneObject(2, "gate", gate("square", inner_size_m, 0.1), Pose.of(3, 0, 1.2)),
    )
    probe = ClearanceProbe(Scene(things), BoxShape((0.15, 0.15, 0.05)))
    context = OracleContext(mode="wil", subject="real", vehicle="real", probe=probe)
    return build("collision", context=context)


def through(judge: Oracle, east_m: float, *, step_m: float) -> list[Flag]:
    stage(judge, takeoff=0.0)
    flags = list(judge.on_pose(pose(0.0, (0, east_m, -0.05))))
    flags += judge.on_pose(pose(0.9, (0, east_m, -1.2)))
    stage(judge, at_height=0.95)
    for i in range(round(4.0 / step_m) + 1):
        flags += judge.on_pose(pose(1.0 + i * step_m, (i * step_m, east_m, -1.2)))
    return flags


@pytest.mark.parametrize("step_m", [0.01, 0.4, 4.0])
def test_the_middle_of_a_gate_is_clear_by_its_half_size_less_the_vehicle_s(step_m: float) -> None:
    judge = probed(1.0)
    assert through(judge, 0.0, step_m=step_m) == []
    result = judge.result(9.0)
    assert result.verdict == "PASS"
    # 0.5 m to the bar, 0.15 m of vehicle
    assert result.margin == pytest.approx(0.35, abs=2e-3)


@pytest.mark.parametrize("step_m", [0.01, 0.4, 4.0])
def test_a_bar_of_the_gate_is_touched_however_coarse_the_samples(step_m: float) -> None:
    judge = probed(1.0)
    flags = through(judge, 0.45, step_m=step_m)
    assert [flag.text for flag in flags] == ["real touched gate.right"]
    # The bar is 0.1 m thick at 3 m, the vehicle 0.15 m before and behind its centre, at 1 m/s.
    assert 3.8 - 1e-3 <= flags[0].t_s <= 4.2 + 1e-3
    result = judge.result(9.0)
    assert (result.verdict, result.actual, result.margin) == ("FAIL", 0.0, 0.0)


def test_limits_given_to_the_probe_change_no_result() -> None:
    # Only what is nearer than ever, or near an episode, is asked for: the answer must be the same
    # as when all is asked for.
    class Asking:
        def __init__(self, probe: ClearanceProbe) -> None:
            self.probe = probe

        def sweep(self, *stretch: Any, below_m: object = None) -> tuple[Clearance, ...]:
            return self.probe.sweep(*stretch)

    frugal, full = probed(0.6), probed(0.6)
    vars(full)["_probe"] = Asking(vars(full)["_probe"])
    rng = np.random.default_rng(3)
    # To and fro through the bars and beside them.
    walks = [(3.0 + 0.8 * math.sin(i / 7), *rng.uniform(-0.5, 0.5, 2)) for i in range(250)]
    flags: list[list[str]] = []
    for judge in (frugal, full):
        stage(judge, takeoff=0.0, at_height=0.5)
        poses = [pose(1.0 + i, (n, float(e), float(d) - 1.2)) for i, (n, e, d) in enumerate(walks)]
        flags.append([f.text for each in poses for f in judge.on_pose(each)])
    assert flags[0] == flags[1]
    assert len(flags[0]) > 5
    assert frugal.result(999.0).actual == full.result(999.0).actual == 0.0


def test_limits_given_to_the_probe_keep_the_smallest_clearance() -> None:
    judge, east_m = probed(1.0), [0.1, 0.2, 0.05, 0.15]
    stage(judge, takeoff=0.0, at_height=0.5)
    for i, east in enumerate(east_m):
        assert not judge.on_pose(pose(1.0 + i, (3.0, east, -1.2)))
    # 0.2 m aside in the gate: 0.5 - 0.2 - 0.15
    assert judge.result(9.0).actual == pytest.approx(0.15, abs=2e-3)
    assert judge.result(9.0).at_s == pytest.approx(2.0, abs=1e-6)
