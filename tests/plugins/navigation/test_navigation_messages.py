"""Sensor messages of MAVLink, by its own units and axes: what is said is what is read."""

from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.navigation.gps_messages import gps_reading
from wil_campaign.plugins.navigation.imu_messages import imu_reading
from wil_campaign.vehicles.clocks.timesync import VehicleClock
from wil_campaign.vehicles.readings import GpsReading
from wil_campaign.vehicles.sources.readings.live_readings import LiveReadings, UnusableReadingError
from wil_campaign.vehicles.sources.readings.mavlink_messages import (
    MavlinkSensor,
    MessageTimes,
    mavlink_reading,
    message_stamp_s,
)
from wil_campaign.vehicles.sources.readings.mavlink_readings import MavlinkReadings

WHEN = MessageTimes(10.0, 10.02, "real")


class _Vehicle:
    """A vehicle of which a test hands over the messages."""

    def __init__(self, clock: VehicleClock) -> None:
        self.clock = clock
        self.state: Any = None

    def on_message(self, _: int, handler: Callable[[Any, float], None]) -> None:
        self.handler = handler

    def on_estimate(self, listener: Callable[[Any], None]) -> None:
        raise AssertionError(listener)


def fix(**changes: int) -> Any:
    given = {
        "fix_type": 3, "alt_ellipsoid": 535_000, "h_acc": 900, "v_acc": 1800, "vel": 500,
        "cog": 9000,
    } | changes  # fmt: skip
    return mavlink.MAVLink_gps_raw_int_message(
        5_000_000, given["fix_type"], 473_977_000, 85_456_000, 488_000, 70, 110, given["vel"],
        given["cog"], 12, given["alt_ellipsoid"], given["h_acc"], given["v_acc"],
    )  # fmt: skip


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
        assert message_stamp_s(message) == (5.0, False)
    highres.fields_updated = 0b000111
    with pytest.raises(UnusableReadingError, match="lacks accelerations"):
        imu_reading(highres, WHEN)


async def test_stamps_of_sensors_begin_anew_after_49_days_as_the_vehicle_s_do() -> None:
    """HIGHRES_IMU goes on counting; SCALED_IMU, whose stamp has 32 bits, begins anew."""
    clock, round_s = VehicleClock(), 2**32 * 1e-3
    clock.stamped(round_s - 1.0, 99.0)
    clock.stamped(clock.since_boot(0.5), 100.5)
    highres = mavlink.MAVLink_highres_imu_message(
        round((round_s + 0.4) * 1e6), *[0.0] * 9, 0, 0, 0, 0, 0b111111
    )
    scaled = mavlink.MAVLink_scaled_imu_message(400, 51, 0, -1000, 100, 0, 0, 0, 0, 0)
    for message in (highres, scaled):
        into = LiveReadings(name="imu", what="", stall_s=60.0)
        name = message.get_type()
        vehicle, read = _Vehicle(clock), mavlink_reading("imu")
        sensor = MavlinkSensor(message=name)
        MavlinkReadings(sensor=sensor, side="real", into=into, read=read).attach(vehicle)
        vehicle.handler(message, 100.5)
        assert into.newest is not None, into.complaint
        assert into.newest.t_s == pytest.approx(100.4)


def test_a_fix_has_its_height_above_the_ellipsoid_and_its_velocity() -> None:
    first = gps_reading(fix(), WHEN, before=None, undulation_m=None)
    assert (first.latitude_deg, first.longitude_deg) == pytest.approx((47.3977, 8.5456))
    assert first.altitude_m == pytest.approx(535.0)
    assert (first.horizontal_accuracy_m, first.vertical_accuracy_m) == pytest.approx((0.9, 1.8))
    later = MessageTimes(10.5, 10.52, "real")
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
    assert message_stamp_s(message) == (1_790_000_000.0, True)
