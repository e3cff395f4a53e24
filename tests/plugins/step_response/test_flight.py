"""A flight of step responses that something ends early says what, and does not go on."""

import asyncio
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.step_response.flight import StepFlight
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

Disturb = Callable[[EmbeddedVehicle, Link], None]


def lose(vehicle: EmbeddedVehicle, _: Link) -> None:
    vehicle.mute(muted=True)


def take_over(_: EmbeddedVehicle, link: Link) -> None:
    poshold = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 16, 0, 0, 0, 0, 0)
    link.write(MavlinkCodec(system_id=255, component_id=190).pack(poshold))


def terminate(_: EmbeddedVehicle, link: Link) -> None:
    disarm = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 21196, 0, 0, 0, 0, 0)
    link.write(MavlinkCodec(system_id=255, component_id=190).pack(disarm))


@pytest.mark.parametrize(
    ("disturb", "said"),
    [
        (lose, "ardupilot: the link was lost in 'speed 0.4'"),
        (take_over, "ardupilot: the vehicle changed to POSHOLD in 'speed 0.4'"),
        (terminate, "ardupilot: the vehicle disarmed in 'speed 0.4'"),
    ],
)
def test_the_cause_of_an_early_end_is_named(disturb: Disturb, said: str) -> None:
    begun: list[str] = []

    async def scenario() -> None:
        near, far = memory_pair(latency_s=0.003)
        config = EmbeddedConfig(
            autopilot="ardupilot", profile=load_profile("nominal"), running_s=60.0
        )
        vehicle = EmbeddedVehicle(config=config, link=near, seed=1)
        driver = Driver(name="ardupilot", link=far)

        def progress(name: str) -> None:
            begun.append(name)
            if name == "speed 0.4":
                asyncio.get_running_loop().call_later(1.0, disturb, vehicle, far)

        async with vehicle, driver:
            await driver.identify(10.0)
            await StepFlight(driver, progress=progress).fly()

    with pytest.raises(VehicleError, match=said):
        run_virtual(scenario())
    assert begun == ["ready", "arm", "takeoff", "speed 0.4"]
