"""Positions and attitudes paired in the vehicle's time; long texts put together."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.driver.estimates import EstimatePairing, Estimates
from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.driver.vehicle_state import LocalEstimate
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.worlds.frames import Pose, quat_from_euler

HERE = (1.0, 2.0, -3.0)
STILL = (0.0, 0.0, 0.0)


def _yaw(yaw_rad: float) -> tuple[float, float, float, float]:
    return quat_from_euler(0.0, 0.0, yaw_rad)


def test_same_moment_pairs_in_either_order() -> None:
    pairing = EstimatePairing()
    assert pairing.attitude(1.0, _yaw(0.1)) is None
    assert pairing.position(1.0, HERE, STILL) == (LocalEstimate(1.0, Pose(HERE, _yaw(0.1)), STILL),)
    assert pairing.position(1.02, HERE, STILL) == ()
    assert pairing.attitude(1.02, _yaw(0.2)) == LocalEstimate(1.02, Pose(HERE, _yaw(0.2)), STILL)


def test_a_position_between_attitudes_gets_the_one_in_between() -> None:
    pairing = EstimatePairing()
    pairing.attitude(1.0, _yaw(0.0))
    assert pairing.position(1.01, HERE, STILL) == ()
    estimate = pairing.attitude(1.02, _yaw(0.2))
    assert estimate is not None
    assert estimate.pose.yaw_rad == pytest.approx(0.1)
    # One that comes late still finds its place among those that are kept.
    (late,) = pairing.position(1.005, HERE, STILL)
    assert late.pose.yaw_rad == pytest.approx(0.05)


def test_when_attitudes_stop_the_last_serves_for_a_while() -> None:
    pairing = EstimatePairing(max_age_s=0.2)
    pairing.attitude(1.0, _yaw(0.3))
    assert pairing.position(1.1, HERE, STILL) == ()
    (first,) = pairing.position(1.3, HERE, STILL)
    assert (first.boot_s, first.pose.q_wxyz) == (1.1, _yaw(0.3))
    assert pairing.position(1.4, HERE, STILL) == ()
    assert pairing.dropped == 1


def test_without_attitudes_there_are_no_estimates() -> None:
    pairing = EstimatePairing()
    assert all(pairing.position(t * 0.1, HERE, STILL) == () for t in range(10))
    assert pairing.dropped == 9


def test_attitudes_out_of_order_are_skipped_and_a_restart_starts_anew() -> None:
    pairing = EstimatePairing()
    pairing.attitude(100.0, _yaw(0.1))
    assert pairing.attitude(99.99, _yaw(0.5)) is None
    (estimate,) = pairing.position(100.0, HERE, STILL)
    assert estimate.pose.q_wxyz == _yaw(0.1)
    pairing.attitude(0.5, _yaw(0.7))
    (estimate,) = pairing.position(0.5, HERE, STILL)
    assert estimate.pose.q_wxyz == _yaw(0.7)


def test_a_vehicle_that_crosses_the_date_line_is_beyond_it() -> None:
    """PX4's longitude goes on: 180.00001 degrees are -179.99999."""
    link, _ = memory_pair(latency_s=0.0)
    session = MavlinkSession(link=link, own=MavlinkTarget(245, 190))
    session.target = MavlinkTarget(1, 1)
    estimates, codec = (
        Estimates(session=session, clock=VehicleClock()),
        MavlinkCodec(system_id=1, component_id=1),
    )
    estimates.local = LocalEstimate(0.0, Pose((0.0, 0.0, -1.0)), (0.0, 0.0, 0.0))
    unknown = 2**31 - 1
    for place in ((0, 1_799_999_900), (0, 1_800_000_100), (unknown, unknown)):
        message = mavlink.MAVLink_global_position_int_message(0, *place, 0, 0, 0, 0, 0, 0)
        session.received(codec.pack(message), 0.0)
    assert estimates.place_deg is not None
    assert estimates.place_deg[1] == pytest.approx(-179.99999)
    told: list[tuple[str, float]] = []
    estimates.on_unusable = lambda why, t_s: told.append((why, t_s))
    infinite = mavlink.MAVLink_attitude_message(0, float("inf"), 0.0, 0.0, 0.0, 0.0, 0.0)
    for t_s in (0.0, 0.9, 1.1):
        session.received(codec.pack(infinite), t_s)
    assert told == [("its ATTITUDE is not a number", t_s) for t_s in (0.0, 1.1)]


@pytest.mark.parametrize("again_s", [1.01, 1.005])
def test_a_position_that_comes_again_or_late_takes_no_attitude_from_the_one_that_waits(
    again_s: float,
) -> None:
    pairing = EstimatePairing()
    pairing.attitude(1.0, _yaw(0.0))
    assert pairing.position(1.01, HERE, STILL) == ()
    assert pairing.position(again_s, HERE, STILL) == ()
    estimate = pairing.attitude(1.02, _yaw(0.2))
    assert estimate is not None
    assert estimate.pose.yaw_rad == pytest.approx(0.1)
    assert pairing.dropped == 1
