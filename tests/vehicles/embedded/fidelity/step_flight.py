"""The flight of step responses on an embedded vehicle, in virtual time.

Over a link in memory with 3 ms, by the driver and the flight of the product.
"""

from collections.abc import Mapping

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.step_response.event_order import EventTrace, OrderRow, order_rows
from wil_campaign.plugins.step_response.flight import StepFlight
from wil_campaign.plugins.step_response.segments import Series
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig, Physics
from wil_campaign.vehicles.embedded.profile import load_profile
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.tapped import TappedLink

PROFILES: dict[str, str] = {"px4": "px4-sih", "ardupilot": "ardupilot-sitl"}


def fly_steps(
    autopilot: str,
    profile: str | None = None,
    *,
    physics: Physics = "jsbsim",
    seed: int = 1,
    parameters: Mapping[str, float] | None = None,
) -> tuple[Series, list[OrderRow]]:
    """Return the series and the orders of the flight of an embedded vehicle, in virtual time."""

    async def scenario() -> tuple[Series, list[OrderRow]]:
        near, far = memory_pair(latency_s=0.003)
        config = EmbeddedConfig(
            autopilot=autopilot,
            physics=physics,
            profile=load_profile(profile or PROFILES[autopilot]),
            parameters=parameters or {},
        )
        trace = EventTrace(autopilot=autopilot_named(autopilot), target=MavlinkTarget(1))
        link = TappedLink(far)
        link.tap(trace.receive)
        driver = Driver(name=autopilot, link=link, max_clock_drift=0.02)
        async with EmbeddedVehicle(config=config, link=near, seed=seed), driver:
            await driver.identify(10.0)
            flown = await StepFlight(driver).fly()
        return flown, order_rows(trace.events, autopilot)

    return run_virtual(scenario())
