import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.safety.oracles.oracle_rigs import (
    ScriptedProbe,
    build,
    contact,
    numbers,
    pose,
    stage,
    state,
)
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.contact import CLEAR_AGAIN_M, exceeded_margin_m
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext
from wil_campaign.worlds.clearance.clearance import BoxShape, Clearance, ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.motion import ObjectMotion, Waypoint
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import box_shape, gate_shape, room_shape
from wil_campaign.worlds.scene.track import RunHistory


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


def test_an_empty_world_is_passed_and_reported_as_empty() -> None:
    judge, _ = contact({})
    stage(judge, takeoff=1.0)
    judge.on_pose(pose(2.0))
    assert numbers(judge.result(3.0)) == ("PASS", None, 0.0, None, None)


# Against the real probe


def probed(inner_size_m: float) -> Oracle:
    things = (
        SceneObject(1, "cage", room_shape(6, 6, 2.5), Pose.of(1.5, 0, 0)),
        SceneObject(2, "gate", gate_shape("square", inner_size_m, 0.1), Pose.of(3, 0, 1.2)),
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


@pytest.mark.parametrize(
    ("kind", "more", "beyond_m"),
    [
        ("collision", {}, 2.0),
        ("clearance", {"min_m": 0.5}, 1.5),
        ("clearance", {"min_m": 3.0}, CLEAR_AGAIN_M),
    ],
)
def test_the_margin_exceeds_the_sight_of_the_oracle_when_nothing_came_near(
    kind: str, more: dict[str, float], beyond_m: float
) -> None:
    far, close = (
        OracleContext(mode="wil", subject="real", vehicle="real", probe=ScriptedProbe(script))
        for script in ({}, {2.0: [("post", "", 3.5)]})
    )
    found = []
    for context in (far, close):
        judge = build(kind, context=context, **more)
        stage(judge, takeoff=1.0, at_height=1.5)
        judge.on_pose(pose(2.0))
        found.append(judge.result(3.0))
    assert exceeded_margin_m(found[0]) == pytest.approx(beyond_m)
    assert exceeded_margin_m(found[1]) is None
    assert exceeded_margin_m(replace(found[0], verdict="INVALID")) is None
    assert exceeded_margin_m(replace(found[0], limit=None)) is None


# The ground in the open


def in_the_open(kind: str = "collision", **parameters: Any) -> Oracle:
    """An oracle in a world without a room, whose ground is 1 m below the origin."""
    probe = ClearanceProbe(Scene(), BoxShape((0.15, 0.15, 0.05)))
    context = OracleContext(
        mode="wil", subject="real", vehicle="real", probe=probe, ground_down_m=1.0
    )
    return build(kind, context=context, **parameters)


def test_the_ground_in_the_open_counts_between_at_height_and_land_only() -> None:
    judge = in_the_open()
    stage(judge, takeoff=1.0)
    assert not judge.on_pose(pose(1.5, (0, 0, 1)))
    judge.on_pose(pose(1.9, (0, 0, 0)))
    stage(judge, at_height=2.0)
    downs_m = {2.5: 0.0, 3.0: 0.96, 3.5: 0.98, 4.0: 0.0, 4.2: 0.0, 4.5: 0.96}
    flags = [
        flag for t_s, down_m in downs_m.items() for flag in judge.on_pose(pose(t_s, (9, 0, down_m)))
    ]
    assert [(f.t_s, f.text, f.decisive) for f in flags] == [
        (3.0, "real touched the ground", True),
        (4.5, "real touched the ground", True),
    ]
    stage(judge, land=5.0)
    assert not judge.on_pose(pose(6.0, (9, 0, 1)))
    assert numbers(judge.result(7.0)) == ("FAIL", 0.0, 0.0, 0.0, 3.0)


def test_a_tilted_body_touches_the_ground_with_its_edge() -> None:
    judge = in_the_open()
    stage(judge, takeoff=1.0, at_height=2.0)
    tilted = Pose.of(0.0, 0.0, -0.9, roll_rad=math.radians(30.0))
    assert not judge.on_pose(pose(3.0, (0, 0, 0.9)))
    assert judge.on_pose(PoseSample(3.1, "real", tilted, (0, 0, 0)))
    assert judge.result(4.0).at_s == 3.1


def test_a_pass_without_contact_tells_how_near_the_ground_came() -> None:
    judge = in_the_open()
    stage(judge, takeoff=1.0, at_height=2.0)
    judge.on_pose(pose(3.0, (0, 0, 0.2)))
    result = judge.result(4.0)
    assert result.actual == pytest.approx(0.75)
    assert (result.verdict, result.detail) == ("PASS", "closest to the ground")


def test_a_clearance_is_to_objects_and_not_to_the_ground_in_the_open() -> None:
    judge = in_the_open("clearance", min_m=1.5)
    stage(judge, takeoff=1.0, at_height=2.0)
    judge.on_pose(pose(3.0, (0, 0, 0.9)))
    assert judge.result(4.0).detail == "nothing near"


def test_a_floor_is_touched_in_place_of_the_ground_beneath_it() -> None:
    cage = Scene((SceneObject(1, "cage", room_shape(6, 6, 2.5), Pose.of(0, 0, 0)),))
    probe = ClearanceProbe(cage, BoxShape((0.15, 0.15, 0.05))).above(0.01)

    def floors(north_m: float, up_m: float) -> list[tuple[str, float]]:
        at = Pose.of(north_m, 0, up_m)
        swept = probe.sweep(at, 0.0, at, 0.0)
        return [(one.object_name, one.clearance_m) for one in swept if one.is_floor]

    assert floors(0.0, 0.0) == [("cage", 0.0)]
    ((name, clearance_m),) = floors(0.0, 0.55)
    assert (name, round(clearance_m, 3)) == ("cage", 0.5)
    assert floors(9.0, 0.0) == [("the ground", 0.0)]
    assert cage.floor_down_m == 0.0
    assert Scene().floor_down_m is None


def test_a_vehicle_that_reports_the_ground_in_flight_has_touched_it() -> None:
    """An estimate may have drifted: the vehicle stands, and its positions say half a metre up."""
    judge = in_the_open()
    stage(judge, takeoff=1.0)
    judge.on_pose(pose(1.0, (0, 0, 0)))
    # A report of before the takeoff may still be the newest one.
    reports = {1.5: True, 2.1: True, 2.5: False, 4.0: True, 4.1: True, 5.0: False}
    flags = list(judge.on_state(state(1.5, landed=True)))
    stage(judge, at_height=2.0)
    flags += [
        f
        for t_s, landed in reports.items()
        if t_s > 2
        for f in judge.on_state(state(t_s, landed=landed))
    ]
    text = "real reported that it is on the ground before it was to land"
    assert [(f.t_s, f.text, f.decisive) for f in flags] == [(4.0, text, True)]
    stage(judge, land=6.0)
    assert not judge.on_state(state(7.0, landed=True))
    result = judge.result(8.0)
    assert (result.verdict, result.actual, result.at_s) == ("FAIL", 0.0, 4.0)


def test_a_report_that_comes_as_the_landing_begins_is_of_the_landing() -> None:
    judge = in_the_open()
    judge.on_pose(pose(0.0))
    stage(judge, takeoff=1.0, at_height=2.0)
    judge.on_pose(pose(2.5))
    judge.on_state(state(2.5, landed=False))
    stage(judge, land=3.0)
    assert not judge.on_state(state(3.1, landed=True))
    assert judge.result(4.0).verdict == "PASS"


def test_a_clearance_below_its_limit_says_the_limit_and_the_worst_value() -> None:
    probe = ScriptedProbe({2.0: [("box", "", 0.59998)], 3.0: [("box", "", 0.2)]})
    context = OracleContext(mode="sim", subject="real", vehicle="real", probe=probe)
    judge = build("clearance", context=context, min_m=0.6)
    stage(judge, takeoff=1.0)
    flags = [flag for t_s in (2.0, 3.0) for flag in judge.on_pose(pose(t_s))]
    text = "real came within 0.59998 m of box; the limit is 0.6 m"
    assert [flag.text for flag in flags] == [text]
    assert judge.worst_text == "at worst 0.200 m"


# An object that a vehicle flies, whose poses come late


def passed_by(kind: str, *, silent: range, late: int = 0, **parameters: object) -> Oracle:
    """Judge a vehicle that hovers at 1 m while a drone flies through its place at 5 m/s at 0.5 s.

    Both have a pose in each 20 ms; the drone's come `late` of them later, and not those `silent`.
    """
    start = Pose((0.0, -2.5, -1.0))
    motion = ObjectMotion(start, (Waypoint((0.0, 2.5, -1.0), 5.0),))
    scene = Scene((SceneObject(1, "drone", box_shape((0.2, 0.2, 0.1)), start, motion),))
    body, history = BoxShape((0.15, 0.15, 0.05)), RunHistory()
    context = OracleContext(
        mode="sim",
        subject="real",
        vehicle="real",
        probe=ClearanceProbe(scene, body),
        probe_of=lambda _: ClearanceProbe(scene, body, within_m=1e6),
        things=("drone",),
        events=history,
    )
    judge = build(kind, context=context, **parameters)
    stage(judge, takeoff=-0.3, at_height=-0.2, goal=-0.1)
    for step in range(60):
        if (sent := step - late) >= 0 and sent not in silent:
            t_s = sent / 50
            history.add_pose("drone", t_s, motion.pose_at(t_s, {}), (0.0, 5.0, 0.0))
        judge.on_pose(pose(step / 50))
    return judge


_FORMULAS = ("always (clearance_m > 0.1)", "always (distance_drone_m > 0.1)")


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        ("collision", {}),
        ("distance", {"object": "drone", "min_m": 0.1}),
        *(("stl", {"stl": formula}) for formula in _FORMULAS),
    ],
)
@pytest.mark.parametrize(("silent", "late"), [((17, 35), 0), ((0, 0), 12), ((17, 35), 12)])
def test_a_drone_is_touched_while_its_poses_are_missing_or_late(
    kind: str, parameters: dict[str, object], silent: tuple[int, int], late: int
) -> None:
    # At 0.34 s it is 0.8 m away, and taken to rest 0.3 m away from 0.44 s on.
    result = passed_by(kind, silent=range(*silent), late=late, **parameters).result(9.0)
    assert (result.verdict, result.actual) == ("FAIL", 0.0)
    # A formula has values at poses: this one at the next after it is known.
    assert result.at_s == pytest.approx(0.5, abs=0.5 if kind == "stl" else 0.08)


def test_a_drone_that_is_silent_for_good_is_where_it_was_last() -> None:
    """As one that is switched off where it landed, before the subject has."""
    start = Pose((0.0, -2.5, -1.0))
    motion = ObjectMotion(start, (Waypoint((0.0, 2.5, -1.0), 5.0),))
    scene = Scene((SceneObject(1, "drone", box_shape((0.2, 0.2, 0.1)), start, motion),))
    body, history = BoxShape((0.15, 0.15, 0.05)), RunHistory()
    probe = ClearanceProbe(scene, body)
    context = OracleContext(
        mode="sim", subject="real", vehicle="real", probe=probe, things=("drone",), events=history
    )
    judge = build("collision", context=context)
    stage(judge, takeoff=-0.3, at_height=-0.2, goal=-0.1)
    history.add_pose("drone", 0.0, Pose((0.0, 0.0, -1.0)), (0.0, 0.0, 0.0))
    for step in range(160):
        judge.on_pose(pose(step / 50, (2.0 - step / 25, 0.0, -1.0)))  # through it at 1 s
    result = judge.result(9.0)
    assert (result.verdict, result.actual) == ("FAIL", 0.0)


def test_no_vehicle_touches_a_drone_that_is_not_where_it_was_last() -> None:
    start = Pose((0.0, 0.0, -1.0))
    motion = ObjectMotion(start, (Waypoint((0.0, 9.0, -1.0), 5.0),))
    scene = Scene((SceneObject(1, "drone", box_shape((0.2, 0.2, 0.1)), start, motion),))
    body, history = BoxShape((0.15, 0.15, 0.05)), RunHistory()
    context = OracleContext(
        mode="sim",
        subject="real",
        vehicle="real",
        probe=ClearanceProbe(scene, body),
        probe_of=lambda _: ClearanceProbe(scene, body, within_m=1e6),
        things=("drone",),
        events=history,
    )
    judges = [
        build("collision", context=context),
        build("distance", context=context, object="drone", min_m=0.1),
        build("stl", context=context, stl="always (clearance_m > 0.1)"),
        build("stl", context=context, stl="always (distance_drone_m > 0.1)"),
    ]
    met = build("encounter", context=context, object="drone", within_m=0.3)
    for judge in (*judges, met):
        stage(judge, takeoff=-0.3, at_height=-0.2, goal=-0.1)
    # It flies off to the east, and the vehicle comes from the north to where it was at 0.1 s.
    for step in range(41):
        if not 5 < step < 35:
            history.add_pose("drone", step / 50, motion.pose_at(step / 50, {}), (0.0, 0.0, 0.0))
        for judge in (*judges, met):
            judge.on_pose(pose(step / 50, (1.5 - step / 20, 0.5, -1.0)))
    assert [judge.result(9.0).verdict for judge in (*judges, met)] == [*["PASS"] * 4, "FAIL"]


def test_what_is_judged_later_is_one_contact_with_the_late_object_alone() -> None:
    both = [("drone", "", 0.0), ("wall", "", 0.0)]
    probe, history = ScriptedProbe({0.2: both, 0.3: both, 0.4: both, 0.6: both[:1]}), RunHistory()
    context = OracleContext(mode="sim", subject="real", vehicle="real", probe=probe, events=history)
    judge = build("collision", context=context)
    stage(judge, takeoff=0.0)
    history.add_pose("drone", 0.1, Pose((0, 0, -1)), (0, 0, 0))
    flags = [flag for t_s in (0.1, 0.25, 0.3, 0.4, 0.5) for flag in judge.on_pose(pose(t_s))]
    assert [flag.text for flag in flags] == ["real touched wall"]
    history.add_pose("drone", 0.6, Pose((0, 0, -1)), (0, 0, 0))
    flags = [*judge.on_pose(pose(0.6))]
    assert [(flag.t_s, flag.text) for flag in flags] == [
        (0.3, "real touched drone"),
        (0.6, "real touched drone"),
    ]
    later = [(0.1, 0.25), (0.25, 0.3), (0.3, 0.4), (0.4, 0.5), (0.5, 0.6)]
    assert probe.asked[-5:] == later
    assert judge.on_pose(pose(0.7)) == ()
    assert probe.asked[-1] == (0.6, 0.7)
