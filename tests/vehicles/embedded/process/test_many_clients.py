"""Twenty clients at once, two vehicles on one port, links that die and return; the wall clock."""

import asyncio
import random
from collections.abc import Callable
from functools import partial
from typing import Any, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from tests.vehicles.embedded.embedded_process import EmbeddedProcess
from wil_campaign.vehicles.embedded.process.process_settings import ProcessSettings
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_strings import parse_link
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

WITHIN_S = 60.0
CLIENTS = 20
ASKED = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
GARBAGE = random.Random(1).randbytes(3000)  # noqa: S311 - repeatable


def question(codec: MavlinkCodec, vehicle: int = 1) -> bytes:
    return codec.pack(mavlink.MAVLink_command_long_message(vehicle, 1, ASKED, 0, 30.0, *(0.0,) * 6))


def is_answer(message: Any) -> bool:
    return bool(message.get_type() == "COMMAND_ACK" and message.command == ASKED)


class TcpClient:
    """A client of a vehicle's TCP port."""

    def __init__(self, port: int, system_id: int = 255) -> None:
        self._port = port
        self.codec = MavlinkCodec(system_id=system_id, component_id=190)

    async def __aenter__(self) -> Self:
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", self._port)
        return self

    async def __aexit__(self, *_: object) -> None:
        self.writer.transport.abort()

    async def is_answered(self) -> bool:
        """Ask, often: a frame that garbage seems to begin hides what follows it.

        Returns whether the answer comes before the connection's end.
        """
        try:
            self.writer.write(question(self.codec))
            while data := await self.reader.read(4096):
                if any(map(is_answer, self.codec.parse(data))):
                    return True
                self.writer.write(question(self.codec))
        except (ConnectionResetError, BrokenPipeError):
            pass
        return False


async def disturb(client: TcpClient) -> bool:
    """Send garbage and ask; return whether the client is answered."""
    async with client:
        client.writer.write(GARBAGE)
        return await client.is_answered()


async def test_one_tcp_client_is_served_and_nineteen_others_are_turned_away() -> None:
    port = free_port()
    settings = ProcessSettings(autopilot="ardupilot", link=f"tcpin://127.0.0.1:{port}", seed=1)
    async with EmbeddedProcess(settings=settings) as process, asyncio.timeout(WITHIN_S):
        async with TcpClient(port) as first:
            assert await first.is_answered()
            others = [TcpClient(port, system_id=100 + k) for k in range(CLIENTS - 1)]
            served = await asyncio.gather(*map(disturb, others))
            assert not any(served)
            assert await first.is_answered()
        # It was cut off, not closed; whoever tries again is served, also after garbage.
        for _ in range(5):
            while not await disturb(TcpClient(port)):  # noqa: ASYNC110 - of another process
                await asyncio.sleep(0.05)
        assert process.exit_code is None


async def udp_client(port: int, kind: str = "udpout") -> UdpLink:
    return UdpLink(address=parse_link(f"{kind}://127.0.0.1:{port}"))


def counted(link: UdpLink, codec: MavlinkCodec) -> list[Any]:
    """Return the list into which a link's messages go."""
    messages: list[Any] = []
    link.receive(lambda data, _: messages.extend(codec.parse(data)))
    return messages


def is_answered(messages: list[Any]) -> bool:
    return any(map(is_answer, messages))


async def until(condition: Callable[[], bool], then: Callable[[], None] = lambda: None) -> None:
    """Wait for a condition; do `then` every 50 ms meanwhile."""
    async with asyncio.timeout(WITHIN_S):
        while not condition():
            then()
            await asyncio.sleep(0.05)


async def test_twenty_udp_clients_at_once_end_nothing_and_the_first_are_answered() -> None:
    port = free_port()
    settings = ProcessSettings(autopilot="px4", link=f"udpin://127.0.0.1:{port}", seed=1)
    async with EmbeddedProcess(settings=settings) as process:
        links = [await udp_client(port) for _ in range(CLIENTS)]
        codecs = [MavlinkCodec(system_id=100 + k, component_id=190) for k in range(CLIENTS)]
        heard = [counted(*one) for one in zip(links, codecs, strict=True)]
        for link in links:
            await link.__aenter__()

        def disturb() -> None:
            for link, codec in zip(links, codecs, strict=True):
                link.write(question(codec))
                link.write(GARBAGE[:1200])

        # A link answers at most four senders, and garbage takes the place of one.
        await until(lambda: sum(any(map(is_answer, one)) for one in heard) >= 3, disturb)
        for link in links:
            await link.__aexit__(None, None, None)
        assert process.exit_code is None


async def test_two_vehicles_at_one_port_of_a_client_are_distinguished() -> None:
    port = free_port()
    link, codec = await udp_client(port, "udpin"), MavlinkCodec(system_id=255, component_id=190)
    messages = counted(link, codec)
    both = [
        ProcessSettings(autopilot="px4", link=f"udpout://127.0.0.1:{port}", seed=1, system_id=k)
        for k in (1, 2)
    ]
    async with link, EmbeddedProcess(settings=both[0]), EmbeddedProcess(settings=both[1]):

        def ask() -> None:
            for number in (1, 2):
                link.write(question(codec, number))

        def answered() -> set[int]:
            return {message.get_srcSystem() for message in messages if is_answer(message)}

        await until(lambda: answered() == {1, 2}, ask)


async def test_a_second_vehicle_at_a_port_to_listen_at_is_refused() -> None:
    port = free_port()
    settings = ProcessSettings(autopilot="ardupilot", link=f"tcpin://127.0.0.1:{port}", seed=1)
    async with EmbeddedProcess(settings=settings), TcpClient(port) as client:
        with pytest.raises(LinkError, match=f"port {port} is in use by another program"):
            await EmbeddedProcess(settings=settings).__aenter__()
        assert await client.is_answered()


async def test_a_udp_client_that_dies_and_returns_is_answered_again() -> None:
    port = free_port()
    settings = ProcessSettings(autopilot="px4", link=f"udpout://127.0.0.1:{port}", seed=1)
    async with EmbeddedProcess(settings=settings) as process:
        for _ in range(3):
            # Meanwhile the kernel answers the vehicle's datagrams with "connection refused".
            link, codec = (
                await udp_client(port, "udpin"),
                MavlinkCodec(system_id=255, component_id=190),
            )
            messages = counted(link, codec)
            async with link:
                await until(partial(is_answered, messages), partial(link.write, question(codec)))
            await asyncio.sleep(0.2)
        assert process.exit_code is None
