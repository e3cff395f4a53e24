"""The driver over a bad radio: 5 % loss, 80 ms latency, 40 ms jitter, and worse."""

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np
import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.impaired_links.impaired import ImpairedLink
from wil_campaign.plugins.impaired_links.impairment import BurstLoss, Impairment, LinkOutage
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample, VehicleEvent
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.setpoints import VelocitySetpoint

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
BAD = Impairment(latency_s=0.08, jitter_s=0.04, loss=0.05)
HARSH = Impairment(
    latency_s=0.25,
    jitter_s=0.2,
    loss=0.12,
    bursts=BurstLoss(length_s=0.3, gap_s=5.0),
    duplicate=0.05,
    reorder=0.05,
    corrupt=0.02,
)
Script = Callable[[Driver, EmbeddedVehicle, ImpairedLink], Awaitable[Any]]


def _fly(autopilot: str, script: Script, *, bad: Impairment, seed: int) -> Any:
    async def fly() -> Any:
        ours, theirs = memory_pair(latency_s=0.003)
        link = ImpairedLink(link=ours, outgoing=bad, incoming=bad, rng=np.random.default_rng(seed))
        # ArduCopter boots for 40 s, of which the last ten show as much.
        config = EmbeddedConfig(autopilot=autopilot, running_s=30.0)
        async with (
            EmbeddedVehicle(config=config, link=theirs, seed=seed) as vehicle,
            Driver(name="real", link=link) as driver,
        ):
            return await script(driver, vehicle, link)

    return run_virtual(fly())


async def _up(driver: Driver) -> None:
    await driver.identify(8.0)
    await driver.ready(90.0)
    await driver.arm()
    await driver.begin_takeoff(1.5)
    await asyncio.sleep(6.0)
    await driver.enter_guided()


async def _north(driver: Driver, seconds: float) -> None:
    for _ in range(round(seconds * 20)):
        driver.send(VelocitySetpoint((0.5, 0.0, 0.0)))
        await asyncio.sleep(0.05)


async def _down(driver: Driver) -> None:
    await driver.hold()
    await driver.land()
    await driver.disarmed(40.0)


@BOTH
@pytest.mark.parametrize(("bad", "seed"), [(BAD, 6), (BAD, 7), (HARSH, 3), (HARSH, 4)])
def test_a_flight_over_a_bad_radio(autopilot: str, bad: Impairment, seed: int) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle, link: ImpairedLink) -> list[Any]:
        events: list[VehicleEvent] = []
        samples: list[EstimateSample] = []
        driver.on_event(events.append)
        driver.on_estimate(samples.append)
        await _up(driver)
        await _north(driver, 5.0)
        north_m, east_m, down_m = vehicle.truth().pose.position_ned_m
        assert 1.8 < north_m < 2.8
        assert abs(east_m) < 0.3
        assert -down_m == pytest.approx(1.5, abs=0.3)
        await _down(driver)
        name = "COM_OF_LOSS_T" if autopilot == "px4" else "GUID_TIMEOUT"
        await driver.parameters.set(name, 2.0)
        assert vehicle.autopilot.parameters[name] == 2.0
        # A better fit of the clocks may move the mapping back a little, but no sample comes twice.
        steps = list(itertools.pairwise(samples))
        assert all(before.boot_s < after.boot_s for before, after in steps)
        assert min(after.t_s - before.t_s for before, after in steps) > -0.15
        assert all(sample.arrived_s >= sample.t_s for sample in samples)
        assert link.incoming.lost > 0
        assert link.outgoing.lost > 0
        return events

    events = _fly(autopilot, script, bad=bad, seed=seed)
    assert not {"fault", "failsafe", "reboot"} & {event.kind for event in events}


def test_the_rate_that_was_asked_for_comes_though_the_request_was_lost() -> None:
    # PX4 sends positions by itself, at 20 Hz here: that they come at all says nothing.
    async def script(driver: Driver, vehicle: EmbeddedVehicle, link: ImpairedLink) -> float:
        await driver.identify(8.0)
        await driver.ready(90.0)
        samples: list[EstimateSample] = []
        driver.on_estimate(samples.append)
        await asyncio.sleep(4.0)
        return len(samples) / 4.0

    for seed in range(4, 8):
        assert _fly("px4", script, bad=Impairment(loss=0.4), seed=seed) > 20.0


@BOTH
def test_a_vehicle_survives_an_outage_of_3_s_in_flight(autopilot: str) -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle, link: ImpairedLink) -> list[Any]:
        events: list[VehicleEvent] = []
        await _up(driver)
        driver.on_event(events.append)
        await _north(driver, 2.0)
        link.start_outage(3.0)
        await _north(driver, 5.0)
        mode = driver.state.mode
        await _down(driver)
        return [mode, events]

    mode, events = _fly(autopilot, script, bad=BAD, seed=1)
    kinds = [event.kind for event in events if event.kind in {"link_lost", "link_back"}]
    assert kinds == ["link_lost", "link_back"]
    back = next(event for event in events if event.kind == "link_back")
    assert back.duration_s == pytest.approx(3.1, abs=0.2)
    unasked = [event for event in events if event.kind == "mode" and not event.asked]
    # COM_OF_LOSS_T is 1 s: PX4's failsafe took it out of OFFBOARD, which nobody heard, and it went
    # back once there were setpoints again. GUID_TIMEOUT stops ArduCopter, which stays in GUIDED.
    assert unasked == []
    assert mode is FlightMode.GUIDED


def test_a_scheduled_outage_on_the_ground_delays_only() -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle, link: ImpairedLink) -> float:
        await driver.identify(8.0)
        return asyncio.get_running_loop().time()

    dark = Impairment(outages=(LinkOutage(0.0, 3.0),))
    assert 3.0 < _fly("px4", script, bad=dark, seed=1) < 5.0


def test_the_same_seed_gives_the_same_flight() -> None:
    async def script(driver: Driver, vehicle: EmbeddedVehicle, link: ImpairedLink) -> list[Any]:
        samples: list[EstimateSample] = []
        driver.on_estimate(samples.append)
        await _up(driver)
        return samples

    first = _fly("px4", script, bad=BAD, seed=5)
    assert first == _fly("px4", script, bad=BAD, seed=5)
    assert len(first) > 100
