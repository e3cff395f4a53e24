"""What a vehicle sends of its heading reaches the comparison: a peer in memory that says it."""

import asyncio
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.poses.headings import HeadingDifference

MAGNETOMETER = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK


def armed(fake_pair: Callable[..., Any], then: Callable[[Any], Any], peer_is: str = "px4") -> Any:
    """Arm the peer, and return what was found of its heading, and its events, after `then`."""

    async def fly() -> tuple[list[HeadingDifference], list[VehicleEvent]]:
        link, peer = fake_pair(peer_is)
        found: list[HeadingDifference] = []
        events: list[VehicleEvent] = []
        async with peer, Driver(name="real", link=link) as driver:
            driver.on_heading(found.append)
            driver.on_event(events.append)
            await driver.identify(5.0)
            await driver.ready(10.0)
            await driver.arm()
            found.clear()
            for _ in range(20):
                then(peer)
                await asyncio.sleep(0.1)
        return found, events

    return run_virtual(fly())


def last(found: list[HeadingDifference], source: str) -> HeadingDifference:
    return [one for one in found if one.source == source][-1]


def say(message: Any, peer: Any) -> None:
    peer.say(message)


def gps(*, yaw: int = 0, cog: int = 0xFFFF, vel: int = 200, fix: int = 3) -> Any:
    return mavlink.MAVLink_gps_raw_int_message(
        0, fix, 474000000, 85000000, 500000, 70, 110, vel, cog, 10, yaw=yaw
    )


@pytest.mark.parametrize("peer_is", ["px4", "ardupilot"])
def test_a_step_of_the_heading_is_found(fake_pair: Callable[..., Any], peer_is: str) -> None:
    def step(peer: Any) -> None:
        peer.yaw_rad = math.radians(-30.0)

    found, _ = armed(fake_pair, step, peer_is)
    assert math.degrees(last(found, "gyroscopes").turned_rad) == pytest.approx(-30.0, abs=0.3)


def test_heading_of_a_receiver_and_its_unknown_values(fake_pair: Callable[..., Any]) -> None:
    found, _ = armed(fake_pair, lambda peer: peer.say(gps(yaw=36000)))
    assert last(found, "gps yaw").turned_rad == pytest.approx(0.0, abs=1e-6)
    found, _ = armed(fake_pair, lambda peer: peer.say(gps(yaw=9000)))
    assert math.degrees(last(found, "gps yaw").turned_rad) == pytest.approx(-90.0)
    for unknown in (gps(yaw=0), gps(yaw=0xFFFF), gps(yaw=9000, fix=1), gps(cog=9000, vel=0xFFFF)):
        found, _ = armed(fake_pair, partial(say, unknown))
        assert {one.source for one in found} == {"gyroscopes"}


@pytest.mark.parametrize("used", [True, False])
def test_magnetometer_counts_where_the_autopilot_uses_it(
    fake_pair: Callable[..., Any], used: bool
) -> None:
    def say(peer: Any) -> None:
        enabled = MAGNETOMETER if used else 0
        health = MAGNETOMETER | PREARM
        peer.say(mavlink.MAVLink_sys_status_message(0, enabled, health, 0, 0, -1, 80, *[0] * 6))
        field = (0.0, 210.0, 430.0) if peer.armed and len(peer.received) else (210.0, 0.0, 430.0)
        peer.say(mavlink.MAVLink_raw_imu_message(0, *[0] * 6, *map(int, field)))

    found, _ = armed(fake_pair, say)
    assert ("magnetometer" in {one.source for one in found}) == used


def test_reset_of_the_estimator_is_an_event(fake_pair: Callable[..., Any]) -> None:
    counter = [4]

    def say(peer: Any) -> None:
        counter.append(5 if len(counter) > 10 else 4)
        peer.say(
            mavlink.MAVLink_odometry_message(
                0, 1, 1, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0, 0.0), *(0.0,) * 6,
                [0.0] * 21, [0.0] * 21, counter[-1], 8, 0,
            )
        )  # fmt: skip

    _, events = armed(fake_pair, say)
    texts = [event.text for event in events if event.kind == "estimator_reset"]
    assert texts == ["its estimator was reset (ODOMETRY reset_counter 4 to 5)"]
