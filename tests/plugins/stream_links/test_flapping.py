"""Links that come and go every few hundred milliseconds: no hang, no storm of tries or of words."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, Self

import pytest

from tests.ports import free_port
from wil_campaign.foundation.clocks.lockstep import Lockstep
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.sim_clock_controller import STEP_S
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.stream_links.reconnection import BackOff, Reconnection
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import VehicleEvent
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.links.link import Link, LinkError, Receiver
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.setpoints import VelocitySetpoint

SPEED = 8.0
"""At most: the clock waits for the flight, so that a machine that is busy loses no link."""


def patient_loop(speed: float = SPEED) -> PacedLoop:
    """Return a loop whose clock is never more than LEAD_S ahead of what is done by it."""
    loop, lockstep = PacedLoop(speed), Lockstep(nominal=speed)
    lockstep.join("flight")
    lockstep.begin(loop.segment)

    def extend(run_s: float) -> bool:
        lockstep.report("flight", run_s)
        if extended := lockstep.extend(time.monotonic()):
            loop.follow(lockstep.segment)
        return extended

    def step() -> None:
        """Come by at the clock's end, where no timer is due."""
        loop.call_wall_later(STEP_S, step)

    loop.on_idle(extend)
    step()
    return loop


class FlappingLink:
    """The vehicle's end of a link: opened, and closed again, until the flight is over."""

    def __init__(self, address: str, *, up_s: float, down_s: float) -> None:
        self._address = address
        self._up_s, self._down_s = up_s, down_s
        self._link: Link | None = None
        self._receiver: Receiver | None = None
        self._task: asyncio.Task[None] | None = None
        self.flaps = 0

    @property
    def name(self) -> str:
        return self._address

    def receive(self, receiver: Receiver) -> None:
        self._receiver = receiver

    def write(self, data: bytes) -> None:
        if self._link is not None:
            self._link.write(data)

    async def __aenter__(self) -> Self:
        await self._open()
        self._task = asyncio.create_task(self._flap(), name="flapping")
        return self

    async def __aexit__(self, *raised: object) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])
        await self._close()

    async def _open(self) -> None:
        link = open_link(parse_link(self._address))
        if self._receiver is not None:
            link.receive(self._receiver)
        await link.__aenter__()
        self._link = link

    async def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            await link.__aexit__(None, None, None)

    async def _flap(self) -> None:
        while True:
            await asyncio.sleep(self._up_s)
            await self._close()
            self.flaps += 1
            await asyncio.sleep(self._down_s)
            await self._open()


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_a_flight_by_a_link_that_flaps(
    autopilot: str, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    port = free_port()
    events: list[VehicleEvent] = []

    async def flight() -> int:
        # To a port that is closed in between, "unreachable" comes back for each datagram.
        # It is up for longer than heartbeats are apart: with none for 3 s nothing is seen done.
        theirs = FlappingLink(f"{kind}in://127.0.0.1:{port}", up_s=1.25, down_s=0.25)
        # ArduCopter boots for 40 s, of which the last ten show as much.
        running_s = 30.0 if autopilot == "ardupilot" else 0.0
        config = EmbeddedConfig(autopilot=autopilot, system_id=7, running_s=running_s)
        async with (
            EmbeddedVehicle(config=config, link=theirs, seed=1) as vehicle,
            Driver(name="real", link=open_link(parse_link(f"{kind}out://127.0.0.1:{port}"))) as one,
        ):
            one.on_event(events.append)
            await one.identify(20.0)
            await one.ready(120.0)
            await one.arm()
            await one.begin_takeoff(2.0)
            for _ in range(300):
                if -vehicle.truth().pose.position_ned_m[2] > 1.7:
                    break
                await asyncio.sleep(0.1)
            await one.enter_guided()
            for _ in range(40):
                one.send(VelocitySetpoint((0.5, 0.0, 0.0)))
                await asyncio.sleep(0.05)
            await one.land()
            await one.disarmed(60.0)
            assert abs(vehicle.truth().pose.position_ned_m[2]) < 0.3
        return theirs.flaps

    with asyncio.Runner(loop_factory=patient_loop) as runner:
        flaps = runner.run(flight())
    assert flaps > 10
    assert {"armed", "disarmed"} <= {event.kind for event in events}
    # What is shorter than a loss is no event, and a connection that flaps is told of once.
    assert len([one for one in events if one.kind in {"link_lost", "link_back"}]) <= 6
    said = [record.getMessage() for record in caplog.records if f"{kind}out" in record.getMessage()]
    assert len(said) <= 6


@asynccontextmanager
async def resetting(port: int, counted: list[float]) -> AsyncIterator[None]:
    """A port that takes every connection and resets it at once."""

    class Reset(asyncio.Protocol):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            counted.append(asyncio.get_running_loop().time())
            assert isinstance(transport, asyncio.Transport)
            transport.abort()

    server = await asyncio.get_running_loop().create_server(Reset, "127.0.0.1", port)
    try:
        yield
    finally:
        server.close()
        await server.wait_closed()


def test_a_peer_that_resets_every_connection_is_tried_for_less_and_less(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING)
    port, counted = free_port(), list[float]()

    async def tried() -> None:
        link = open_link(parse_link(f"tcpout://127.0.0.1:{port}"))
        link.receive(lambda *_: None)
        async with resetting(port, counted), link:
            await asyncio.sleep(30.0)

    with asyncio.Runner(loop_factory=patient_loop) as runner:
        runner.run(tried())
    # After 0.2, 0.4, 0.8, 1.6 and then every 3 s; not five times a second.
    assert 4 <= len(counted) <= 16
    said = [record.getMessage() for record in caplog.records]
    assert len(said) <= 6
    assert (
        sum(
            "the link flaps; further losses are not logged until it holds for 5 s" in one
            for one in said
        )
        == 1
    )


class Flaky:
    """A link of which a test says when it is there."""

    def __init__(self) -> None:
        self.there = True
        self.tries = 0

    async def again(self) -> None:
        self.tries += 1
        if not self.there:
            raise LinkError("away")


def flapped(
    script: Callable[[Reconnection, Flaky], Any], caplog: pytest.LogCaptureFixture
) -> tuple[Flaky, list[str]]:
    caplog.set_level(logging.WARNING)
    flaky = Flaky()

    async def run() -> None:
        recovery = Reconnection(name="tcpout://x", reconnect=flaky.again, back_off=BackOff())
        await script(recovery, flaky)
        await recovery.stop()

    run_virtual(run())
    return flaky, [record.getMessage() for record in caplog.records]


def test_a_link_that_flaps_is_reported_once_and_again_when_it_stays(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def script(recovery: Reconnection, _: Flaky) -> None:
        for _turn in range(20):
            recovery.lost("reset by peer")
            await asyncio.sleep(0.7)
        await asyncio.sleep(10.0)
        recovery.lost("unplugged")
        await asyncio.sleep(1.0)

    flaky, said = flapped(script, caplog)
    # A connection that was there for a while is tried for at once: somebody may fly by it.
    assert flaky.tries == 21
    assert said == [
        "tcpout://x: lost (reset by peer)",
        "tcpout://x: back after 0.2 s",
        "tcpout://x: lost (reset by peer)",
        "tcpout://x: back after 0.2 s",
        (
            "tcpout://x: lost again (reset by peer): the link flaps; further losses are "
            "not logged until it holds for 5 s"
        ),
        "tcpout://x: back, and steady; it was lost 20 times",
        "tcpout://x: lost (unplugged)",
        "tcpout://x: back after 0.2 s",
    ]


def test_an_unplugged_cable_is_tried_for_every_three_seconds(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def script(recovery: Reconnection, flaky: Flaky) -> None:
        flaky.there = False
        recovery.lost("unplugged")
        await asyncio.sleep(60.0)
        flaky.there = True
        await asyncio.sleep(3.0)

    flaky, said = flapped(script, caplog)
    assert flaky.tries < 27
    assert [one.partition(":")[2].split()[1] for one in said] == ["lost", "back"] or len(said) == 2
