"""The embedded ArduCopter stops before what it is told of, when it is set up to."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.ardupilot.copter.avoidance import (
    SimpleAvoidance,
    avoidance_stopping_speed,
)
from wil_campaign.plugins.ardupilot.copter.copter_core import CopterCore
from wil_campaign.plugins.injection.range_messages import nothing_measured
from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import load_parameters
from wil_campaign.worlds.frames import Pose


def avoidance(**changed: float) -> SimpleAvoidance:
    overrides = {"PRX1_TYPE": 2.0, "AVOID_MARGIN": 1.0, **changed}
    return SimpleAvoidance(
        load_parameters(CopterCore.firmware.parameter_file, bytewise=False, overrides=overrides)
    )


def ring(distances_m: dict[int, float], *, longest_m: float = 10.0) -> Any:
    """Return a message with distances by sector of 5 degrees; elsewhere nothing is."""
    distances = [round(100 * distances_m.get(k, longest_m + 0.01)) for k in range(72)]
    return mavlink.MAVLink_obstacle_distance_message(
        0, 0, distances, 5, 20, round(100 * longest_m), 5.0, 0.0, mavlink.MAV_FRAME_BODY_FRD
    )


EDGE = math.cos(math.radians(22.5))
"""The boundary runs straight between the edges of a face, as far as its nearest object."""


def test_it_slows_towards_a_wall_and_flies_away_from_it() -> None:
    stop = avoidance()
    stop.obstacle_distance(ring({0: 1.5}), 10.0)
    ahead_m_s = 1.5 * EDGE - 1.0
    assert stop.limited((2.0, 0.0, 0.0), 0.0, 10.1) == pytest.approx((ahead_m_s, 0.0, 0.0))
    # The wall is ahead of the body, wherever it looks.
    assert stop.limited((0.0, 2.0, 0.0), math.pi / 2, 10.1) == pytest.approx((0.0, ahead_m_s, 0.0))
    assert stop.limited((-2.0, 0.0, 0.0), 0.0, 10.1) == (-2.0, 0.0, 0.0)


def test_beside_a_face_without_a_distance_the_boundary_is_a_cup() -> None:
    stop = avoidance()
    stop.obstacle_distance(ring({0: 1.5}), 10.0)
    north, east, _ = stop.limited((2.0, 2.0, 0.0), 0.0, 10.1)
    assert (north + east) / math.sqrt(2.0) <= 1.5 * EDGE - 1.0 + 1e-9


def test_a_distance_is_filtered_as_prx_filt_says() -> None:
    """A first-order filter: after 0.1 s 0.1 / (0.1 + 1 / (2 pi 0.25 Hz)) of a step."""
    for cutoff_hz, share in ((0.25, 0.1 / (0.1 + 2.0 / math.pi)), (0.0, 1.0)):
        stop = avoidance(PRX_FILT=cutoff_hz)
        stop.obstacle_distance(ring({0: 3.0}), 10.0)
        stop.obstacle_distance(ring({0: 2.0}), 10.1)
        most_m_s = avoidance_stopping_speed((3.0 - share) * EDGE - 1.0)
        assert stop.limited((9.0, 0.0, 0.0), 0.0, 10.1)[0] == pytest.approx(most_m_s)
        stop.obstacle_distance(ring({0: 1.5}), 11.2)  # after a second it begins anew
        assert stop.limited((9.0, 0.0, 0.0), 0.0, 11.2)[0] == pytest.approx(1.5 * EDGE - 1.0)


@pytest.mark.parametrize("changed", [{"PRX1_TYPE": 0.0}, {"AVOID_ENABLE": 1.0}])
def test_it_ignores_obstacles_when_it_is_not_set_up_for_them(changed: dict[str, float]) -> None:
    stop = avoidance(**changed)
    stop.obstacle_distance(ring({0: 1.0}), 10.0)
    assert stop.limited((2.0, 0.0, 0.0), 0.0, 10.1) == (2.0, 0.0, 0.0)


def test_an_obstacle_is_forgotten_after_a_second() -> None:
    stop = avoidance()
    stop.obstacle_distance(ring({0: 1.0}), 10.0)
    assert stop.limited((2.0, 0.0, 0.0), 0.0, 11.0)[0] == pytest.approx(0.0)
    assert stop.limited((2.0, 0.0, 0.0), 0.0, 11.01) == (2.0, 0.0, 0.0)


def test_rangefinders_to_the_sides_count_as_well() -> None:
    stop = avoidance()
    right = mavlink.MAVLink_distance_sensor_message(0, 20, 1000, 120, 0, 1, 2, 255)
    down = mavlink.MAVLink_distance_sensor_message(0, 20, 1000, 30, 0, 1, 25, 255)
    stop.distance_sensor(right, 5.0)
    stop.distance_sensor(down, 5.0)
    assert stop.limited((0.0, 1.0, 0.0), 0.0, 5.1)[1] <= 1.2 * EDGE - 1.0
    assert stop.limited((0.0, -1.0, 0.0), 0.0, 5.1) == (0.0, -1.0, 0.0)


def test_nothing_is_armed_beside_a_wall() -> None:
    stop = avoidance()
    stop.obstacle_distance(ring({18: 0.5, 3: 0.7}), 1.0)
    assert stop.arming_fault(1.2) == "Proximity 90 deg, 0.50m (want > 0.6m)"
    stop.obstacle_distance(ring({18: 0.7}), 3.0)
    assert stop.arming_fault(3.1) is None


def test_nothing_is_armed_while_the_sensor_is_silent() -> None:
    """ArduCopter 4.6 in SITL: "PreArm: PRX1: No Data"."""
    stop = avoidance()
    assert stop.arming_fault(0.0) == "PRX1: No Data"
    stop.obstacle_distance(nothing_measured(None, 1.0), 1.0)
    assert stop.arming_fault(1.5) is None
    assert stop.arming_fault(1.6) == "PRX1: No Data"
    sideways = Pose.of(0.0, 0.0, 0.0, yaw_rad=math.pi / 2.0)
    stop.distance_sensor(nothing_measured(sideways, 2.0), 2.0)
    assert stop.arming_fault(2.1) is None
    assert stop.limited((5.0, 5.0, 0.0), 0.0, 2.1) == (5.0, 5.0, 0.0)
    assert avoidance(PRX1_TYPE=0.0).arming_fault(0.0) is None


@given(st.floats(0.0, 50.0), st.floats(0.0, 50.0))
def test_from_farther_away_it_may_be_faster_and_can_still_stop(a_m: float, b_m: float) -> None:
    near_m, far_m = sorted((a_m, b_m))
    assert avoidance_stopping_speed(near_m) <= avoidance_stopping_speed(far_m)
    # At 2.5 m/s^2 it comes to rest within the distance.
    assert avoidance_stopping_speed(far_m) ** 2 / 5.0 <= far_m + 1e-9
