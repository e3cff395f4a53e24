import math
from dataclasses import replace

import pytest

from tests.safety.oracles.oracle_rigs import SCENE, build, fly, numbers, reached, stage
from wil_campaign.safety.oracles.gates import SceneGate, gates_of
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext, OracleError
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene.motion import ObjectMotion, StartOnEvent, Waypoint
from wil_campaign.worlds.scene.scene import SceneObject
from wil_campaign.worlds.scene.shapes import gate_shape


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


def test_a_way_beside_the_gate_or_back_through_it_does_not_count() -> None:
    judge = reached()
    stage(judge, goal=2.0)
    assert fly(judge, (2, 0.8, -1), (4, 0.8, -1)) == ["real passed beside gate"]
    assert fly(judge, (4, 0, -1), (2, 0, -1), start_s=6.0) == []
    result = judge.result(9.0)
    assert numbers(result) == ("FAIL", None, 0.5, None, None)
    assert "passed 0.80 m beside" in result.detail
    assert fly(judge, (2, 0, -1), (4, 0, -1), start_s=8.0) == ["real flew through gate"]
    assert judge.result(12.0).verdict == "PASS"


def test_a_gate_out_of_turn_is_noted_once_where_it_was_flown_through() -> None:
    judge = reached(("ring", "gate"))
    stage(judge, goal=2.0)
    fly(judge, (2.0, 0.8, -1), (4.0, 0.8, -1))
    assert "before" not in judge.result(9.0).detail
    fly(judge, (4.0, 0, -1), (2.0, 0, -1), start_s=6.0)
    assert "flew through gate before ring" in judge.result(9.0).detail


def test_a_gate_that_was_reached_may_be_flown_through_again() -> None:
    judge = reached(("gate", "ring"))
    stage(judge, goal=2.0)
    fly(judge, (2, 0, -1), (4, 0, -1), (2, 0, -1))
    assert "before" not in judge.result(9.0).detail


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
def test_a_gate_passes_in_its_own_direction_alone(direction: str, name: str, passes: bool) -> None:
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
    motion = ObjectMotion(begin, (Waypoint((3, 5, -1), 1.0),), StartOnEvent("goal"))
    thing = SceneObject(1, "gate", gate_shape("square", 1.0, 0.1), begin, motion)
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


def test_the_depth_behind_a_gate_that_moves_along_its_axis_is_of_that_time() -> None:
    begin = Pose.of(3, 0, 1)
    motion = ObjectMotion(begin, (Waypoint((6, 0, -1), 1.0),), StartOnEvent("goal"))
    thing = SceneObject(1, "gate", gate_shape("square", 1.0, 0.1), begin, motion)
    gate, events = SceneGate(thing, thing.shape.openings[0]), {"goal": 2.0}
    assert gate.depth_m((4.0, 0.0, -1.0), 2.0, events) == pytest.approx(1.0)
    assert gate.depth_m((4.0, 0.0, -1.0), 50.0, events) == pytest.approx(-2.0)
    still = SceneGate(replace(thing, motion=None), thing.shape.openings[0])
    assert still.depth_m((4.0, 0.0, -1.0), 50.0, events) == pytest.approx(1.0)


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
    # It is missed at the end, not when it was the nearest: an error in between comes first.
    assert numbers(judge.result(4.0)) == ("FAIL", 0.5, 0.25, -0.25, None)
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


def test_a_goal_never_done_in_time_has_no_margin() -> None:
    judge = build("time_limit", limit_s=10)
    stage(judge, goal=2.0)
    assert numbers(judge.result(6.0)) == ("FAIL", 4.0, 10.0, None, 6.0)


BODY: Vec3 = (0.15, 0.15, 0.05)
RADIUS_M = math.sqrt(0.15**2 * 2 + 0.05**2)


def of_body(route: tuple[str, ...] = ("gate",), **parameters: object) -> Oracle:
    context = OracleContext(
        mode="wil",
        subject="real",
        vehicle="real",
        gates=gates_of(SCENE),
        route=route,
        body_half_m=BODY,
    )
    judge = build("reached", context=context, **parameters)
    stage(judge, goal=2.0)
    return judge


def test_a_nose_in_the_gate_and_a_way_round_it_is_no_passage() -> None:
    judge = of_body()
    assert fly(judge, (2, 0, -1), (3.018, 0, -1), (2, 0, -1), (2, 2, -1), (4, 2, -1)) == [
        "real passed beside gate"
    ]
    detail = judge.result(9.0).detail
    assert detail.startswith("never flew through gate (0 of 1 gates); entered gate by 0.02 m and")


@pytest.mark.parametrize("direction", ["away", "either", "along"])
def test_flying_in_and_out_again_is_no_passage_in_any_direction(direction: str) -> None:
    judge = of_body(direction=direction)
    assert fly(judge, (2, 0, -1), (3.1, 0, -1), (2, 0, -1)) == []
    assert judge.result(9.0).verdict == "FAIL"


@pytest.mark.parametrize(("beyond_m", "through"), [(-0.01, False), (0.01, True)])
def test_a_passage_ends_on_the_far_side_by_the_radius(beyond_m: float, through: bool) -> None:
    judge = of_body()
    fly(judge, (2, 0, -1), (3.0 + RADIUS_M + beyond_m, 0, -1))
    result = judge.result(9.0)
    assert (result.verdict == "PASS") == through
    if not through:
        assert "ended 0.21 m past its plane: through is 0.22 m" in result.detail


@pytest.mark.parametrize(("offset_m", "through"), [(0.34, True), (0.36, False)])
def test_the_whole_body_has_to_be_inside_of_the_opening(offset_m: float, through: bool) -> None:
    judge = of_body()
    fly(judge, (2, offset_m, -1), (4, offset_m, -1))
    result = judge.result(9.0)
    assert (result.verdict == "PASS") == through
    if through:
        assert result.actual == pytest.approx(0.34)
        assert result.limit == pytest.approx(0.35)
    else:
        assert "with its body 0.01 m beyond the opening" in result.detail


def test_backwards_and_out_of_order_are_named() -> None:
    backwards = of_body(direction="along")
    fly(backwards, (2, 2, -1), (4, 2, -1), (4, 0, -1), (2, 0, -1))
    assert "flew through gate the wrong way" in backwards.result(12.0).detail
    wrong = of_body(("ring", "gate"))
    fly(wrong, (2, 0, -1), (4, 0, -1))
    assert "flew through gate before ring" in wrong.result(12.0).detail


def test_a_dip_before_the_passage_does_not_spoil_it() -> None:
    judge = of_body()
    assert fly(judge, (2, 0, -1), (3.1, 0, -1), (2, 0, -1), (4, 0, -1)) == [
        "real flew through gate"
    ]
    assert judge.result(12.0).verdict == "PASS"
