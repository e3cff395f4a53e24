"""The conversions that docs/simulator-protocol.md gives for game engines are right."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.plugins.mocap.motion_capture import pose_from_enu
from wil_campaign.worlds.frames import Pose, Quat, Vec3, angle_between, quat_from_euler, rotate

angles = st.floats(-3.1, 3.1)
poses = st.builds(
    lambda p, r, y, point: (p, quat_from_euler(r, y, p[0]), point),
    st.tuples(*[st.floats(-50.0, 50.0)] * 3),
    angles,
    angles,
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
)


def unity(v: Vec3) -> Vec3:
    return (v[1], -v[2], v[0])


def unity_rotation(q: Quat) -> Quat:
    w, x, y, z = q
    return (w, -y, z, -x)


def unreal(v: Vec3) -> Vec3:
    return (v[0], v[1], -v[2])


def unreal_rotation(q: Quat) -> Quat:
    w, x, y, z = q
    return (w, -x, -y, z)


def mujoco(v: Vec3) -> Vec3:
    return (v[0], -v[1], -v[2])


def mujoco_rotation(q: Quat) -> Quat:
    w, x, y, z = q
    return (w, x, -y, -z)


def gazebo_rotation(q: Quat) -> Quat:
    w, x, y, z = q
    a = math.sqrt(0.5)
    return (a * (w + z), a * (x + y), a * (x - y), a * (w - z))


@given(poses)
def test_unity_sees_points_where_we_do(pose: tuple[Vec3, Quat, Vec3]) -> None:
    position, q, point = pose
    ours = Pose(position, q).to_parent(point)
    # Quaternions of left-handed engines turn vectors by the same formula.
    turned = rotate(unity_rotation(q), unity(point))
    theirs = np.add(unity(position), turned)
    assert theirs == pytest.approx(unity(ours), abs=1e-9)


@given(poses)
def test_unreal_sees_points_where_we_do(pose: tuple[Vec3, Quat, Vec3]) -> None:
    position, q, point = pose
    ours = Pose(position, q).to_parent(point)
    theirs = np.add(unreal(position), rotate(unreal_rotation(q), unreal(point)))
    assert theirs == pytest.approx(unreal(ours), abs=1e-9)


@given(poses)
def test_mujoco_sees_points_where_we_do(pose: tuple[Vec3, Quat, Vec3]) -> None:
    position, q, point = pose
    ours = Pose(position, q).to_parent(point)
    theirs = np.add(mujoco(position), rotate(mujoco_rotation(q), mujoco(point)))
    assert theirs == pytest.approx(mujoco(ours), abs=1e-9)


@given(poses)
def test_gazebo_sees_points_where_we_do(pose: tuple[Vec3, Quat, Vec3]) -> None:
    (north, east, down), q, _ = pose
    back = pose_from_enu((east, north, -down), gazebo_rotation(q))
    assert back.position_ned_m == pytest.approx((north, east, down))
    assert angle_between(back.q_wxyz, q) < 1e-7
