"""Links: order and latency in memory, sockets over UDP."""

import asyncio
import socket
from types import SimpleNamespace

import pytest

from orchestrator.clock import run_virtual
from vehicles.links.base import LinkError, TellsTrouble
from vehicles.links.memory import memory_pair
from vehicles.links.opening import open_link
from vehicles.links.parse import LinkAddress, parse_link
from vehicles.links.udp import UdpLink


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


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


def test_memory_loses_what_is_written_to_a_closed_end() -> None:
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


async def test_udp_answers_whom_it_heard() -> None:
    port = _free_port()
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


async def test_udp_answers_its_peer_while_strangers_speak_and_the_next_when_it_is_silent() -> None:
    now_s, sent = [10.0], list[tuple[bytes, int]]()
    peer, stranger = ("127.0.0.1", 1001), ("127.0.0.1", 1002)
    async with UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=0)) as link:
        heard: list[bytes] = []
        link.receive(lambda data, _: heard.append(data))
        link._loop = SimpleNamespace(time=lambda: now_s[0])  # type: ignore[assignment]
        link._transport.sendto = lambda data, addr: sent.append((data, addr[1]))  # type: ignore[method-assign, union-attr]
        link.datagram_received(b"peer", peer)
        for tenth in range(40):
            now_s[0] += 0.1
            link.datagram_received(b"stranger", stranger)
            if tenth < 20:
                link.datagram_received(b"peer", peer)
            link.write(b"to whom?")
    assert heard.count(b"stranger") == 40
    to = [port for _, port in sent]
    # A heartbeat and a half after the peer's last word the next one has its place.
    assert to[:34] == [1001] * 34
    assert to[36:] == [1002] * 4


async def test_udp_busy_port_says_so() -> None:
    port = _free_port()
    async with UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=port)):
        with pytest.raises(LinkError, match=f"{port} is taken"):
            await UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=port)).__aenter__()
    async with UdpLink(address=LinkAddress("udpin", host="127.0.0.1", port=port)) as again:
        assert again.local_port == port


async def test_udp_unknown_host_says_so() -> None:
    link = UdpLink(address=LinkAddress("udpout", host="no-such-host.invalid", port=14540))
    with pytest.raises(LinkError, match="unknown"):
        await link.__aenter__()


async def test_udp_foreign_address_says_so() -> None:
    link = UdpLink(address=LinkAddress("udpin", host="192.0.2.1", port=14540))
    with pytest.raises(LinkError, match="no address of this machine"):
        await link.__aenter__()


async def test_udp_remembers_a_refused_connection() -> None:
    link = UdpLink(address=LinkAddress("udpout", host="127.0.0.1", port=_free_port()))
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
