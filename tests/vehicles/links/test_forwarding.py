"""Several links and a ground station to one vehicle."""

import asyncio
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from orchestrator.clock import run_virtual
from vehicles.driver import Driver
from vehicles.embedded.config import EmbeddedConfig
from vehicles.embedded.vehicle import EmbeddedVehicle
from vehicles.links.base import LinkError
from vehicles.links.memory import memory_pair
from vehicles.links.parse import LinkAddress
from vehicles.links.shared import SharedLink
from vehicles.links.splitting import Bridge, LinkSplitter
from vehicles.links.tcp import TcpInLink
from vehicles.mavlink.codec import Codec


def _timesync(codec: Codec, number: int) -> bytes:
    return codec.pack(mavlink.MAVLink_timesync_message(0, number))


def test_frames_of_several_links_come_whole_and_go_to_all() -> None:
    async def fly() -> None:
        pairs = [memory_pair(name=name) for name in ("a", "b")]
        shared = SharedLink(links=[ours for ours, _ in pairs])
        assert shared.name == "a:a + b:a"
        reader = Codec(system_id=1, component_id=1)
        heard: list[Any] = []
        shared.receive(lambda data, _: heard.extend(reader.parse(data)))
        answers: list[list[bytes]] = [[], []]
        async with shared, pairs[0][1] as far_a, pairs[1][1] as far_b:
            for far, box in ((far_a, answers[0]), (far_b, answers[1])):
                far.receive(lambda data, _, box=box: box.append(data))
            codecs = [Codec(system_id=system, component_id=190) for system in (251, 252)]
            streams = [b"".join(_timesync(codec, k) for k in range(9)) for codec in codecs]
            for start in range(0, len(streams[0]), 10):
                far_a.write(streams[0][start : start + 10])
                far_b.write(streams[1][start : start + 10])
                await asyncio.sleep(0.01)
            shared.write(b"to all")
            await asyncio.sleep(0.01)
        for system in (251, 252):
            assert [each.ts1 for each in heard if each.get_srcSystem() == system] == list(range(9))
        assert reader.garbage_bytes == 0
        assert answers == [[b"to all"], [b"to all"]]

    run_virtual(fly())


def test_two_radios_of_one_vehicle_tell_a_thing_once() -> None:
    async def fly() -> None:
        pairs = [
            memory_pair(name=name, latency_s=late_s) for name, late_s in (("a", 0.01), ("b", 0.05))
        ]
        shared = SharedLink(links=[ours for ours, _ in pairs], once_s=0.5)
        reader = Codec(system_id=1, component_id=1)
        heard: list[int] = []
        shared.receive(lambda data, _: heard.extend(each.ts1 for each in reader.parse(data)))
        async with shared, pairs[0][1] as far_a, pairs[1][1] as far_b:
            # The vehicle numbers the frames of each radio by itself.
            codec_a, codec_b = (Codec(system_id=1, component_id=1) for _ in range(2))
            _timesync(codec_b, 0)
            for number in range(20):
                if number % 5:
                    far_a.write(_timesync(codec_a, number))
                far_b.write(_timesync(codec_b, number))
                await asyncio.sleep(0.1)
            # The same content again by the same radio is no double, nor much later by the other.
            far_a.write(_timesync(codec_a, 99))
            far_a.write(_timesync(codec_a, 99))
            await asyncio.sleep(1.0)
            far_b.write(_timesync(codec_b, 99))
            await asyncio.sleep(1.0)
        assert heard == [*range(20), 99, 99, 99]
        assert shared.doubles == 16

    run_virtual(fly())


async def test_what_cannot_be_opened_closes_the_others(free_tcp_port: int) -> None:
    address = LinkAddress("tcpin", host="127.0.0.1", port=free_tcp_port)
    with pytest.raises(LinkError, match="is taken"):
        await SharedLink(
            links=[TcpInLink(address=address), TcpInLink(address=address)]
        ).__aenter__()
    async with TcpInLink(address=address):
        pass
    with pytest.raises(ValueError, match="needs links"):
        SharedLink(links=[])


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
