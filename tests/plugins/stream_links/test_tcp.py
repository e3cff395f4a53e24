"""TCP links over loopback: both ends, losses and returns, and the words of what goes wrong."""

import asyncio
import contextlib
import errno
import logging
import socket
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.plugins.stream_links.reconnection import BackOff
from wil_campaign.plugins.stream_links.tcp import TcpInLink, TcpOutLink
from wil_campaign.vehicles.links.link import LinkError, TellsTrouble
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link
from wil_campaign.vehicles.mavlink.codec import MavlinkCodec

QUICK = BackOff(first_s=0.01, longest_s=0.05)


def _in(port: int, **options: Any) -> TcpInLink:
    return TcpInLink(address=LinkAddress("tcpin", host="127.0.0.1", port=port), **options)


def _out(port: int) -> TcpOutLink:
    return TcpOutLink(address=LinkAddress("tcpout", host="127.0.0.1", port=port), back_off=QUICK)


async def test_bytes_go_both_ways(free_tcp_port: int, inbox: Any, wait_until: Any) -> None:
    listening = open_link(parse_link(f"tcpin://127.0.0.1:{free_tcp_port}"))
    speaking = open_link(parse_link(f"tcpout://127.0.0.1:{free_tcp_port}"))
    heard, answered = inbox(listening), inbox(speaking)
    async with listening:
        listening.write(b"to nobody")
        before_s = asyncio.get_running_loop().time()
        async with speaking:
            speaking.write(b"hello")
            await heard.holds(b"hello")
            assert before_s <= heard.times_s[0] <= asyncio.get_running_loop().time()
            listening.write(b"answer")
            await answered.holds(b"answer")
            assert answered.data == b"answer"
    speaking.write(b"closed links lose bytes and do not raise")
    listening.write(b"closed links lose bytes and do not raise")


async def test_the_port_is_free_after_closing(free_tcp_port: int) -> None:
    for _ in range(3):
        async with _in(free_tcp_port), _out(free_tcp_port):
            pass


async def test_a_port_without_a_listener_is_reported(free_tcp_port: int) -> None:
    with pytest.raises(LinkError, match=f"nothing listens on port {free_tcp_port}"):
        await _out(free_tcp_port).__aenter__()


async def test_an_unknown_host() -> None:
    link = TcpOutLink(address=LinkAddress("tcpout", host="no-such-host.invalid", port=5760))
    with pytest.raises(LinkError, match=r"'no-such-host.invalid' is unknown"):
        await link.__aenter__()


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENETUNREACH, "there is no route to"),
        (errno.EHOSTUNREACH, "cannot be reached"),
        (None, "does not answer on port 5760"),
    ],
)
async def test_a_host_that_cannot_be_reached(
    monkeypatch: pytest.MonkeyPatch, number: int | None, words: str
) -> None:
    async def fail(*_: Any, **__: Any) -> None:
        raise TimeoutError if number is None else OSError(number, "kernel's words")

    monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", fail)
    link = TcpOutLink(address=LinkAddress("tcpout", host="198.51.100.7", port=5760))
    with pytest.raises(LinkError, match=words):
        await link.__aenter__()


async def test_a_busy_port(free_tcp_port: int) -> None:
    async with _in(free_tcp_port):
        with pytest.raises(LinkError, match=f"port {free_tcp_port} is in use"):
            await _in(free_tcp_port).__aenter__()


async def test_a_foreign_address() -> None:
    link = TcpInLink(address=LinkAddress("tcpin", host="192.0.2.1", port=5760))
    with pytest.raises(LinkError, match="not an address of this machine"):
        await link.__aenter__()


async def test_reconnects_and_says_so_once(
    free_tcp_port: int, inbox: Any, wait_until: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    speaking = _out(free_tcp_port)
    answered = inbox(speaking)
    assert isinstance(speaking, TellsTrouble)
    server = _in(free_tcp_port)
    await server.__aenter__()
    async with speaking:
        assert speaking.trouble == ""
        await server.__aexit__(None, None, None)
        await wait_until(lambda: "nothing listens" in speaking.trouble)
        speaking.write(b"lost")
        async with _in(free_tcp_port) as again:
            heard = inbox(again)
            await wait_until(lambda: speaking.trouble == "")
            speaking.write(b"found")
            await heard.holds(b"found")
            assert heard.data == b"found"
            again.write(b"welcome")
            await answered.holds(b"welcome")
            lines = [one for record in caplog.records if "tcpout" in (one := record.getMessage())]
    assert len(lines) == 2
    assert "lost" in lines[0]
    assert "back after" in lines[1]


async def test_closing_ends_the_tries(free_tcp_port: int, wait_until: Any) -> None:
    speaking = _out(free_tcp_port)
    async with _in(free_tcp_port):
        await speaking.__aenter__()
    await wait_until(lambda: speaking.trouble != "")
    await speaking.__aexit__(None, None, None)
    names = [task.get_name() for task in asyncio.all_tasks()]
    assert not [name for name in names if "again" in name]


async def test_a_second_client_is_turned_away_until_the_first_is_silent(
    free_tcp_port: int, inbox: Any, wait_until: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with _in(free_tcp_port) as server:
        heard = inbox(server)
        async with _out(free_tcp_port) as first:
            first.write(b"first")
            await heard.holds(b"first")
            reader, writer = await asyncio.open_connection("127.0.0.1", free_tcp_port)
            with contextlib.suppress(ConnectionResetError):
                assert await reader.read() == b""
            writer.close()
            assert "was refused" in server.trouble
            monkeypatch.setattr("wil_campaign.plugins.stream_links.tcp._SILENT_S", 0.0)
            reader, writer = await asyncio.open_connection("127.0.0.1", free_tcp_port)
            writer.write(b"second")
            await heard.holds(b"second")
            writer.close()


def _frames(system: int, count: int) -> bytes:
    codec = MavlinkCodec(system_id=system, component_id=190)
    return b"".join(
        codec.pack(mavlink.MAVLink_timesync_message(0, number)) for number in range(count)
    )


async def test_frames_of_several_clients_do_not_mix(
    free_tcp_port: int, inbox: Any, wait_until: Any
) -> None:
    streams = [_frames(250, 20), _frames(251, 20)]
    async with _in(free_tcp_port, clients=2) as server:
        heard = inbox(server)
        async with _out(free_tcp_port) as one, _out(free_tcp_port) as two:
            boxes = [inbox(one), inbox(two)]
            # Cut in the middle of frames, in turn.
            for start in range(0, len(streams[0]), 7):
                one.write(streams[0][start : start + 7])
                two.write(streams[1][start : start + 7])
                await asyncio.sleep(0)
            await wait_until(lambda: len(heard.data) == sum(map(len, streams)))
            codec = MavlinkCodec(system_id=1, component_id=1)
            messages = codec.parse(heard.data)
            for system in (250, 251):
                own = [each.ts1 for each in messages if each.get_srcSystem() == system]
                assert own == list(range(20))
            assert codec.garbage_bytes == 0
            server.write(b"to all")
            for box in boxes:
                await box.holds(b"to all")


async def test_a_clogged_peer_does_not_fill_the_memory(free_tcp_port: int) -> None:
    with socket.create_server(("127.0.0.1", free_tcp_port)):
        async with _out(free_tcp_port) as link:
            for _ in range(3000):
                link.write(bytes(4096))
            assert link._peer is not None
            assert link._peer.dropped_writes > 0
