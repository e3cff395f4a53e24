"""Ranges in MAVLink's messages, by its own units and axes: what is said is what is read."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.lidar.distance_sensor import BEAMS, rangefinder_reading
from wil_campaign.plugins.lidar.lidar import LidarOptions
from wil_campaign.plugins.lidar.obstacle_distance import lidar_reading
from wil_campaign.plugins.lidar.rangefinder import LOOKING_DOWN, RangefinderOptions
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.sources.readings.live_readings import UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import MavlinkSensor, MessageTimes

WHEN = MessageTimes(10.0, 10.02, "real")
TURN = LidarOptions(beams=72)


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


def below(*, sensor_id: int | None = None, **limits: Any) -> MavlinkSensor:
    options = RangefinderOptions.model_validate(limits)
    return MavlinkSensor(
        message="DISTANCE_SENSOR", options=options, mount=LOOKING_DOWN, sensor_id=sensor_id
    )


def test_a_distance_is_in_centimetres_and_beyond_its_limit_is_nothing() -> None:
    def read(message: Any) -> float:
        found = rangefinder_reading(message, WHEN, below())
        assert found is not None
        assert (found.range_min_m, found.range_max_m) == pytest.approx((0.2, 12.0))
        assert reading_fault(found) is None
        return found.range_m

    assert read(distance(250)) == pytest.approx(2.5)
    assert math.isinf(read(distance(1201)))
    assert math.isinf(read(distance(250, signal_quality=1))), "MAVLink: 1 is an invalid signal"


def test_a_distance_of_another_sensor_or_direction_is_not_taken() -> None:
    assert rangefinder_reading(distance(), WHEN, below(sensor_id=4)) is None
    with pytest.raises(UnusableReadingError, match="MAV_SENSOR_ROTATION_NONE"):
        rangefinder_reading(distance(orientation=0), WHEN, below())


def test_limits_in_another_unit_than_the_campaign_s_are_refused() -> None:
    both: tuple[dict[str, Any], ...] = ({"range_max_m": 1.2}, {"range_min_m": 20.0})
    for limits in both:
        with pytest.raises(UnusableReadingError, match="another unit"):
            rangefinder_reading(distance(), WHEN, below(**limits))
    said = below(range_min_m=0.2, range_max_m=12.0)
    assert rangefinder_reading(distance(), WHEN, said)


def test_of_two_sensors_that_look_in_one_direction_one_is_taken() -> None:
    """As a sector of ArduPilot's proximity is, and the rangefinder ahead."""
    vehicle: Any = SimpleNamespace(state=None)
    read = BEAMS.reader(below(), vehicle)
    assert read(distance(), WHEN) is not None
    for _ in range(2):
        with pytest.raises(UnusableReadingError, match="sensors 3 and 10 look in one direction"):
            read(distance(700, id=10), WHEN)
        assert read(distance(), WHEN) is not None


def ranges(
    message: Any, beams: LidarOptions = TURN, heading_rad: float | None = None
) -> list[float]:
    sensor = MavlinkSensor(message="OBSTACLE_DISTANCE", options=beams)
    found = lidar_reading(message, WHEN, sensor, heading_rad=heading_rad)
    assert reading_fault(found) is None
    assert len(found.ranges_m) == beams.beams
    return [round(float(one), 3) for one in found.ranges_m]


def test_sectors_go_clockwise_from_ahead() -> None:
    found = ranges(scan({0: 100, 18: 200, 36: 300, 54: 400, 1: 65535}))
    assert [found[k] for k in (36, 54, 0, 18)] == [1.0, 2.0, 3.0, 4.0]
    assert sum(math.isfinite(one) for one in found) == 4, "unknown and empty sectors are inf"


def test_each_beam_has_the_distance_of_the_sector_that_it_is_in() -> None:
    wide = scan({0: 100, 1: 200}, increment=0, exact=10.0, others=65535)
    beams = LidarOptions(beams=5, fov_deg=16.0)  # from -8 to 8 deg by 4
    assert ranges(wide, beams) == [math.inf, 1.0, 1.0, 1.0, 2.0]
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


def test_a_scan_of_which_nothing_is_known_is_not_a_free_room() -> None:
    """PX4 goes on sending it when the lidar behind it has died."""
    with pytest.raises(UnusableReadingError, match="each of its sectors is unknown"):
        ranges(scan({}, others=65535))
    ahead = LidarOptions(beams=5, fov_deg=20.0)
    with pytest.raises(UnusableReadingError, match="each of its sectors is unknown"):
        ranges(scan({36: 300}, others=65535), ahead)
    assert all(map(math.isinf, ranges(scan({}))))
