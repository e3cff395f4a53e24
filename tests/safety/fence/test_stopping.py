"""The path of a vehicle that is told to stop, and the acceleration that it is predicted from."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.stopping import (
    AccelerationEstimate,
    VehicleMotion,
    longest_path_m,
    stopping_path,
    velocities_ahead,
)
from wil_campaign.worlds.frames import Vec3

HERE: Vec3 = (0.0, 0.0, -1.0)
STANDING: Vec3 = (0.0, 0.0, 0.0)
HALL = Fence.box(north_m=(-9, 2), east_m=(-9, 9), up_m=(0, 4))


speed = st.floats(-12, 12)
vector = st.tuples(speed, speed, speed)


def breaks(motion: VehicleMotion) -> bool:
    return HALL.breached(motion, latency_s=0.5, braking_m_s2=2.5) is not None


def test_a_steady_vehicle_flies_on_for_the_latency_and_brakes() -> None:
    motion = VehicleMotion(HERE, (2.0, 0.0, 0.0))
    path = stopping_path(motion, (2.0, 0.0, 0.0), latency_s=0.5, braking_m_s2=2.5)
    assert path.braking_from_ned_m == pytest.approx((1.0, 0.0, -1.0))
    assert path.end_ned_m == pytest.approx((1.8, 0.0, -1.0))
    assert path.length_m == pytest.approx(1.8)


def test_a_vehicle_that_accelerates_is_stopped_sooner() -> None:
    # 1.4 m/s: 0.7 m and 0.39 m. With 2 m/s^2: 0.83 m, then 1.9 m/s and 0.72 m.
    assert not breaks(VehicleMotion((0.6, 0.0, -1.0), (1.4, 0.0, 0.0)))
    assert breaks(VehicleMotion((0.6, 0.0, -1.0), (1.4, 0.0, 0.0), (2.0, 0.0, 0.0)))
    assert not breaks(VehicleMotion((0.6, 0.0, -1.0), (1.4, 0.0, 0.0), (-2.0, 0.0, 0.0)))
    assert not breaks(VehicleMotion((0.6, 0.0, -1.0), (0.0, 1.4, 0.0), (2.5, 0.0, 0.0)))


def test_a_known_command_takes_the_place_of_the_acceleration() -> None:
    # It accelerates to 1.4 m/s, and no further.
    motion = VehicleMotion((0.6, 0.0, -1.0), (1.4, 0.0, 0.0), (2.0, 0.0, 0.0), (1.4, 0.0, 0.0))
    assert not breaks(motion)


def test_a_slowing_vehicle_counts_as_steady() -> None:
    assert breaks(VehicleMotion(HERE, (2.2, 0.0, 0.0), (-2.0, 0.0, 0.0)))
    assert breaks(VehicleMotion(HERE, (2.2, 0.0, 0.0), commanded_ned_m_s=STANDING))


def test_a_command_counts_as_far_as_it_is_reached_by_then() -> None:
    near = (1.5, 0.0, -1.0)
    assert not breaks(VehicleMotion(near, STANDING, commanded_ned_m_s=(0.8, 0.0, 0.0)))
    assert breaks(VehicleMotion(near, STANDING, commanded_ned_m_s=(3.5, 0.0, 0.0)))
    assert not breaks(VehicleMotion(near, STANDING, commanded_ned_m_s=(0.0, 3.5, 0.0)))
    ahead = list(
        velocities_ahead(
            VehicleMotion(near, STANDING, commanded_ned_m_s=(9.0, 0.0, 0.0)),
            latency_s=0.5,
            braking_m_s2=2.0,
        )
    )
    assert ahead == [STANDING, (1.0, 0.0, 0.0)]


def test_a_reading_that_jumps_is_not_taken_for_an_acceleration_beyond_the_braking() -> None:
    motion = VehicleMotion(HERE, STANDING, (500.0, 0.0, 0.0))
    *_, then = velocities_ahead(motion, latency_s=0.5, braking_m_s2=2.0)
    assert then == pytest.approx((0.5, 0.0, 0.0))


def test_a_firmware_that_leaves_the_ground_is_not_taken_over() -> None:
    # LOCAL_POSITION_NED of ArduCopter 4.7 in a takeoff, 20 Hz from liftoff on: (height, climb).
    takeoff = (
        *((0.02, 0.19), (0.03, 0.22), (0.05, 0.24), (0.06, 0.27), (0.07, 0.30), (0.09, 0.33)),
        *((0.11, 0.36), (0.13, 0.53), (0.16, 0.79), (0.21, 1.00), (0.26, 1.14), (0.32, 1.21)),
        *((0.38, 1.22), (0.43, 1.21), (0.49, 1.18), (0.55, 1.16), (0.60, 1.14), (0.66, 1.15)),
    )
    fence = Fence.box(north_m=(-9, 9), east_m=(-9, 9), up_m=(-0.5, 2.3))
    estimate = AccelerationEstimate()
    for i, (height_m, climb_m_s) in enumerate(takeoff):
        velocity = (0.0, 0.0, -climb_m_s)
        motion = VehicleMotion((0.0, 0.0, -height_m), velocity, estimate.update(velocity, 0.05 * i))
        assert fence.breached(motion, latency_s=0.7, braking_m_s2=2.5) is None, height_m


def test_a_climb_into_the_ceiling_is_stopped_sooner_than_a_steady_one() -> None:
    def breaks_ceiling(climbing_m_s2: float) -> bool:
        motion = VehicleMotion((0.0, 0.0, -3.0), (0.0, 0.0, -1.2), (0.0, 0.0, -climbing_m_s2))
        return breaks(motion)

    assert not breaks_ceiling(0.0)
    assert breaks_ceiling(2.5)


@pytest.mark.parametrize("east_m", [0.2, 0.4])
def test_both_parts_of_the_path_count(east_m: float) -> None:
    wall = Fence.box(north_m=(-9, 9), east_m=(-9, east_m), up_m=(0, 4))
    turning = VehicleMotion(HERE, (0.0, 0.0, 0.0), commanded_ned_m_s=(0.0, 1.0, 0.0))
    path = stopping_path(turning, (0.0, 1.0, 0.0), latency_s=0.5, braking_m_s2=2.5)
    assert path.braking_from_ned_m[1] == pytest.approx(0.25)
    assert path.end_ned_m[1] == pytest.approx(0.45)
    assert wall.breached(turning, latency_s=0.5, braking_m_s2=2.5) is not None


@pytest.mark.parametrize("rate_hz", [10, 30, 50, 120, 250])
def test_the_acceleration_is_that_of_the_last_0_3_s_at_any_rate(rate_hz: int) -> None:
    estimate = AccelerationEstimate()
    got = STANDING
    for i in range(rate_hz):
        t_s = 100.0 + i / rate_hz
        got = estimate.update((2.0 * max(0.0, t_s - 100.5), 0.0, 1.0), t_s)
    assert got == pytest.approx((2.0, 0.0, 0.0))


def test_without_a_span_of_velocities_there_is_no_acceleration() -> None:
    estimate = AccelerationEstimate()
    assert estimate.update((0.0, 0.0, 0.0), 1.0) == STANDING
    assert estimate.update((5.0, 0.0, 0.0), 1.1) == STANDING
    assert estimate.update((5.0, 0.0, 0.0), 1.2)[0] == pytest.approx(25.0)
    # A gap, and a clock that goes back: nothing is compared across them.
    assert estimate.update((0.0, 0.0, 0.0), 2.0) == STANDING
    assert estimate.update((9.0, 0.0, 0.0), 1.0) == STANDING


def test_no_more_velocities_are_kept_than_are_compared() -> None:
    estimate = AccelerationEstimate()
    for i in range(5000):
        estimate.update((math.sin(i), 0.0, 0.0), i / 1000)
    assert len(estimate._velocities) <= 8


@given(vector, vector, st.none() | vector, st.floats(0, 2), st.floats(0.1, 10))
def test_no_path_is_longer_than_the_longest_one(
    velocity: Vec3, acceleration: Vec3, commanded: Vec3 | None, late: float, brake: float
) -> None:
    """What is nearer to a boundary than this is looked at; all else is no breach."""
    motion = VehicleMotion(HERE, velocity, acceleration, commanded)
    most_m = longest_path_m(motion, latency_s=late, braking_m_s2=brake)
    for then in velocities_ahead(motion, latency_s=late, braking_m_s2=brake):
        path = stopping_path(motion, then, latency_s=late, braking_m_s2=brake)
        assert path.length_m <= most_m * (1.0 + 1e-12) + 1e-9
