"""The guard with the embedded PX4 and ArduCopter: whenever it is called, both come down."""

import asyncio
import functools
import math
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Literal

import numpy as np
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.guard.core.commands import BringDown, OperatorAction, OrchestratorAlive
from wil_campaign.safety.guard.core.events import GuardedVehicle
from wil_campaign.safety.guard.core.operator_command import OperatorCommand
from wil_campaign.safety.guard.local_guard import GuardLinks, LocalGuard
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.autopilots.autopilot import MavlinkTarget
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.setpoints import VelocitySetpoint

Cause = Literal["abort", "bring_down", "killed"]
CAUSES: tuple[Cause, ...] = ("abort", "bring_down", "killed")
KINDS: dict[str, str] = {"real": "px4", "twin": "ardupilot"}
ALTITUDE_M = 1.5
FENCE_NORTH_M = 6.0
FASTEST_LANDING_S = 30.0


class Pair:
    """An embedded PX4 and an embedded ArduCopter behind the guard, with a driver each."""

    def __init__(self, seed: int, fence_north_m: float = FENCE_NORTH_M) -> None:
        fence = Fence.box(north_m=(-2, fence_north_m), east_m=(-3, 3), up_m=(-1, 4))
        self.vehicles: dict[str, EmbeddedVehicle] = {}
        self.drivers: dict[str, Driver] = {}
        links: dict[str, GuardLinks] = {}
        guarded: dict[str, GuardedVehicle] = {}
        for system_id, (name, kind) in enumerate(KINDS.items(), start=1):
            far, near = memory_pair(latency_s=0.003, name=name)
            inner, outer = memory_pair(name=f"{name} guard")
            config = EmbeddedConfig(autopilot=kind, system_id=system_id, running_s=30.0)
            self.vehicles[name] = EmbeddedVehicle(config=config, link=far, seed=seed)
            self.drivers[name] = Driver(name=name, link=outer, autopilot=kind)
            links[name] = GuardLinks(near, inner)
            guarded[name] = GuardedVehicle(
                autopilot=autopilot_named(kind),
                target=MavlinkTarget(system_id),
                fence=fence,
                attached=True,
            )
        self.guard = LocalGuard(vehicles=guarded, links=links)

    async def open(self, stack: AsyncExitStack) -> None:
        for vehicle in self.vehicles.values():
            await stack.enter_async_context(vehicle)
        await stack.enter_async_context(self.guard)
        for name, driver in self.drivers.items():
            await stack.enter_async_context(driver)
            driver.on_estimate(self._listener(name))

    def _listener(self, name: str) -> Callable[[EstimateSample], None]:
        def listen(sample: EstimateSample) -> None:
            pose = PoseSample(sample.arrived_s, name, sample.pose, sample.velocity_ned_m_s)
            self.guard.position(pose)

        return listen

    async def fly(self, north_m_s: float) -> None:
        """Do what an orchestrator does, until it is stopped."""
        beat = asyncio.create_task(self._beat(), name="beat")
        try:
            drivers = self.drivers.values()
            for driver in drivers:
                await driver.identify(10.0)
            for driver in drivers:
                await driver.ready(90.0)
            for driver in drivers:
                await driver.arm()
            await asyncio.gather(*[driver.begin_takeoff(ALTITUDE_M) for driver in drivers])
            await asyncio.sleep(8.0)
            ahead = VelocitySetpoint((north_m_s, 0.0, 0.0))
            for driver in drivers:
                driver.send(ahead)
            for driver in drivers:
                await driver.enter_guided()
            for _ in range(200):
                for driver in drivers:
                    driver.send(ahead)
                await asyncio.sleep(0.05)
            for driver in drivers:
                await driver.land()
            for driver in drivers:
                await driver.disarmed(60.0)
        finally:
            beat.cancel()

    async def _beat(self) -> None:
        while True:
            self.guard.send(OrchestratorAlive())
            await asyncio.sleep(0.1)

    def standing(self) -> dict[str, bool]:
        """Return which vehicles truly stand on the ground, disarmed."""
        return {
            name: vehicle.truth().pose.position_ned_m[2] > -0.2
            and not self.drivers[name].state.armed
            for name, vehicle in self.vehicles.items()
        }


async def interrupt(cause: Cause, at_s: float, seed: int) -> None:
    pair = Pair(seed)
    async with AsyncExitStack() as stack:
        await pair.open(stack)
        flight = asyncio.create_task(pair.fly(0.4), name="flight")
        await asyncio.wait([flight], timeout=at_s)
        if cause == "abort":
            pair.guard.send(OperatorAction(OperatorCommand("abort", "anna")))
        elif cause == "bring_down":
            pair.guard.send(BringDown("the test says so"))
        elif cause == "killed":
            flight.cancel()
        # An orchestrator that dies before anything is armed leaves nothing to bring down.
        nothing_flew = cause == "killed" and not any(d.state.armed for d in pair.drivers.values())
        assert await pair.guard.all_down(FASTEST_LANDING_S) or nothing_flew, pair.guard.events
        flight.cancel()
        await asyncio.gather(flight, return_exceptions=True)
        assert pair.standing() == {"real": True, "twin": True}


async def run_into_the_fence(speed_m_s: float, fence_north_m: float) -> float:
    """Return how far north a pair truly came; both are down, and stayed inside."""
    pair = Pair(3, fence_north_m)
    farthest_m = {"real": -math.inf, "twin": -math.inf}

    def watch(name: str, sample: TruthSample) -> None:
        farthest_m[name] = max(farthest_m[name], sample.pose.position_ned_m[0])

    async with AsyncExitStack() as stack:
        await pair.open(stack)
        for name, vehicle in pair.vehicles.items():
            vehicle.on_truth(functools.partial(watch, name), 50.0)
        flight = asyncio.create_task(pair.fly(speed_m_s), name="flight")
        await asyncio.wait([flight], timeout=60.0)
        assert await pair.guard.all_down(FASTEST_LANDING_S), pair.guard.events
        flight.cancel()
        await asyncio.gather(flight, return_exceptions=True)
        assert pair.guard.core.latched == "fence"
        assert pair.standing() == {"real": True, "twin": True}
    assert max(farthest_m.values()) < fence_north_m
    return max(farthest_m.values())


async def whole_flight() -> None:
    pair = Pair(seed=1)
    async with AsyncExitStack() as stack:
        await pair.open(stack)
        await pair.fly(0.4)
        assert pair.guard.core.latched is None
        assert pair.guard.core.dropped == {}
        assert pair.standing() == {"real": True, "twin": True}


def test_a_flight_in_which_all_is_well_is_not_disturbed() -> None:
    run_virtual(whole_flight())


@pytest.mark.parametrize("speed_m_s", [0.8, 1.5, 3.0])
def test_the_truth_stays_inside_of_the_fence(speed_m_s: float) -> None:
    # It came near: a guard that stops everything at once would keep it inside too.
    assert run_virtual(run_into_the_fence(speed_m_s, FENCE_NORTH_M)) > FENCE_NORTH_M / 2


def test_a_fence_that_is_met_in_the_acceleration_holds() -> None:
    # An ArduCopter on its way to 3.5 m/s ends its acceleration late: from 1.7 m/s it flies 3.5 m.
    assert run_virtual(run_into_the_fence(3.5, 3.0)) > 0.2


@pytest.mark.parametrize("case", range(12))
def test_interrupted_at_any_moment_both_come_down(case: int) -> None:
    generator = np.random.default_rng([5, case])
    cause = CAUSES[case % len(CAUSES)]
    # The takeoff command comes at about 12 s: ArduCopter's estimator takes 41 s to trust its GPS,
    # and has been on for 30.
    at_s = float(generator.uniform(0.5, 36.0))
    run_virtual(interrupt(cause, at_s, seed=case))
