"""What asyncio reads at once: short enough to be cheap, long enough for the longest datagram."""

import asyncio

from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.reads import LONGEST_READ_BYTES, shorten_reads
from wil_campaign.vehicles.links.udp import UdpLink

_LONGEST_DATAGRAM = bytes(65_507)


async def test_asyncio_reads_no_more_at_once_than_the_limit() -> None:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(
        asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0)
    )
    assert transport.max_size > LONGEST_READ_BYTES  # type: ignore[attr-defined]
    shorten_reads(transport)
    assert transport.max_size == LONGEST_READ_BYTES  # type: ignore[attr-defined]
    transport.close()


async def test_the_longest_datagram_arrives_whole() -> None:
    arrived: asyncio.Queue[bytes] = asyncio.Queue()
    near = UdpLink(address=LinkAddress(kind="udpin", host="127.0.0.1", port=0))
    near.receive(lambda data, _: arrived.put_nowait(data))
    async with near:
        there = LinkAddress(kind="udpout", host="127.0.0.1", port=near.local_port)
        async with UdpLink(address=there) as far:
            far.write(_LONGEST_DATAGRAM)
            async with asyncio.timeout(5.0):
                assert await arrived.get() == _LONGEST_DATAGRAM


def test_a_transport_without_such_a_limit_is_left_alone() -> None:
    shorten_reads(asyncio.BaseTransport())
