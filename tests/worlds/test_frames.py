import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from wil_campaign.worlds import frames as fr
from wil_campaign.worlds.frames import Pose, Quat, Vec3

components = st.floats(-1.0, 1.0)
angles = st.floats(-math.pi, math.pi)
metres = st.floats(-1e3, 1e3)
vectors = st.tuples(metres, metres, metres)
fractions = st.floats(0.0, 1.0)


@st.composite
def quaternions(draw: st.DrawFn) -> Quat:
    q = draw(st.tuples(components, components, components, components))
    assume(math.hypot(*q) > 1e-3)
    return fr.quat_normalize(q)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    return Pose(draw(vectors), draw(quaternions()))


def same_attitude(a: Quat, b: Quat, tolerance_rad: float = 1e-7) -> bool:
    return fr.angle_between(a, b) < tolerance_rad


@given(quaternions(), vectors)
def test_rotation_by_quaternion_and_matrix_agree_and_keep_length(q: Quat, v: Vec3) -> None:
    rotated = fr.rotate(q, v)
    assert rotated == pytest.approx(tuple(fr.matrix_from_quat(q) @ np.array(v)), abs=1e-9)
    assert fr.norm(rotated) == pytest.approx(fr.norm(v), abs=1e-9)


@given(quaternions())
def test_matrix_is_orthonormal_and_right_handed(q: Quat) -> None:
    m = fr.matrix_from_quat(q)
    np.testing.assert_allclose(m @ m.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(m) == pytest.approx(1.0)


@given(quaternions())
def test_matrix_round_trip(q: Quat) -> None:
    back = fr.quat_from_matrix(fr.matrix_from_quat(q))
    assert back[0] >= 0
    assert same_attitude(q, back)


@given(angles, st.floats(-1.57, 1.57), angles)
def test_euler_round_trip_as_attitude(roll: float, pitch: float, yaw: float) -> None:
    q = fr.quat_from_euler(roll, pitch, yaw)
    assert same_attitude(q, fr.quat_from_euler(*fr.euler_from_quat(q)), 1e-6)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_euler_round_trip_as_angles(roll: float, pitch: float, yaw: float) -> None:
    back = fr.euler_from_quat(fr.quat_from_euler(roll, pitch, yaw))
    for got, given_ in zip(back, (roll, pitch, yaw), strict=True):
        assert fr.wrap_pi(got - given_ + 1.0) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@given(roll=angles, yaw=angles)
def test_euler_at_gimbal_lock_keeps_the_attitude(pitch: float, roll: float, yaw: float) -> None:
    q = fr.quat_from_euler(roll, pitch, yaw)
    angles_back = fr.euler_from_quat(q)
    assert angles_back[0] == 0.0
    assert same_attitude(q, fr.quat_from_euler(*angles_back), 1e-5)


def test_yaw_then_pitch_then_roll() -> None:
    nose_up_facing_east = fr.quat_from_euler(0.0, math.radians(30), math.radians(90))
    nose = fr.rotate(nose_up_facing_east, (1.0, 0.0, 0.0))
    assert nose == pytest.approx((0.0, math.cos(math.radians(30)), -0.5))
    rolled_right = fr.quat_from_euler(math.radians(90), 0.0, 0.0)
    assert fr.rotate(rolled_right, (0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.0, 1.0))


@given(vectors)
def test_axis_swaps_are_their_own_inverse(v: Vec3) -> None:
    assert fr.ned_from_enu(fr.ned_from_enu(v)) == v
    assert fr.frd_from_flu(fr.frd_from_flu(v)) == v


def test_axis_swaps_name_the_axes() -> None:
    assert fr.ned_from_enu((1.0, 2.0, 3.0)) == (2.0, 1.0, -3.0)
    assert fr.frd_from_flu((1.0, 2.0, 3.0)) == (1.0, -2.0, -3.0)


@given(st.floats(-1e4, 1e4))
@example(-math.nextafter(math.pi, 4.0))
def test_wrap_pi_is_in_range_and_keeps_the_direction(angle: float) -> None:
    wrapped = fr.wrap_pi(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


@given(quaternions(), quaternions(), quaternions())
def test_product_is_composition(a: Quat, b: Quat, c: Quat) -> None:
    v = (0.3, -0.2, 0.9)
    assert fr.rotate(fr.quat_multiply(a, b), v) == pytest.approx(
        fr.rotate(a, fr.rotate(b, v)), abs=1e-12
    )
    left = fr.quat_multiply(fr.quat_multiply(a, b), c)
    assert left == pytest.approx(fr.quat_multiply(a, fr.quat_multiply(b, c)), abs=1e-12)


@given(quaternions(), quaternions(), fractions)
def test_slerp_turns_evenly_on_the_shorter_way(a: Quat, b: Quat, fraction: float) -> None:
    whole = fr.angle_between(a, b)
    assume(whole < math.pi - 1e-3)
    middle = fr.slerp(a, b, fraction)
    assert math.hypot(*middle) == pytest.approx(1.0)
    assert fr.angle_between(a, middle) == pytest.approx(fraction * whole, abs=1e-4)
    assert fr.angle_between(middle, b) == pytest.approx((1 - fraction) * whole, abs=1e-4)


@given(quaternions(), quaternions())
def test_slerp_ends_and_sign(a: Quat, b: Quat) -> None:
    assert same_attitude(fr.slerp(a, b, 0.0), a)
    assert same_attitude(fr.slerp(a, b, 1.0), b)
    minus_b = (-b[0], -b[1], -b[2], -b[3])
    assume(abs(sum(x * y for x, y in zip(a, b, strict=True))) > 1e-6)
    assert same_attitude(fr.slerp(a, b, 0.4), fr.slerp(a, minus_b, 0.4))


@given(poses(), vectors)
def test_pose_round_trip_of_points(pose: Pose, point: Vec3) -> None:
    assert pose.to_local(pose.to_parent(point)) == pytest.approx(point, abs=1e-6)


@given(poses(), poses(), vectors)
def test_compose_is_one_after_the_other(outer: Pose, inner: Pose, point: Vec3) -> None:
    composed = outer.compose(inner).to_parent(point)
    assert composed == pytest.approx(outer.to_parent(inner.to_parent(point)), abs=1e-6)


@given(poses())
def test_inverse_undoes(pose: Pose) -> None:
    nothing = pose.compose(pose.inverse())
    assert fr.norm(nothing.position_ned_m) < 1e-6
    assert same_attitude(nothing.q_wxyz, fr.IDENTITY)


@given(poses(), poses(), fractions)
def test_interpolation_lies_on_the_straight_way(a: Pose, b: Pose, fraction: float) -> None:
    middle = a.interpolate(b, fraction)
    whole = fr.norm(fr.subtract(b.position_ned_m, a.position_ned_m))
    part = fr.norm(fr.subtract(middle.position_ned_m, a.position_ned_m))
    assert part == pytest.approx(fraction * whole, abs=1e-6)


@given(angles)
def test_pose_of_files_values(yaw: float) -> None:
    pose = Pose.of(1.0, 2.0, 3.0, yaw_rad=yaw)
    assert pose.position_ned_m == (1.0, 2.0, -3.0)
    assert fr.wrap_pi(pose.yaw_rad - yaw + 1.0) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0, 0, 1), (math.inf, 0, 0, 0)])
def test_no_direction_is_refused(q: Quat) -> None:
    with pytest.raises(ValueError, match="no direction"):
        fr.quat_normalize(q)
