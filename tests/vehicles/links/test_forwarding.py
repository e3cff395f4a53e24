"""Several links and a ground station to one vehicle."""

import asyncio

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from orchestrator.model.clock import run_virtual
from vehicles.driver import Driver
from vehicles.embedded.physics.config import EmbeddedConfig
from vehicles.embedded.vehicle import EmbeddedVehicle
from vehicles.links.link_strings import LinkAddress
from vehicles.links.memory import memory_pair
from vehicles.links.splitting import Bridge, LinkSplitter
from vehicles.links.tcp import TcpInLink


def test_two_drivers_and_a_recorder_on_one_vehicle() -> None:
    async def fly() -> None:
        ours, theirs = memory_pair(latency_s=0.002)
        splitter = LinkSplitter(link=ours)
        recorded: list[bytes] = []
        recorder = splitter.end("recorder")
        recorder.receive(lambda data, _: recorded.append(data))
        async with (
            EmbeddedVehicle(config=EmbeddedConfig(autopilot="px4"), link=theirs, seed=1),
            splitter,
            recorder,
            Driver(name="one", link=splitter.end("one"), own_system_id=245) as one,
            Driver(name="two", link=splitter.end("two"), own_system_id=246) as two,
        ):
            await asyncio.gather(one.identify(5.0), two.identify(5.0))
            await one.ready(30.0)
            await two.parameters.set("COM_OF_LOSS_T", 0.7)
            assert await one.parameters.get("COM_OF_LOSS_T") == pytest.approx(0.7)
            count = len(recorded)
        assert count > 100
        late = splitter.end("late")
        late.write(b"a closed end sends nothing")

    run_virtual(fly())


async def test_a_ground_station_beside_a_driver(free_tcp_port: int) -> None:
    ours, theirs = memory_pair()
    splitter = LinkSplitter(link=ours)
    port = TcpInLink(address=LinkAddress("tcpin", host="127.0.0.1", port=free_tcp_port), clients=2)

    def ground_station() -> tuple[int, float]:
        """Speak to it as any program with pymavlink does."""
        station = mavutil.mavlink_connection(f"tcp:127.0.0.1:{free_tcp_port}", source_system=255)
        try:
            heartbeat = station.wait_heartbeat(timeout=5)
            station.param_fetch_one("COM_OF_LOSS_T")
            value = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=5)
            return heartbeat.autopilot, value.param_value
        finally:
            station.close()

    async with (
        EmbeddedVehicle(config=EmbeddedConfig(autopilot="px4"), link=theirs, seed=1),
        splitter,
        Bridge(one=port, other=splitter.end("ground stations")),
        Driver(name="real", link=splitter.end("driver")) as driver,
    ):
        found = await asyncio.to_thread(ground_station)
        assert found == (mavlink.MAV_AUTOPILOT_PX4, 1.0)
        assert (await driver.identify(5.0)).autopilot == "px4"
