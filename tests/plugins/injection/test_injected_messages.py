"""What goes to the autopilot: units, frames, rates."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.injection.injector import PLANS, InjectionPlan, PacedMessages
from wil_campaign.plugins.injection.pose_messages import (
    PoseSpread,
    landing_target,
    odometry_message,
    vision_position_estimate,
)
from wil_campaign.plugins.injection.range_messages import (
    UNKNOWN_CM,
    distance_sensor_message,
    obstacle_distance,
    sensor_orientation,
)
from wil_campaign.plugins.injection.traffic_messages import Intruder, adsb_vehicle
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.readings import LidarScanReading, PoseReading, RangefinderReading
from wil_campaign.worlds.frames import Pose

HERE = Pose((0.0, 0.0, 0.0))


def wired(message: Any) -> Any:
    """Return a message as the autopilot decodes it."""
    (found,) = MavlinkCodec(system_id=1, component_id=1).parse(
        MavlinkCodec(system_id=255, component_id=190).pack(message)
    )
    return found


def scan(
    ranges_m: list[float], start_deg: float, step_deg: float, mount: Pose = HERE
) -> LidarScanReading:
    return LidarScanReading(
        t_s=12.345678,
        arrived_s=12.4,
        seq=0,
        source="mixed",
        ranges_m=np.array(ranges_m, np.float32),
        start_angle_rad=math.radians(start_deg),
        step_rad=math.radians(step_deg),
        range_min_m=0.2,
        range_max_m=12.0,
        mount=mount,
    )


def test_a_scan_fills_the_sectors_that_it_looks_at() -> None:
    message = wired(obstacle_distance(scan([3.0, math.inf, 1.5], -90.0, 90.0)))
    assert message.time_usec == 12_345_678
    assert message.frame == mavlink.MAV_FRAME_BODY_FRD
    assert (message.increment, message.increment_f, message.angle_offset) == (5, 5.0, 0.0)
    assert (message.min_distance, message.max_distance) == (20, 1200)
    expected = [UNKNOWN_CM] * 72
    expected[54], expected[0], expected[18] = 300, 1201, 150
    assert list(message.distances) == expected


def test_the_nearest_of_a_sector_counts() -> None:
    message = wired(obstacle_distance(scan([5.0, 2.0, math.inf, 4.0], -1.5, 1.0)))
    assert message.distances[0] == 200
    assert set(message.distances[1:]) == {UNKNOWN_CM}


def test_a_whole_turn_leaves_no_sector_unknown() -> None:
    message = wired(obstacle_distance(scan([7.0] * 360, -180.0, 1.0)))
    assert set(message.distances) == {700}


def test_the_mount_turns_and_shifts_the_scan() -> None:
    turned = Pose.of(0.0, 0.0, 0.0, yaw_rad=math.radians(90.0))
    assert wired(obstacle_distance(scan([2.0], 0.0, 1.0, turned))).distances[18] == 200
    ahead = Pose((0.5, 0.0, 0.0))
    assert wired(obstacle_distance(scan([2.0], 0.0, 1.0, ahead))).distances[0] == 250
    upside_down = Pose.of(0.0, 0.0, 0.0, roll_rad=math.pi)
    assert wired(obstacle_distance(scan([2.0], 90.0, 1.0, upside_down))).distances[54] == 200


def test_a_beam_that_is_no_number_is_unknown_and_never_free() -> None:
    message = wired(obstacle_distance(scan([math.nan, math.nan], 0.0, 90.0)))
    assert set(message.distances) == {UNKNOWN_CM}


@given(
    ranges=st.lists(st.floats(0.0, 1000.0) | st.just(math.inf), min_size=1, max_size=100),
    start=st.floats(-360.0, 360.0),
    step=st.floats(-10.0, 10.0),
)
def test_no_obstacle_is_ever_lost(ranges: list[float], start: float, step: float) -> None:
    message = wired(obstacle_distance(scan(ranges, start, step)))
    nearest_cm = min(min(ranges) * 100.0, 1201.0)
    assert min(message.distances) == pytest.approx(nearest_cm, abs=0.6)


def rangefinder(range_m: float, mount: Pose = HERE) -> RangefinderReading:
    return RangefinderReading(1.5, 1.5, 0, "mixed", range_m, 0.1, 8.0, mount)


def looking(pitch_deg: float, yaw_deg: float = 0.0) -> Pose:
    return Pose.of(0, 0, 0, pitch_rad=math.radians(pitch_deg), yaw_rad=math.radians(yaw_deg))


def test_a_rangefinder_that_looks_down_becomes_a_distance_sensor() -> None:
    message = wired(distance_sensor_message(rangefinder(2.344, looking(-90.0))))
    assert (message.time_boot_ms, message.current_distance) == (1500, 234)
    assert (message.min_distance, message.max_distance) == (10, 800)
    assert message.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270


@pytest.mark.parametrize("range_m", [math.inf, 8.5])
def test_a_beam_that_met_nothing_is_beyond_the_longest(range_m: float) -> None:
    assert wired(distance_sensor_message(rangefinder(range_m))).current_distance == 801
    with pytest.raises(ValueError, match="is NaN"):
        distance_sensor_message(rangefinder(math.nan))


@pytest.mark.parametrize(
    ("pitch", "yaw", "orientation"),
    [
        (0, 0, 0),
        (0, 45, 1),
        (5, 92, 2),
        (0, 180, 4),
        (0, -90, 6),
        (0, -46, 7),
        (0, -20, 0),
        (-85, 30, 25),
        (88, 0, 24),
        (-45, 0, 100),
    ],
)
def test_directions_have_names(pitch: float, yaw: float, orientation: int) -> None:
    assert sensor_orientation(looking(pitch, yaw)) == orientation


def test_an_odd_direction_carries_its_attitude() -> None:
    mount = looking(-45.0)
    message = wired(distance_sensor_message(rangefinder(1.0, mount)))
    assert message.quaternion == pytest.approx(mount.q_wxyz)


def test_an_intruder_becomes_an_adsb_vehicle() -> None:
    intruder = Intruder(10.0, 0xABCDEF, "WIL0001", 47.5, -8.5, 512.3, (3.0, -4.0, -1.5))
    message = wired(adsb_vehicle(intruder, now_s=12.5))
    assert (message.ICAO_address, message.callsign) == (0xABCDEF, "WIL0001")
    assert (message.lat, message.lon, message.altitude) == (475_000_000, -85_000_000, 512_300)
    assert message.hor_velocity == 500
    assert message.ver_velocity == 150
    assert message.heading == 30_687
    assert message.tslc == 2
    assert message.flags & mavlink.ADSB_FLAGS_SIMULATED
    assert message.flags & mavlink.ADSB_FLAGS_VALID_COORDS


@pytest.mark.parametrize(
    ("icao", "latitude", "words"),
    [(0, 1.0, "ICAO"), (1 << 24, 1.0, "ICAO"), (1, 91.0, "not on Earth")],
)
def test_an_impossible_intruder_is_refused(icao: int, latitude: float, words: str) -> None:
    intruder = Intruder(0.0, icao, "X", latitude, 0.0, 0.0, (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=words):
        adsb_vehicle(intruder, now_s=0.0)


EAST = Pose.of(1.0, 2.0, 3.0, yaw_rad=math.pi / 2)


def pose_reading(velocity: tuple[float, float, float] | None = (0.0, 1.0, 0.25)) -> PoseReading:
    return PoseReading(2.0, 2.01, "real", EAST, velocity)


def test_a_vision_position_estimate() -> None:
    message = wired(vision_position_estimate(pose_reading()))
    assert (message.usec, message.x, message.y, message.z) == (2_000_000, 1.0, 2.0, -3.0)
    assert (message.roll, message.pitch) == (0.0, 0.0)
    assert message.yaw == pytest.approx(math.pi / 2)
    assert math.isnan(message.covariance[0])


def test_covariances_stand_on_the_diagonal() -> None:
    message = wired(vision_position_estimate(pose_reading(), spread=PoseSpread(0.1, 0.2)))
    diagonal = [message.covariance[k] for k in (0, 6, 11, 15, 18, 20)]
    assert diagonal == pytest.approx([0.01] * 3 + [0.04] * 3)
    assert sum(message.covariance) == pytest.approx(0.15)


@pytest.mark.parametrize(("autopilot", "frame"), [("px4", 1), ("ardupilot", 20)])
def test_odometry_has_the_frame_that_each_takes(autopilot: Any, frame: int) -> None:
    message = wired(odometry_message(pose_reading(), autopilot=autopilot))
    assert (message.frame_id, message.child_frame_id) == (frame, mavlink.MAV_FRAME_BODY_FRD)
    assert (message.x, message.y, message.z) == (1.0, 2.0, -3.0)
    assert message.q == pytest.approx(EAST.q_wxyz)
    # It flies east and looks east: forward.
    assert (message.vx, message.vy, message.vz) == pytest.approx((1.0, 0.0, 0.25))
    # PX4's EKF2 takes no odometry of MAV_ESTIMATOR_TYPE_MOCAP; ArduPilot does not look.
    assert message.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_VISION


def test_odometry_without_a_velocity_is_refused_for_ardupilot_alone() -> None:
    message = wired(odometry_message(pose_reading(None), autopilot="px4"))
    assert math.isnan(message.vx)
    with pytest.raises(ValueError, match="VISION_POSITION_ESTIMATE"):
        odometry_message(pose_reading(None), autopilot="ardupilot")


def test_a_landing_target_for_each_autopilot() -> None:
    above = Pose.of(1.0, 2.0, 3.0, yaw_rad=math.pi / 2)
    target = (1.0, 3.0, 0.0)
    for_px4 = wired(landing_target(1.0, target_ned_m=target, body=above, autopilot="px4"))
    assert (for_px4.frame, for_px4.position_valid) == (mavlink.MAV_FRAME_LOCAL_NED, 1)
    assert (for_px4.x, for_px4.y, for_px4.z) == pytest.approx(target)
    for_ap = wired(landing_target(1.0, target_ned_m=target, body=above, autopilot="ardupilot"))
    assert for_ap.frame == mavlink.MAV_FRAME_BODY_FRD
    # The target is 1 m east of it, and it looks east: ahead and below.
    assert (for_ap.x, for_ap.y, for_ap.z) == pytest.approx((1.0, 0.0, 3.0), abs=1e-6)
    assert for_ap.distance == pytest.approx(math.sqrt(10.0))
    # What ArduPilot makes of the angles alone: (-tan(angle_y), tan(angle_x), 1).
    assert -math.tan(for_ap.angle_y) == pytest.approx(1.0 / 3.0)
    assert math.tan(for_ap.angle_x) == pytest.approx(0.0, abs=1e-6)


def test_a_thing_is_sent_at_its_rate_and_each_once() -> None:
    paced = PacedMessages(InjectionPlan(rate_hz=10.0, max_age_s=0.2))
    sent = []
    for k in range(1000):
        now_s = k / 1000
        if k % 20 == 0:
            paced.offer(k, now_s)
        message = paced.due(now_s)
        if message is not None:
            sent.append(now_s)
    assert len(sent) == paced.sent == 11
    assert np.diff(sent) == pytest.approx(0.1, abs=0.021)
    assert sent[-1] == pytest.approx(1.0, abs=0.011)


def test_an_uneven_feed_of_the_same_rate_is_sent_whole() -> None:
    paced = PacedMessages(InjectionPlan(rate_hz=10.0, max_age_s=0.2))
    early_late = [0.0, 0.004, -0.003, 0.002, -0.004] * 20
    for k, off_s in enumerate(early_late):
        paced.offer(k, 0.1 * k + off_s)
        assert paced.due(0.1 * k + off_s) == k
    assert (paced.sent, paced.replaced) == (100, 0)


def test_a_slow_feed_is_sent_as_it_comes_and_not_repeated() -> None:
    paced = PacedMessages(InjectionPlan(rate_hz=10.0, max_age_s=0.2))
    times = [k / 1000 for k in range(2000)]
    sent = []
    for now_s in times:
        if now_s in {0.0, 0.7, 1.9}:
            paced.offer("x", now_s)
        if paced.due(now_s) is not None:
            sent.append(now_s)
    assert sent == [0.0, 0.7, 1.9]


def test_a_stale_message_is_counted_and_not_sent() -> None:
    paced = PacedMessages(InjectionPlan(rate_hz=10.0, max_age_s=0.2))
    paced.offer("old", 1.0)
    assert paced.due(1.3) is None
    assert paced.stale == 1
    paced.offer("a", 1.4)
    paced.offer("b", 1.41)
    assert paced.due(1.42) == "b"
    assert paced.replaced == 1


def test_plans_fit_the_time_outs_of_the_autopilots() -> None:
    forgotten_s = {"obstacle_distance": 0.5, "vision_position_estimate": 0.2, "odometry": 0.2}
    for name, limit_s in forgotten_s.items():
        assert 2.0 / PLANS[name].rate_hz < limit_s
        assert PLANS[name].max_age_s < limit_s
    with pytest.raises(ValueError, match="positive"):
        InjectionPlan(0.0, 1.0)
