"""An attached vehicle flies again, whatever ended the flight before: each driver finds it so."""

import asyncio
from typing import Any, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.vehicles.autopilots.autopilot import FlightMode, MavlinkTarget, command_long
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import NotReadyError
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.setpoints import VelocitySetpoint

FLIGHTS = 10
_FORCED = 21196.0
_SPEED = VelocitySetpoint((0.5, 0.0, 0.0))


class Lasting:
    """A link that outlasts the drivers that use it one after the other."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self.name = link.name

    def receive(self, receiver: Any) -> None:
        self._link.receive(receiver)

    def write(self, data: bytes) -> None:
        self._link.write(data)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self._link.receive(lambda *_: None)


async def _at(driver: Driver, height_m: float) -> None:
    """Wait until a driver's vehicle is as high by its estimate."""
    there = asyncio.Event()

    def look(sample: EstimateSample) -> None:
        if -sample.pose.position_ned_m[2] >= height_m:
            there.set()

    driver.on_estimate(look)
    await there.wait()


async def _flown(driver: Driver, height_m: float = 1.5) -> None:
    """Fly up and on, as a run does; who ends it comes afterwards."""
    await driver.identify(5.0)
    await driver.ready(90.0)
    await driver.arm()
    await driver.begin_takeoff(height_m)
    async with asyncio.timeout(30.0):
        await _at(driver, height_m - 0.2)
    await driver.enter_guided()
    for _ in range(20):
        driver.send(_SPEED)
        await asyncio.sleep(0.05)


ENDS = ("landed", "returned", "disarmed in the air", "told to land once more")
"""Who ends every second flight, one after the other: a guard, a pilot, a ground station."""


def _end(autopilot: str, end: str) -> Any:
    """Return what somebody else commands a flying vehicle, which ends its flight."""
    target = MavlinkTarget(1, 1)
    if end == "disarmed in the air":
        return command_long(target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, _FORCED)
    mode = FlightMode.RTL if end == "returned" else FlightMode.LAND
    return autopilot_named(autopilot).set_mode(target, mode)


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_ten_flights_in_a_row_of_which_somebody_else_ends_every_second(
    autopilot: str,
) -> None:
    async def fly() -> int:
        ours, theirs = memory_pair(latency_s=0.002)
        guard = MavlinkCodec(system_id=250, component_id=1)
        flown = 0
        config = EmbeddedConfig(autopilot=autopilot)
        async with EmbeddedVehicle(config=config, link=theirs, seed=1), ours:
            for number in range(FLIGHTS):
                end = ENDS[number // 2 % len(ENDS)] if number % 2 else None
                async with Driver(name="real", link=Lasting(ours)) as driver:
                    await _flown(driver)
                    if end is None:
                        await driver.land()
                    else:
                        ours.write(guard.pack(_end(autopilot, end)))
                    await driver.disarmed(300.0)
                if end == "told to land once more":
                    # What a guard insists on may arrive when it is down: PX4 then stays in LAND.
                    ours.write(guard.pack(_end(autopilot, end)))
                await asyncio.sleep(3.0)
                flown += 1
        return flown

    assert run_virtual(fly()) == FLIGHTS


def test_a_mode_that_somebody_chose_is_left_and_named_with_the_remedy() -> None:
    async def fly() -> None:
        ours, theirs = memory_pair(latency_s=0.002)
        pilot = MavlinkCodec(system_id=250, component_id=1)
        async with (
            EmbeddedVehicle(config=EmbeddedConfig(autopilot="px4"), link=theirs, seed=1),
            Driver(name="real", link=ours) as driver,
        ):
            await driver.identify(5.0)
            mission = command_long(
                MavlinkTarget(1, 1), mavlink.MAV_CMD_DO_SET_MODE,
                float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), 4.0, 4.0,
            )  # fmt: skip
            ours.write(pilot.pack(mission))
            with pytest.raises(NotReadyError, match=r"it is in MISSION; switch it to Hold"):
                await driver.ready(30.0)
            assert driver.state.mode is FlightMode.MISSION

    run_virtual(fly())
