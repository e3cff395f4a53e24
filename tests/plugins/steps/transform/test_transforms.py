"""Transforms of units, frames and places: exact, and undone by their inverses."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.recipes.samples import (
    apply,
    beam,
    build,
    camera,
    cloud,
    depth,
    fix,
    imu,
    pose,
    scan,
    sound,
)
from wil_campaign.plugins.steps.operations.unit_factors import METRES
from wil_campaign.recipes.model.registry import find_step
from wil_campaign.recipes.operations.step_parameters import RotationPart
from wil_campaign.recipes.working import CannotMixError, Masked
from wil_campaign.vehicles.readings import sensor_names
from wil_campaign.worlds.frames import (
    Pose,
    angle_between,
    euler_from_quat,
    matrix_from_quat,
    quat_conjugate,
    quat_from_euler,
    rotate,
)
from wil_campaign.worlds.geodesy import LocalFrame

angles = st.floats(-3.1, 3.1)
metres = st.floats(-1000, 1000)
places = st.tuples(metres, metres, metres)
attitudes = st.builds(quat_from_euler, angles, st.floats(-1.5, 1.5), angles)
poses = st.builds(Pose, places, attitudes)


@pytest.mark.parametrize(
    ("name", "metre"),
    [("ft", 0.3048), ("mm", 0.001), ("km", 1000.0), ("nmi", 1852.0), ("in", 0.0254)],
)
def test_lengths_become_metres(name: Any, metre: float) -> None:
    assert METRES[name] == metre
    assert apply("units", beam(10.0), length=name).reading.range_m == pytest.approx(10 * metre)
    assert apply("units", depth(10.0), length=name).reading.depth_m[0, 0] == pytest.approx(
        10 * metre
    )
    made = apply("units", scan([1.0, math.inf]), length=name).reading
    assert made.ranges_m[0] == pytest.approx(metre)
    assert math.isinf(made.ranges_m[1])
    assert made.range_max_m == pytest.approx(30 * metre)
    points = apply("units", cloud([[1, 2, 3]]), length=name).reading.points_frd_m
    assert points == pytest.approx(np.array([[1, 2, 3]]) * metre)
    assert apply("units", camera(depth_m=depth(2.0).depth_m), length=name).reading.depth_m[
        0, 0
    ] == pytest.approx(2 * metre)


def test_angles_speeds_accelerations_and_pressures_become_ours() -> None:
    made = apply("units", imu(), angle="deg", acceleration="g").reading
    assert made.rates_frd_rad_s[2] == pytest.approx(math.radians(0.03))
    assert made.specific_force_frd_m_s2[0] == pytest.approx(0.980665)
    place = apply("units", fix(0.5, -1.0), angle="rad", speed="kn", length="ft").reading
    assert place.latitude_deg == pytest.approx(math.degrees(0.5))
    assert place.velocity_ned_m_s[0] == pytest.approx(0.514444, rel=1e-5)
    assert place.altitude_m == pytest.approx(3.048)
    turned = apply("units", scan(np.ones(4), start_angle_rad=-180, step_rad=90), angle="deg")
    assert turned.reading.step_rad == pytest.approx(math.pi / 2)
    assert apply("units", sound([1, 2]), pressure="kpa").reading.full_scale_pa == 10_000
    moved = apply("units", pose(), length="ft", speed="ft_s").reading
    assert moved.pose.position_ned_m == pytest.approx((0.3048, 0.6096, 0.9144))
    assert moved.velocity_ned_m_s == pytest.approx((0.3048, 0, 0))


@dataclass(frozen=True, slots=True)
class CountReading:
    count: int


def test_units_take_every_sensor_type_and_convert_what_they_know_of() -> None:
    kind = find_step("units", "transform")
    assert kind is not None
    assert kind.sensors == sensor_names()
    unknown: Any = CountReading(3)
    assert apply("units", unknown).reading == unknown
    with pytest.raises(TypeError, match="units of a CountReading"):
        apply("units", unknown, length="ft")


@given(poses)
def test_enu_and_flu_become_ned_and_frd(truth: Pose) -> None:
    """A source in ENU and FLU says where the nose points in its own words; both agree."""
    north, east, down = truth.position_ned_m
    nose = rotate(truth.q_wxyz, (1.0, 0.0, 0.0))
    left = rotate(truth.q_wxyz, (0.0, -1.0, 0.0))
    up = rotate(truth.q_wxyz, (0.0, 0.0, -1.0))
    columns = [(v[1], v[0], -v[2]) for v in (nose, left, up)]
    q = RotationPart(matrix=np.array(columns).T.tolist()).quaternion()
    given_pose = pose(Pose((east, north, -down), q), velocity_ned_m_s=(2.0, 1.0, -3.0))
    made = apply("axes", given_pose, world="enu", body="flu").reading
    assert made.pose.position_ned_m == pytest.approx(truth.position_ned_m)
    assert angle_between(made.pose.q_wxyz, truth.q_wxyz) < 1e-6
    assert made.velocity_ned_m_s == (1.0, 2.0, 3.0)


@given(places, places)
def test_axes_applied_twice_change_nothing(force: Any, rates: Any) -> None:
    given_imu = imu(specific_force_frd_m_s2=force, rates_frd_rad_s=rates)
    once = apply("axes", given_imu, body="flu").reading
    assert once.specific_force_frd_m_s2 == (force[0], -force[1], -force[2])
    assert apply("axes", once, body="flu").reading == given_imu


def test_axes_of_lidars_and_fixes() -> None:
    made = apply("axes", scan([1, 2, 3, 4], start_angle_rad=0.1), body="flu").reading
    assert made.start_angle_rad == -0.1
    assert made.step_rad == pytest.approx(-math.pi / 2)
    points = apply("axes", cloud([[1, 2, 3]]), body="flu").reading.points_frd_m
    assert points.tolist() == [[1, -2, -3]]
    moving = apply("axes", fix(1, 2), world="enu").reading.velocity_ned_m_s
    assert moving == (2.0, 1.0, -3.0)
    assert apply("axes", fix(1, 2)).reading == fix(1, 2)


@given(attitudes)
def test_attitudes_are_read_in_every_form(truth: Any) -> None:
    w, x, y, z = truth
    roll, pitch, yaw = euler_from_quat(truth)
    degrees = (math.degrees(roll), math.degrees(pitch), math.degrees(yaw), 0.0)
    for written, options in (
        ((w, x, y, z), {}),
        ((x, y, z, w), {"order": "xyzw"}),
        ((roll, pitch, yaw, 0.0), {"order": "euler_rad"}),
        (degrees, {"order": "euler_deg"}),
        (quat_conjugate(truth), {"of": "world_to_body"}),
        ((3 * w, 3 * x, 3 * y, 3 * z), {}),
    ):
        made = apply("attitude", pose(Pose((0, 0, 0), written)), **options).reading
        assert angle_between(made.pose.q_wxyz, truth) < 1e-6


def test_an_attitude_without_direction_is_refused() -> None:
    with pytest.raises(CannotMixError, match="no direction"):
        apply("attitude", pose(Pose((0, 0, 0), (0, 0, 0, 0))))


@given(attitudes)
def test_a_rotation_is_the_same_in_all_three_forms(truth: Any) -> None:
    roll, pitch, yaw = (math.degrees(a) for a in euler_from_quat(truth))
    forms = (
        RotationPart(roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw),
        RotationPart(q_wxyz=[5 * part for part in truth]),
        RotationPart(matrix=matrix_from_quat(truth).tolist()),
    )
    for form in forms:
        assert angle_between(form.quaternion(), truth) < 1e-6


@pytest.mark.parametrize(
    "bad",
    [
        {"q_wxyz": [0.0, 0, 0, 0]},
        {"matrix": [[1.0, 0, 0], [0, 1, 0], [0, 0, -1]]},
        {"matrix": [[2.0, 0, 0], [0, 1, 0], [0, 0, 1]]},
        {"yaw_deg": 3.0, "q_wxyz": [1.0, 0, 0, 0]},
    ],
)
def test_a_value_that_is_no_rotation_is_refused(bad: Any) -> None:
    with pytest.raises(ValueError, match=r"rotation|direction"):
        RotationPart(**bad)


@given(st.floats(-80, 80), st.floats(-180, 180), places)
def test_geodetic_and_local_undo_each_other(lat: float, lon: float, place: Any) -> None:
    origin = {"latitude_deg": lat, "longitude_deg": lon, "altitude_m": 100.0}
    given_pose = pose(Pose(place), velocity_ned_m_s=(0.0, 3.0, 0.0))
    there = apply("geodetic", given_pose, **origin).reading
    back = apply("local", there, **origin).reading
    assert back.pose.position_ned_m == pytest.approx(place, abs=1e-5)
    assert back.pose.yaw_rad == pytest.approx(math.pi / 2)
    assert (back.t_s, back.seq, back.source) == (given_pose.t_s, given_pose.seq, "twin")
    if max(abs(metre) for metre in place) > 1.0:
        assert there.latitude_deg != lat or there.longitude_deg != lon or place[2]


def test_a_known_place() -> None:
    # 1 degree of latitude at the equator: 110574 m (WGS-84).
    made = apply("geodetic", pose(Pose((110574.0, 0, 0))), latitude_deg=0.0, longitude_deg=0.0)
    assert made.reading.latitude_deg == pytest.approx(1.0, abs=1e-3)


@given(poses, st.floats(-180, 180), places)
def test_an_offset_moves_and_turns(start: Pose, yaw_deg: float, by: Any) -> None:
    options = {"north_m": by[0], "east_m": by[1], "up_m": -by[2], "yaw_deg": yaw_deg}
    given_pose = pose(start, velocity_ned_m_s=(1.0, 0.0, 0.0))
    made = apply("offset", given_pose, **options).reading
    expected = [a + b for a, b in zip(start.position_ned_m, by, strict=True)]
    assert made.pose.position_ned_m == pytest.approx(expected)
    turn = quat_from_euler(0, 0, math.radians(yaw_deg))
    assert rotate(made.pose.q_wxyz, (1, 0, 0)) == pytest.approx(
        rotate(turn, rotate(start.q_wxyz, (1, 0, 0))), abs=1e-9
    )
    whole = apply("offset", given_pose, about="origin", **options).reading.pose
    frame = Pose((by[0], by[1], by[2]), turn)
    assert whole.position_ned_m == pytest.approx(frame.compose(start).position_ned_m, abs=1e-6)


@given(st.floats(-80, 80), st.floats(-170, 170), st.tuples(*[st.floats(-200, 200)] * 3))
def test_an_offset_of_a_fix_is_as_long_as_asked(lat: float, lon: float, by: Any) -> None:
    made = apply("offset", fix(lat, lon), north_m=by[0], east_m=by[1], up_m=by[2]).reading
    moved = LocalFrame(lat, lon, 10.0).to_ned(
        made.latitude_deg, made.longitude_deg, made.altitude_m
    )
    assert moved == pytest.approx((by[0], by[1], -by[2]), abs=1e-6)


@given(poses, poses, places)
def test_points_of_another_mount_stay_where_they_are_on_the_body(
    old: Pose, new: Pose, point: Any
) -> None:
    work = apply("remount", cloud([point], mount=old), cloud([[0, 0, 0]], mount=new), to="real")
    assert work.reading.mount == new
    x, y, z = (float(each) for each in work.reading.points_frd_m[0])
    there = new.to_parent((x, y, z))
    assert there == pytest.approx(old.to_parent(point), abs=0.01)
    body = apply("remount", cloud([point], mount=old), to="body").reading
    assert body.points_frd_m[0] == pytest.approx(old.to_parent(point), abs=0.01)


def test_remount_needs_the_other_side() -> None:
    with pytest.raises(CannotMixError):
        apply("remount", cloud([[0, 0, 0]]), to="real")


def test_scans_and_depth_become_points() -> None:
    made = apply("to_points", scan([1.0, 2.0, math.inf, 4.0])).reading
    assert made.points_frd_m == pytest.approx(
        np.array([[-1, 0, 0], [0, -2, 0], [0, 4, 0]]), abs=1e-6
    )
    values = np.full((48, 64), np.inf)
    values[10, 20] = 5.0
    ids = np.zeros((48, 64), np.uint8)
    ids[10, 20] = 9
    seen = depth(values, object_ids=ids)
    points = apply("to_points", seen).reading
    assert points.object_ids.tolist() == [9]
    forward, right, down = (float(x) for x in points.points_frd_m[0])
    assert seen.intrinsics.project((forward, right, down)) == pytest.approx((20.0, 10.0), abs=1e-4)
    assert len(apply("to_points", depth(2.0), every=4).reading.points_frd_m) == 12 * 16


@pytest.mark.parametrize("seen", [scan([1.0, 2.0]), depth(2.0)])
def test_points_are_on_the_body_where_their_sensor_saw_them(seen: Any) -> None:
    mount = Pose((0.3, 0.0, -0.1), quat_from_euler(0.0, -0.5, 0.0))
    assert apply("to_points", replace(seen, mount=mount)).reading.mount == mount


def test_points_are_made_of_kept_readings_alone() -> None:
    work = Masked(scan([1.0, 2.0, 3.0]), np.array([255, 0, 255], np.uint8))
    assert len(build("to_points")(work, None).reading.points_frd_m) == 2


@given(st.integers(4, 60), st.integers(4, 60))
def test_beams_take_the_nearest_in_angle(count: int, wanted: int) -> None:
    angles_rad = -np.pi + np.arange(count) * 2 * np.pi / count
    work = apply("resample_beams", scan(10 + angles_rad), scan(np.ones(wanted), "real"), to="real")
    assert len(work.reading.ranges_m) == wanted
    assert (work.mask == 255).all()
    apart = np.abs(work.reading.ranges_m - 10 - work.reading.angles_rad)
    around = np.minimum(apart, 2 * np.pi - apart)
    assert around.max() <= np.pi / count + 1e-5


steps_rad = st.floats(0.01, 0.5).flatmap(lambda step: st.sampled_from([step, -step]))


@given(st.integers(1, 12), steps_rad, st.integers(1, 12), steps_rad, st.floats(-7.0, 7.0))
def test_beams_of_any_two_scans_are_those_of_a_plain_search(
    count: int, step_rad: float, wanted: int, wanted_rad: float, start_rad: float
) -> None:
    old = scan(np.arange(count), start_angle_rad=0.3, step_rad=step_rad)
    new = scan(np.ones(wanted), "real", start_angle_rad=start_rad, step_rad=wanted_rad)
    work = apply("resample_beams", old, new, to="real")
    apart = new.angles_rad[:, None] - old.angles_rad
    apart = np.abs(apart - np.rint(apart / math.tau) * math.tau)
    reach = 0.5 * max(abs(step_rad), abs(wanted_rad))
    for range_m, kept, each in zip(work.reading.ranges_m, work.mask, apart, strict=True):
        if kept:
            assert each[int(range_m)] <= min(each.min(), reach) + 1e-6
        else:
            assert np.isinf(range_m)
            assert each.min() > reach - 1e-6


def test_a_single_beam_needs_no_step() -> None:
    one = scan([5.0], start_angle_rad=0.0, step_rad=0.0)
    work = apply("resample_beams", one, to={"count": 4, "start_deg": 0.0, "step_deg": 90.0})
    assert work.mask.tolist() == [255, 0, 0, 0]


def test_beams_that_the_scan_did_not_look_at_are_not_kept() -> None:
    front = scan([5.0, 6.0, 7.0], start_angle_rad=-0.1, step_rad=0.1)
    work = apply("resample_beams", front, to={"count": 4, "start_deg": 0.0, "step_deg": 90.0})
    assert work.mask.tolist() == [255, 0, 0, 0]
    assert work.reading.ranges_m[0] == 6.0
    assert np.isinf(work.reading.ranges_m[1:]).all()
    same = apply("resample_beams", front, replace(front, source="real"), to="real").reading
    assert same.ranges_m.tolist() == [5.0, 6.0, 7.0]
