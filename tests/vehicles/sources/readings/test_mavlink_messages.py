"""Sensor messages of MAVLink, by its own units and axes: what is said is what is read."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.readings import GpsReading
from wil_campaign.vehicles.readings.checks import fault_of
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    UNSTATED,
    Beams,
    StatedReach,
    Times,
    gps_reading,
    imu_reading,
    lidar_reading,
    rangefinder_reading,
    stamp_s,
)
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

WHEN = Times(10.0, 10.02, "real")
DOWN = Pose.of(0.0, 0.0, 0.0, pitch_rad=-math.pi / 2.0)
TURN = Beams(72, -math.pi, math.radians(5.0))


def distance(current: int = 250, **changes: int) -> Any:
    given = {"orientation": mavlink.MAV_SENSOR_ROTATION_PITCH_270, "id": 3, "signal_quality": 0}
    given |= changes
    return mavlink.MAVLink_distance_sensor_message(
        5000, 20, 1200, current, 0, given["id"], given["orientation"], 0,
        signal_quality=given["signal_quality"],
    )  # fmt: skip


def scan(
    distances: dict[int, int],
    *,
    offset: float = 0.0,
    increment: int = 5,
    frame: int = mavlink.MAV_FRAME_BODY_FRD,
    exact: float = 0.0,
    others: int = 1201,
) -> Any:
    sectors = [distances.get(k, others) for k in range(72)]
    return mavlink.MAVLink_obstacle_distance_message(
        5_000_000, 0, sectors, increment, 20, 1200, exact, offset, frame
    )


def fix(**changes: int) -> Any:
    given = {
        "fix_type": 3, "alt_ellipsoid": 535_000, "h_acc": 900, "v_acc": 1800, "vel": 500,
        "cog": 9000,
    } | changes  # fmt: skip
    return mavlink.MAVLink_gps_raw_int_message(
        5_000_000, given["fix_type"], 473_977_000, 85_456_000, 488_000, 70, 110, given["vel"],
        given["cog"], 12, given["alt_ellipsoid"], given["h_acc"], given["v_acc"],
    )  # fmt: skip


def test_a_distance_is_in_centimetres_and_beyond_its_limit_is_nothing() -> None:
    def read(message: Any) -> float:
        found = rangefinder_reading(message, WHEN, mount=DOWN, reach=UNSTATED, sensor_id=None)
        assert found is not None
        assert (found.range_min_m, found.range_max_m) == pytest.approx((0.2, 12.0))
        assert fault_of(found) is None
        return found.range_m

    assert read(distance(250)) == pytest.approx(2.5)
    assert math.isinf(read(distance(1201)))
    assert math.isinf(read(distance(250, signal_quality=1))), "MAVLink: 1 is an invalid signal"


def test_a_distance_of_another_sensor_or_direction_is_not_taken() -> None:
    assert rangefinder_reading(distance(), WHEN, mount=DOWN, reach=UNSTATED, sensor_id=4) is None
    with pytest.raises(UnusableReadingError, match="MAV_SENSOR_ROTATION_NONE"):
        rangefinder_reading(
            distance(orientation=0), WHEN, mount=DOWN, reach=UNSTATED, sensor_id=None
        )


def test_limits_in_another_unit_than_the_campaign_s_are_refused() -> None:
    for reach in (StatedReach(max_m=1.2), StatedReach(min_m=20.0)):
        with pytest.raises(UnusableReadingError, match="another unit"):
            rangefinder_reading(distance(), WHEN, mount=DOWN, reach=reach, sensor_id=None)
    said = StatedReach(min_m=0.2, max_m=12.0)
    assert rangefinder_reading(distance(), WHEN, mount=DOWN, reach=said, sensor_id=None)


def ranges(message: Any, beams: Beams = TURN, heading_rad: float | None = None) -> list[float]:
    found = lidar_reading(
        message, WHEN, pattern=beams, mount=AT_ORIGIN, reach=UNSTATED, heading_rad=heading_rad
    )
    assert fault_of(found) is None
    assert len(found.ranges_m) == beams.count
    return [round(float(one), 3) for one in found.ranges_m]


def test_sectors_go_clockwise_from_ahead() -> None:
    found = ranges(scan({0: 100, 18: 200, 36: 300, 54: 400, 1: 65535}))
    assert [found[k] for k in (36, 54, 0, 18)] == [1.0, 2.0, 3.0, 4.0]
    assert sum(math.isfinite(one) for one in found) == 4, "unknown and empty sectors are inf"


def test_each_beam_has_the_distance_of_the_sector_that_it_is_in() -> None:
    wide = scan({0: 100, 1: 200}, increment=0, exact=10.0, others=65535)
    beams = Beams(5, math.radians(-4.0), math.radians(4.0))
    assert ranges(wide, beams) == [1.0, 1.0, 1.0, 2.0, 2.0]
    turned = scan({0: 100}, offset=90.0)
    assert ranges(turned)[54] == 1.0


def test_sectors_that_count_from_north_are_turned_by_the_heading() -> None:
    north = scan({0: 100}, frame=mavlink.MAV_FRAME_GLOBAL)
    assert ranges(north, heading_rad=math.radians(90.0))[18] == 1.0, "north is to the left"
    with pytest.raises(UnusableReadingError, match="heading is not known"):
        ranges(north)


def test_beams_that_are_in_no_sector_are_refused() -> None:
    with pytest.raises(UnusableReadingError, match="are outside of its 72 sectors of 2 degrees"):
        ranges(scan({}, increment=2))
    with pytest.raises(UnusableReadingError, match="no width"):
        ranges(scan({}, increment=0))


def test_an_imu_by_each_of_its_messages_feels_the_same() -> None:
    highres = mavlink.MAVLink_highres_imu_message(
        5_000_000, 0.5, 0.0, -9.80665, 0.1, 0.0, 0.0, 0, 0, 0, 0, 0, 0, 0, 0b111111
    )
    scaled = mavlink.MAVLink_scaled_imu_message(5000, 51, 0, -1000, 100, 0, 0, 0, 0, 0)
    raw = mavlink.MAVLink_raw_imu_message(5_000_000, 51, 0, -1000, 100, 0, 0, 0, 0, 0)
    for message in (highres, scaled, raw):
        found = imu_reading(message, WHEN)
        assert found.specific_force_frd_m_s2 == pytest.approx((0.5, 0.0, -9.80665), abs=1e-3)
        assert found.rates_frd_rad_s == pytest.approx((0.1, 0.0, 0.0))
        assert stamp_s(message) == (5.0, False)
    highres.fields_updated = 0b000111
    with pytest.raises(UnusableReadingError, match="lacks accelerations"):
        imu_reading(highres, WHEN)


def test_a_fix_has_its_height_above_the_ellipsoid_and_its_velocity() -> None:
    first = gps_reading(fix(), WHEN, before=None, undulation_m=None)
    assert (first.latitude_deg, first.longitude_deg) == pytest.approx((47.3977, 8.5456))
    assert first.altitude_m == pytest.approx(535.0)
    assert (first.horizontal_accuracy_m, first.vertical_accuracy_m) == pytest.approx((0.9, 1.8))
    later = Times(10.5, 10.52, "real")
    second = gps_reading(fix(alt_ellipsoid=535_200), later, before=first, undulation_m=None)
    assert isinstance(second, GpsReading)
    assert second.velocity_ned_m_s == pytest.approx((0.0, 5.0, -0.4), abs=1e-9)
    known = gps_reading(fix(alt_ellipsoid=0), WHEN, before=None, undulation_m=47.0)
    assert known.altitude_m == pytest.approx(535.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"fix_type": 2}, "no 3-D fix"),
        ({"alt_ellipsoid": 0}, "undulation_m"),
        ({"h_acc": 0}, "MAVLink 2"),
        ({"vel": 65535}, "no speed or no course"),
        ({"cog": 65535}, "no speed or no course"),
    ],
)
def test_a_fix_that_leaves_something_out_is_refused(changes: dict[str, int], said: str) -> None:
    with pytest.raises(UnusableReadingError, match=said):
        gps_reading(fix(**changes), WHEN, before=None, undulation_m=None)


def test_a_fix_that_stands_still_needs_no_direction() -> None:
    found = gps_reading(fix(vel=0, cog=65535), WHEN, before=None, undulation_m=None)
    assert found.velocity_ned_m_s[:2] == (0.0, 0.0)


def test_a_stamp_of_this_century_is_no_time_since_boot() -> None:
    message = fix()
    message.time_usec = 1_790_000_000_000_000
    assert stamp_s(message) == (1_790_000_000.0, True)
