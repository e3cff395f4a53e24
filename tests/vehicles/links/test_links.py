"""Links: order and latency in memory, sockets over UDP."""

import asyncio
import socket
from collections.abc import Callable
from types import SimpleNamespace
from typing import Literal, Self

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.ports import free_port
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.plugins.signed_links.signed_link import SignedLink
from wil_campaign.plugins.signed_links.signer import Signer, ticks_of_utc
from wil_campaign.plugins.signed_links.signing_key import SigningKey
from wil_campaign.vehicles.links.link import LinkError, TellsTrouble
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.links.udp import UdpLink
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec
from wil_campaign.vehicles.mavlink.framing import FrameSplitter

_KEY = SigningKey(bytes(range(32)))


@pytest.mark.parametrize("latency_s", [0.0, 0.08])
def test_memory_keeps_order_and_latency(latency_s: float) -> None:
    async def fly() -> list[tuple[bytes, float]]:
        ours, theirs = memory_pair(latency_s=latency_s)
        arrived: list[tuple[bytes, float]] = []
        theirs.receive(lambda data, t_s: arrived.append((data, t_s)))
        async with ours, theirs:
            for number in range(100):
                ours.write(bytes([number]))
                if number % 10 == 9:
                    await asyncio.sleep(0.01)
            await asyncio.sleep(1.0)
        return arrived

    arrived = run_virtual(fly())
    assert [data[0] for data, _ in arrived] == list(range(100))
    for number, (_, t_s) in enumerate(arrived):
        assert t_s == pytest.approx(number // 10 * 0.01 + latency_s, abs=1e-9)


def test_memory_loses_bytes_written_to_a_closed_end() -> None:
    async def fly() -> list[bytes]:
        ours, theirs = memory_pair(latency_s=0.1)
        arrived: list[bytes] = []
        theirs.receive(lambda data, _: arrived.append(data))
        async with ours:
            ours.write(b"nobody there")
            async with theirs:
                ours.write(b"under way when it closes")
            async with theirs:
                ours.write(b"heard")
                await asyncio.sleep(1.0)
        ours.write(b"we are closed")
        return arrived

    assert run_virtual(fly()) == [b"heard"]


def test_memory_refuses_negative_latency() -> None:
    with pytest.raises(ValueError, match="latency_s"):
        memory_pair(latency_s=-0.1)


async def test_udp_answers_its_senders() -> None:
    port = free_port()
    listening = open_link(parse_link(f"udpin://127.0.0.1:{port}"))
    speaking = open_link(parse_link(f"udpout://127.0.0.1:{port}"))
    heard: asyncio.Queue[tuple[bytes, float]] = asyncio.Queue()
    answered: asyncio.Queue[tuple[bytes, float]] = asyncio.Queue()
    listening.receive(lambda data, t_s: heard.put_nowait((data, t_s)))
    speaking.receive(lambda data, t_s: answered.put_nowait((data, t_s)))
    async with listening, speaking:
        listening.write(b"to nobody yet")
        before_s = asyncio.get_running_loop().time()
        speaking.write(b"hello")
        data, t_s = await asyncio.wait_for(heard.get(), 5.0)
        assert data == b"hello"
        assert before_s <= t_s <= asyncio.get_running_loop().time()
        listening.write(b"answer")
        assert (await asyncio.wait_for(answered.get(), 5.0))[0] == b"answer"
    speaking.write(b"closed links lose bytes and do not raise")


class Received:
    """A udpin link on a clock of the test's, what it handed on, wrote to whom, and told."""

    def __init__(self, *, signed: bool = False) -> None:
        self.now_s = 10.0
        self.heard: list[bytes] = []
        self.sent: list[int] = []
        self.told: list[str] = []
        self.link = UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=0), signed=signed)
        self.link.receive(lambda data, _: self.heard.append(data))
        self.link.on_rival(self.told.append)
        self.link.on_change(self.told.append)

    async def __aenter__(self) -> Self:
        await self.link.__aenter__()
        self.later: list[Callable[[], None]] = []
        loop = SimpleNamespace(
            time=lambda: self.now_s, call_later=lambda _, call: self.later.append(call)
        )
        self.link._loop = loop  # type: ignore[assignment]
        self.link._transport.sendto = lambda _, addr: self.sent.append(addr[1])  # type: ignore[method-assign, union-attr]
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.link.__aexit__(None, None, None)

    def beat(self, port: int, times: int, *, every_s: float) -> None:
        """Say so many heartbeats of system 1 from a port, each so long after the last datagram."""
        for _ in range(times):
            self.now_s += every_s
            self.say(port, _heartbeat(1))

    def say(self, port: int, data: bytes) -> None:
        self.link.datagram_received(data, ("127.0.0.1", port))

    def answered(self) -> list[int]:
        """Write, and return the ports that it went to."""
        self.sent.clear()
        self.link.write(b"to whom?")
        return list(self.sent)


def _heartbeat(system: int) -> bytes:
    codec = MavlinkCodec(system_id=system, component_id=1)
    return codec.pack(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3))


class Clogged:
    """A transport whose socket takes nothing: what is written waits."""

    def __init__(self) -> None:
        self.waiting: list[bytes] = []

    def is_closing(self) -> bool:
        return False

    def get_write_buffer_size(self) -> int:
        return sum(map(len, self.waiting))

    def sendto(self, data: bytes, _: object = None) -> None:
        self.waiting.append(data)


@pytest.mark.parametrize("kind", ["udpin", "udpout"])
def test_a_clogged_udp_link_keeps_no_late_setpoints(kind: Literal["udpin", "udpout"]) -> None:
    link, clogged = UdpLink(address=LinkAddress(kind, host="127.0.0.1", port=1)), Clogged()
    link._transport = clogged  # type: ignore[assignment]
    link._peers = (("127.0.0.1", 1001),)
    for number in range(100):
        link.write(b"setpoint %d" % number)
    assert clogged.waiting == [b"setpoint 0"]
    assert link.dropped_writes == 99
    clogged.waiting.clear()
    link.write(b"land")
    assert clogged.waiting == [b"land"]


async def test_little_waits_in_the_kernel_until_another_address_would_take_the_room() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        default = plain.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)
    out = LinkAddress("udpout", host="127.0.0.1", port=free_port())
    async with UdpLink(address=out) as link:
        assert _send_buffer_bytes(link) == 32_768  # as Linux counts 16 KiB
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        there.say(1001, _heartbeat(2))  # another system, from the same place
        assert _send_buffer_bytes(there.link) == 32_768
        there.say(1002, _heartbeat(3))
        assert _send_buffer_bytes(there.link) == default
        there.later.pop()()
        assert _send_buffer_bytes(there.link) == default  # there are two


async def test_little_waits_in_the_kernel_again_for_a_vehicle_that_has_moved() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        there.now_s += 60.0
        there.say(1002, _heartbeat(1))
        assert there.answered() == [1002]
        assert _send_buffer_bytes(there.link) > 32_768  # frames for where it was may wait
        there.later.pop()()
        assert _send_buffer_bytes(there.link) == 32_768


def _send_buffer_bytes(link: UdpLink) -> int:
    assert link._transport is not None
    own: socket.socket = link._transport.get_extra_info("socket")
    return own.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)


async def test_a_sender_in_the_name_of_another_is_reported_and_not_believed() -> None:
    async with Received() as there:
        for _ in range(30):
            there.now_s += 0.1
            there.say(1001, _heartbeat(1))
            there.say(1002, _heartbeat(1))
            assert there.answered() == [1001]
        assert there.heard == [_heartbeat(1)] * 30
        (said,) = there.told
        assert said == (
            "system 1 sends from 127.0.0.1:1002 as well as from 127.0.0.1:1001: two vehicles "
            "have the same system id; only the latter is accepted"
        )
        assert list(there.link.rivals.values()) == there.told
        later: list[str] = []
        there.link.on_rival(later.append)
        assert later == there.told


async def test_a_vehicle_that_speaks_from_another_port_after_a_silence_is_the_same() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        there.now_s += 1.6
        there.say(1002, _heartbeat(1))
        assert there.answered() == [1002]
        assert len(there.heard) == 2
        (said,) = there.told
        assert said == (
            "system 1 now sends from 127.0.0.1:1002; it was last received from 127.0.0.1:1001 "
            "1.6 s ago"
        )
        assert not there.link.rivals


async def test_a_rival_takes_no_place_while_the_vehicle_may_come_back() -> None:
    async with Received() as there:
        for _ in range(10):
            there.now_s += 0.1
            there.say(1001, _heartbeat(1))
            there.say(1002, _heartbeat(1))
        there.heard.clear()
        for _ in range(50):
            there.now_s += 1.1
            there.say(1002, _heartbeat(1))
            assert (there.heard, there.answered()) == ([], [1001])
        there.say(1001, _heartbeat(1))
        assert (len(there.heard), there.answered()) == (1, [1001])
        assert len(there.told) == 1
        there.now_s += 60.1
        there.say(1002, _heartbeat(1))
        assert (len(there.heard), there.answered(), len(there.told)) == (2, [1002], 2)


async def test_more_rivals_than_are_remembered_take_no_place_either() -> None:
    async with Received() as there:
        for _ in range(10):
            there.now_s += 0.1
            for port in range(1001, 1012):
                there.say(port, _heartbeat(1))
        there.heard.clear()
        there.now_s += 1.6
        for port in range(1002, 1012):
            there.say(port, _heartbeat(1))
        assert (there.heard, there.answered()) == ([], [1001])


async def test_a_vehicle_that_changes_its_port_without_a_silence_is_no_rival() -> None:
    """Behind a router that restarts: what was under way from the old port comes still."""
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        for _ in range(4):
            there.now_s += 0.1
            there.say(1002, _heartbeat(1))
            there.say(1001, _heartbeat(1))
        there.beat(1002, 20, every_s=0.1)
        assert there.answered() == [1002]
        assert not there.link.rivals


async def test_the_sender_that_was_received_first_takes_its_place_back_at_once() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        there.now_s += 1.6
        there.say(1002, _heartbeat(1))
        there.now_s += 0.1
        there.say(1001, _heartbeat(1))
        assert (len(there.heard), there.answered()) == (3, [1001])
        assert there.told[1] == (
            "system 1 now sends from 127.0.0.1:1001 again, where it was received first; it was "
            "last received from 127.0.0.1:1002 0.1 s ago"
        )
        # From now on the other is a rival.
        for _ in range(10):
            there.now_s += 0.1
            there.say(1002, _heartbeat(1))
            there.say(1001, _heartbeat(1))
        there.now_s += 1.6
        there.say(1002, _heartbeat(1))
        assert there.answered() == [1001]


async def test_a_late_frame_of_the_other_way_makes_it_no_rival_for_later() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        there.now_s += 1.6
        there.say(1002, _heartbeat(1))
        there.now_s += 1.0
        there.say(1001, _heartbeat(1))
        there.now_s += 0.06
        there.say(1002, _heartbeat(1))  # was under way when the first was there again
        there.beat(1001, 20, every_s=1.0)
        there.beat(1002, 3, every_s=1.0)
        assert there.answered() == [1002]


async def test_a_sender_received_first_long_ago_does_not_take_a_flying_vehicles_place() -> None:
    async with Received() as there:
        said: list[str] = []
        there.link.on_rival(said.append)
        there.say(1001, _heartbeat(1))
        there.now_s += 1.6
        there.beat(1002, 30, every_s=1.0)
        for _ in range(10):
            there.now_s += 0.5
            there.say(1001, _heartbeat(1))
            there.say(1002, _heartbeat(1))
        assert there.answered() == [1002]
        assert len(said) == 1
        assert "system 1 sends from 127.0.0.1:1001 as well as from 127.0.0.1:1002" in said[0]


async def test_a_vehicle_that_flew_long_takes_its_place_back_after_a_long_outage() -> None:
    async with Received() as there:
        there.beat(1001, 60, every_s=1.0)
        there.now_s += 2.0
        there.beat(1002, 25, every_s=1.0)
        assert there.answered() == [1002]
        for _ in range(5):
            there.now_s += 0.5
            there.say(1001, _heartbeat(1))
            there.say(1002, _heartbeat(1))
            assert there.answered() == [1001]


async def test_strays_of_long_ago_make_no_new_port_a_rival() -> None:
    async with Received() as there:
        said: list[str] = []
        there.link.on_rival(said.append)
        there.say(1001, _heartbeat(1))
        for port in range(2001, 2009):
            there.now_s += 0.2
            there.say(1001, _heartbeat(1))
            there.say(port, _heartbeat(1))
        there.beat(1001, 70, every_s=1.0)
        there.beat(1002, 3, every_s=1.0)
        assert (there.answered(), said) == ([1002], [])


async def test_a_vehicle_that_sends_in_turns_on_two_ways_is_received_on_each() -> None:
    async with Received() as there:
        for _ in range(4):
            for port in (1001, 1002):
                there.now_s += 1.6
                there.say(port, _heartbeat(1))
                assert there.answered() == [port]
        assert len(there.heard) == 8


async def test_a_ground_station_that_spoke_first_keeps_nothing_from_the_vehicle() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(255))
        there.say(1002, _heartbeat(1))
        assert there.answered() == [1001, 1002]
        there.now_s += 30.0
        there.say(1001, _heartbeat(255))
        assert there.answered() == [1001, 1002]  # a vehicle that is not heard may hear us


async def test_a_flood_does_not_take_the_place_of_a_vehicle_in_an_outage() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        for _ in range(30):
            there.now_s += 1.0
            for number in range(2, 20):
                there.say(2000 + number, _heartbeat(number))
        assert 1001 in there.answered()


async def test_a_flood_from_many_places_is_received_and_not_written_to() -> None:
    async with Received() as there:
        there.say(1001, _heartbeat(1))
        for number in range(2, 200):
            there.say(2000 + number, _heartbeat(number))
        assert len(there.heard) == 199
        assert len(there.answered()) == 4
        assert there.sent[0] == 1001


async def test_a_signed_link_receives_every_sender_since_signatures_decide() -> None:
    async with Received(signed=True) as there:
        there.say(1002, _heartbeat(1))
        there.say(1001, _heartbeat(1))
        assert (len(there.heard), there.answered(), there.told) == (2, [1002, 1001], [])


async def test_with_signatures_the_last_sender_is_answered() -> None:
    async with Received(signed=True) as there:
        for port in (1001, 1002, 1003, 1004):
            there.say(port, _heartbeat(1))
        for _ in range(3):
            there.now_s += 1.0
            there.say(1005, _heartbeat(1))
            assert there.answered() == [1002, 1003, 1004, 1005]


class Signed(Received):
    """A signed udpin link, and a vehicle that signs."""

    def __init__(self) -> None:
        super().__init__(signed=True)
        self.upper = SignedLink(link=self.link, key=_KEY, utc_s=1.7e9)
        self.upper.receive(lambda data, _: self.heard.append(data))
        self._vehicle = Signer(key=_KEY)

    def say_signed(self, port: int, data: bytes = b"") -> bytes:
        (frame,) = FrameSplitter().feed(data or _heartbeat(1))
        whole = self._vehicle.sign(frame, ticks_of_utc(1.7e9))
        assert whole is not None
        self.say(port, whole)
        return whole


async def test_a_signed_vehicle_is_answered_after_each_restart_from_another_port() -> None:
    async with Signed() as there:
        for port in range(1001, 1010):
            there.now_s += 3.0
            there.say_signed(port)
            assert there.answered()[-1] == port
        assert len(there.heard) == 9
        assert len(there.answered()) == 4


async def test_no_flood_takes_the_place_of_a_signed_vehicle_in_an_outage() -> None:
    async with Signed() as there:
        old = there.say_signed(1001)
        status = MavlinkCodec(system_id=1, component_id=1).pack(
            mavlink.MAVLink_radio_status_message(1, 1, 1, 1, 1, 0, 0)
        )
        for number in range(300):
            there.now_s += 0.3
            for data in (_heartbeat(1), old, status):
                there.say(2000 + number, data)
            assert 1001 in there.answered()
        there.say_signed(1002)
        assert {1001, 1002} < set(there.answered())


async def test_udp_busy_port_says_so() -> None:
    port = free_port()
    async with UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=port)):
        with pytest.raises(LinkError, match=f"{port} is in use"):
            await UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=port)).__aenter__()
    async with UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=port)) as again:
        assert again.local_port == port


async def test_udp_unknown_host_says_so() -> None:
    link = UdpLink(address=LinkAddress("udpout", host="no-such-host.invalid", port=14540))
    with pytest.raises(LinkError, match="unknown"):
        await link.__aenter__()


async def test_udp_foreign_address_says_so() -> None:
    link = UdpLink(address=LinkAddress("udpin", host="192.0.2.1", port=14540))
    with pytest.raises(LinkError, match="not an address of this machine"):
        await link.__aenter__()


async def test_udp_remembers_a_refused_connection() -> None:
    link = UdpLink(address=LinkAddress("udpout", host="127.0.0.1", port=free_port()))
    assert isinstance(link, TellsTrouble)
    async with link:
        link.write(b"anybody?")
        for _ in range(100):
            if link.trouble:
                break
            await asyncio.sleep(0.01)
        assert "refused" in link.trouble.lower()


def test_memory_has_two_ends() -> None:
    with pytest.raises(LinkError, match="memory_pair"):
        open_link(parse_link("memory://"))
