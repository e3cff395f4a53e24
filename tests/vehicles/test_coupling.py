"""The law by which a twin follows: it closes in, also when it is slower, faster and told late."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.coupling import RESPONSE_S, following_setpoint
from wil_campaign.worlds.frames import Pose, Vec3, add, norm, scale, subtract

_STEP_S = 0.02
_LAG_S = 0.3


def distance_after_m(
    duration_s: float, *, gain: float, away_m: Vec3, leads_m_s: Vec3, late_s: float
) -> float:
    """Return how far a vehicle with a lag, that flies `gain` times as fast as asked, is behind."""
    place, speed = away_m, (0.0, 0.0, 0.0)
    for step in range(round(duration_s / _STEP_S)):
        seen_m = scale(leads_m_s, step * _STEP_S - late_s)
        asked = following_setpoint(
            leader=Pose(seen_m),
            velocity_ned_m_s=leads_m_s,
            acceleration_ned_m_s2=(0.0, 0.0, 0.0),
            age_s=late_s,
            own=Pose(place),
            own_age_s=0.0,
        )
        wanted = scale(asked.velocity_ned_m_s, gain)
        speed = add(speed, scale(subtract(wanted, speed), _STEP_S / _LAG_S))
        place = add(place, scale(speed, _STEP_S))
    return norm(subtract(place, scale(leads_m_s, duration_s)))


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("late_s", [0.0, 0.1])
def test_a_slower_and_a_faster_twin_keep_up(gain: float, late_s: float) -> None:
    left_m = distance_after_m(
        8.0, gain=gain, away_m=(-0.5, 0.3, 0.0), leads_m_s=(0.8, 0.0, 0.0), late_s=late_s
    )
    assert left_m < 0.8 * abs(1.0 - gain) / gain + 0.05


def test_a_late_pose_of_the_leader_is_carried_on_to_now() -> None:
    asked = following_setpoint(
        leader=Pose((1.0, 0.0, 0.0)),
        velocity_ned_m_s=(2.0, 0.0, 0.0),
        acceleration_ned_m_s2=(0.0, 0.0, 0.0),
        age_s=0.1,
        own=Pose((1.2, 0.0, 0.0)),
        own_age_s=0.0,
    )
    assert asked.velocity_ned_m_s == pytest.approx((2.0, 0.0, 0.0))


def test_a_vehicle_that_speeds_up_is_followed_by_the_speed_that_it_is_going_to_have() -> None:
    asked = following_setpoint(
        leader=Pose((0.0, 0.0, 0.0)),
        velocity_ned_m_s=(0.5, 0.0, 0.0),
        acceleration_ned_m_s2=(1.0, 0.0, 0.0),
        age_s=0.0,
        own=Pose((0.0, 0.0, 0.0)),
        own_age_s=0.0,
    )
    assert asked.velocity_ned_m_s == pytest.approx((0.5 + RESPONSE_S, 0.0, 0.0))


@pytest.mark.parametrize(
    ("asked_m_s", "wanted_m_s"), [(0.8, 0.8), (0.2, 0.5), (2.0, 0.5 + 2.5 * RESPONSE_S)]
)
def test_a_vehicle_that_is_asked_for_a_speed_does_not_get_faster(
    asked_m_s: float, wanted_m_s: float
) -> None:
    asked = following_setpoint(
        leader=Pose((0.0, 0.0, 0.0)),
        velocity_ned_m_s=(0.0, 0.0, -0.5),
        acceleration_ned_m_s2=(0.0, 0.0, -2.5),
        age_s=0.0,
        own=Pose((0.0, 0.0, 0.0)),
        own_age_s=0.0,
        asked_ned_m_s=(0.0, 0.0, -asked_m_s),
    )
    assert asked.velocity_ned_m_s == pytest.approx((0.0, 0.0, -wanted_m_s))


@given(st.tuples(*[st.floats(-1e3, 1e3)] * 3), st.floats(-3.0, 3.0))
def test_it_never_dashes_and_faces_where_the_other_does(away_m: Vec3, yaw_rad: float) -> None:
    asked = following_setpoint(
        leader=Pose.of(0.0, 0.0, 1.0, yaw_rad=yaw_rad),
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        acceleration_ned_m_s2=(0.0, 0.0, 0.0),
        age_s=0.0,
        own=Pose(away_m),
        own_age_s=0.0,
    )
    assert norm(asked.velocity_ned_m_s) <= 2.0 + 1e-9
    assert asked.yaw_rad == pytest.approx(yaw_rad)
    assert math.isfinite(sum(asked.velocity_ned_m_s))
