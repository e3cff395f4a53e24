"""One flight, asked of every driver for every autopilot over every kind of link that it can use.

Over sockets, and with mavsdk, driver and vehicle share a loop whose time goes faster than the
wall's. Over sockets it waits for both; mavsdk's own goes with the wall.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import pytest

from tests.plugins.stream_links.test_flapping import patient_loop
from tests.ports import free_port
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.sim_clock_controller import ClockSegment
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.impaired_links.impaired import ImpairedLink
from wil_campaign.plugins.impaired_links.impairment import Impairment
from wil_campaign.plugins.mavsdk import mavsdk_client
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.command_backends import command_backend_of
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.onboard.mission_protocol import ItemList, MissionItem
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.mavlink.fence_areas import FenceCircle, FencePlace
from wil_campaign.vehicles.setpoints import VelocitySetpoint

LinkKind = Literal["memory", "impaired", "udp", "tcp"]
BAD = Impairment(latency_s=0.08, jitter_s=0.04, loss=0.05)
UNTIL_READY, IN_FLIGHT, EXCHANGE = 16.0, 4.0, 1.0
"""How fast time goes with mavsdk: a loaded machine must keep up while it flies, and for replies."""
AMPLE_S = 1000.0
"""A time limit that only ends what hangs: 16 s pass in one of a wall that waits for nobody."""
AUTOPILOTS: tuple[str, ...] = ("px4", "ardupilot")
LINKS: dict[str, tuple[LinkKind, ...]] = {
    "mavlink": get_args(LinkKind),
    "mavsdk": ("impaired", "udp", "tcp"),
}
EVERYWHERE = pytest.mark.parametrize(
    ("voice", "autopilot", "kind"),
    [(voice, name, kind) for voice in LINKS for name in AUTOPILOTS for kind in LINKS[voice]],
)


@dataclass
class Flown:
    driver: Driver
    vehicle: EmbeddedVehicle
    voice: str
    events: list[VehicleEvent] = field(default_factory=list)


Script = Callable[[Flown], Awaitable[None]]


def link_pair(kind: LinkKind) -> tuple[Link, Link]:
    """Return our end of a link, and the vehicle's."""
    if kind == "udp":
        port = free_port()
        ours, theirs = f"udpin://127.0.0.1:{port}", f"udpout://127.0.0.1:{port}"
        return open_link(parse_link(ours)), open_link(parse_link(theirs))
    if kind == "tcp":
        port = free_port()
        ours, theirs = f"tcpout://127.0.0.1:{port}", f"tcpin://127.0.0.1:{port}"
        return open_link(parse_link(ours)), open_link(parse_link(theirs))
    near, far = memory_pair(latency_s=0.003)
    if kind == "memory":
        return near, far
    rng = np.random.default_rng(6)
    return ImpairedLink(link=near, outgoing=BAD, incoming=BAD, rng=rng), far


def fly(autopilot: str, kind: LinkKind, script: Script, *, voice: str = "mavlink") -> Flown:
    async def flight() -> Flown:
        ours, theirs = link_pair(kind)
        async with AsyncExitStack() as stack:
            config = EmbeddedConfig(autopilot=autopilot, system_id=7)
            vehicle = EmbeddedVehicle(config=config, link=theirs, seed=1)
            await stack.enter_async_context(vehicle)
            driver = Driver(
                name="real",
                link=ours,
                autopilot=autopilot,
                system_id=7,
                backend=command_backend_of(voice, name="real"),
            )
            await stack.enter_async_context(driver)
            flown = Flown(driver, vehicle, voice)
            driver.on_event(flown.events.append)
            await script(flown)
            return flown

    if virtual(voice, kind):
        return run_virtual(flight())
    patient = voice == "mavlink"
    with asyncio.Runner(loop_factory=patient_loop if patient else hasty_loop) as runner:
        return runner.run(flight())


def virtual(voice: str, kind: LinkKind) -> bool:
    return voice == "mavlink" and kind in {"memory", "impaired"}


def hasty_loop() -> PacedLoop:
    """Return a loop whose clock waits for nobody, as mavsdk's does not."""
    return PacedLoop(UNTIL_READY)


def go_at(speed: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, PacedLoop)
    loop.follow(ClockSegment(time.monotonic(), loop.time(), speed))


async def up(flown: Flown) -> None:
    driver = flown.driver
    await driver.identify(AMPLE_S)
    await driver.ready(AMPLE_S)
    if flown.voice == "mavsdk":
        go_at(IN_FLIGHT)
    await driver.arm()
    await driver.begin_takeoff(2.0)
    for _ in range(300):
        if -flown.vehicle.truth().pose.position_ned_m[2] > 1.7:
            break
        await asyncio.sleep(0.1)
    await driver.enter_guided()


def off_m(flown: Flown) -> float:
    """Return how far north the driver's estimate is from the truth; at standstill it is close."""
    assert flown.driver.estimate is not None
    truth_m = flown.vehicle.truth().pose.position_ned_m[0]
    return abs(flown.driver.estimate.pose.position_ned_m[0] - truth_m)


async def onboard_access(flown: Flown, folder: Path) -> None:
    """Put a mission and a fence aboard, take them off, and fetch the flight's log."""
    onboard = flown.driver.onboard
    place = flown.driver.place_deg
    assert place is not None
    items = [_waypoint(place, north) for north in range(3)]
    await onboard.missions.upload(ItemList.MISSION, items)
    assert await onboard.missions.download(ItemList.MISSION) == tuple(items)
    await onboard.missions.clear(ItemList.MISSION)
    assert await onboard.missions.download(ItemList.MISSION) == ()
    fence = FenceCircle(FencePlace(*place), 50.0)
    await onboard.fences.upload([fence])
    (back,) = await onboard.fences.read()
    assert isinstance(back, FenceCircle)
    assert (back.radius_m, back.inside) == (50.0, True)
    await onboard.fences.upload([])
    assert await onboard.fences.read() == ()
    *_, newest = await onboard.logs.list()
    file = await onboard.logs.fetch(newest, folder)
    assert file.stat().st_size == newest.size_bytes > 0


def _waypoint(place: tuple[float, float], north: int) -> MissionItem:
    latitude_deg, longitude_deg = place
    return MissionItem(
        command=16, x=round(latitude_deg * 1e7) + 100 * north, y=round(longitude_deg * 1e7), z=3.0
    )


@EVERYWHERE
def test_each_driver_flies_a_whole_flight(
    voice: str,
    autopilot: str,
    kind: LinkKind,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A busy machine may keep mavsdk's process, and its setpoints, waiting for seconds.
    monkeypatch.setattr(mavsdk_client, "_FLYING_SILENT_S", 30.0)
    name, value = ("COM_OF_LOSS_T", 30.0) if autopilot == "px4" else ("GUID_TIMEOUT", 2.5)

    async def script(flown: Flown) -> None:
        driver, vehicle = flown.driver, flown.vehicle
        identity = await driver.identify(AMPLE_S)
        assert (identity.autopilot, identity.system_id, identity.simulation) == (
            autopilot,
            7,
            True,
        )
        if voice == "mavsdk":
            go_at(EXCHANGE)
        await driver.parameters.set(name, value)
        assert await driver.parameters.get(name) == value
        if voice == "mavsdk":
            go_at(UNTIL_READY)
        await up(flown)
        assert driver.state.mode is FlightMode.GUIDED
        for _ in range(200):
            driver.send(VelocitySetpoint((1.0, 0.0, 0.0)))
            await asyncio.sleep(0.05)
            if vehicle.truth().pose.position_ned_m[0] > 2.0:
                break
        north_m, east_m, _ = vehicle.truth().pose.position_ned_m
        # With mavsdk a wait of 50 ms takes longer on a busy machine, four times over.
        assert 1.5 < north_m < (15.0 if voice == "mavsdk" else 3.5)
        assert abs(east_m) < 0.4
        assert driver.clock.synchronised
        if voice == "mavlink":
            assert off_m(flown) < 1.5
        await driver.hold()
        held: FlightMode = driver.state.mode
        assert held is FlightMode.HOLD
        # With mavsdk a busy machine brings many steps of the vehicle before it brings what it sent.
        for _ in range(100):
            if off_m(flown) < 1.5:
                break
            await asyncio.sleep(0.1)
        assert off_m(flown) < 1.5
        await driver.land()
        await driver.disarmed(AMPLE_S)
        assert abs(vehicle.truth().pose.position_ned_m[2]) < 0.2
        await onboard_access(flown, tmp_path)

    flown = fly(autopilot, kind, script, voice=voice)
    kinds = {event.kind for event in flown.events}
    assert {"armed", "disarmed"} <= kinds
    assert not {"fault", "failsafe", "reboot"} & kinds


@pytest.mark.parametrize("kind", ["memory", "impaired"])
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_link_that_flaps_is_reported_each_time_and_the_vehicle_flies_after_it(
    autopilot: str, kind: LinkKind
) -> None:
    async def script(flown: Flown) -> None:
        driver, vehicle = flown.driver, flown.vehicle
        await driver.identify(AMPLE_S)
        await driver.ready(AMPLE_S)
        for _ in range(3):
            vehicle.mute(muted=True)
            await asyncio.sleep(2.5)
            vehicle.mute(muted=False)
            await asyncio.sleep(2.0)
        await up(flown)
        await driver.land()
        await driver.disarmed(AMPLE_S)

    events = [event.kind for event in fly(autopilot, kind, script).events]
    assert events.count("link_lost") == 3
    assert events.count("link_back") == 3
