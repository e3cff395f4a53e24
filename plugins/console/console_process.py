"""The process of a console: serves its page, and receives live feeds, until it ends."""

import asyncio
import contextlib
import os
import socket
import ssl
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from aiohttp import web

from wil_campaign.foundation.processes.codec import ProcessMessageError
from wil_campaign.foundation.tasks import open_task_group, stop_tasks
from wil_campaign.plugins.console.campaign_poller import POLL_S, CampaignPoller
from wil_campaign.plugins.console.console_access import ConsoleAccess, Role
from wil_campaign.plugins.console.console_address import (
    ConsoleAddress,
    ConsoleError,
    RequestRules,
    require_safe_console_address,
)
from wil_campaign.plugins.console.console_hub import ConsoleHub
from wil_campaign.plugins.console.console_server import ConsoleServer
from wil_campaign.plugins.console.feed.feed_messages import feed_codec
from wil_campaign.plugins.console.feed.feed_sockets import feed_receiver
from wil_campaign.plugins.console.flight_scope import FlightScope
from wil_campaign.plugins.console.page_commands import CommandSender
from wil_campaign.plugins.console.playback import Playback
from wil_campaign.plugins.console.recorded_run import RecordedRun

_LONGEST_BYTES = 1 << 18
_BACKLOG = 64
_NICE = 5
"""The console has lower priority than flights on the same cores."""
_LINGER_S = 2.0
"""How long a console runs after its campaign, so that pages show the end."""
_GOODBYE_S = 0.3
_CLOSE_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleSettings:
    """Content and address of a console. recorded: a finished run; None for runs in flight.

    folder: only campaigns that write their results there. tls: certificate and key. speed: replay
    speed of a finished run; 1 is real time.
    """

    address: ConsoleAddress
    folder: Path | None = None
    recorded: Path | None = None
    tls: tuple[Path, Path] | None = None
    speed: float = 1.0


Announce = Callable[[str], None]


async def serve_console(
    settings: ConsoleSettings, announce: Announce, *, beside: int | None = None
) -> None:
    """Serve a console until it is cancelled. Raises ConsoleError, RecordingError.

    announce: receives the links, one for operators and one for viewers. beside: the process of a
    campaign: the console shows only that campaign, and ends when standard input is closed and its
    guards are gone.
    """
    require_safe_console_address(settings.address, tls=settings.tls is not None)
    with contextlib.suppress(OSError):
        os.nice(_NICE)
    access = ConsoleAccess()
    scope = FlightScope(folder=settings.folder, program=beside)
    with _listening(settings.address) as end, CampaignPoller(scope) as poller:
        address = replace(settings.address, port=end.getsockname()[1])
        rules = RequestRules.of(address, tls=settings.tls is not None)
        mode = "live" if settings.recorded is None else "recorded"
        about = {"mode": mode, "poll_s": POLL_S, "whole_machine": scope.is_whole_machine}
        hub = ConsoleHub(about=about, access=access)
        recorded = playback = None
        if settings.recorded is not None:
            time = asyncio.get_running_loop().time
            playback = Playback(settings.speed, time=time, show=hub.show_playback)
            recorded = RecordedRun(settings.recorded, playback)
        server = ConsoleServer(
            access=access,
            rules=rules,
            hub=hub,
            sender=CommandSender(scope),
            cookie=f"wil_console_{address.port}",
            time=asyncio.get_running_loop().time,
            playback=playback,
        )
        async with _site(server, end, _tls(settings)):
            for role in get_args(Role):
                token = access.invite(role)
                announce(f"{role}: {rules.scheme}://{address.shown}/#{token}")
            await _feed_hub(scope, hub, poller, ends=beside is not None, recorded=recorded)


async def _feed_hub(
    scope: FlightScope,
    hub: ConsoleHub,
    poller: CampaignPoller,
    *,
    ends: bool,
    recorded: RecordedRun | None,
) -> None:
    """Feed the hub from live feeds, or from a recording, until the console should end."""
    async with open_task_group() as group:
        if recorded is None:
            source = group.create_task(_receive(hub, scope), name="live feeds")
        else:
            source = group.create_task(recorded.play(hub.receive), name="recorded run")
        polling = group.create_task(_poll(hub, poller), name="status")
        await _wait_for_end(poller, ends=ends)
        await asyncio.sleep(_LINGER_S)
        hub.say_goodbye()
        await asyncio.sleep(_GOODBYE_S)
        await stop_tasks(source, polling)


async def _wait_for_end(poller: CampaignPoller, *, ends: bool) -> None:
    """Wait until the scope's campaign has ended and landed; forever without `ends`."""
    closed = asyncio.Event()
    if not ends:
        await closed.wait()
        return
    loop, end = asyncio.get_running_loop(), sys.stdin.fileno()

    def close() -> None:
        loop.remove_reader(end)
        closed.set()

    # Nothing is written to stdin: it becomes readable when its other end closes.
    loop.add_reader(end, close)
    is_needed = True
    while is_needed:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(POLL_S):
                await closed.wait()
                await asyncio.sleep(POLL_S)
        is_landing = await asyncio.to_thread(poller.is_landing)
        is_needed = is_landing or not closed.is_set()


async def _receive(hub: ConsoleHub, scope: FlightScope) -> None:
    """Receive a scope's live feeds until cancelled; invalid datagrams are ignored."""
    loop = asyncio.get_running_loop()
    try:
        with feed_receiver() as end:
            while True:
                datagram = await loop.sock_recv(end, _LONGEST_BYTES)
                with contextlib.suppress(ProcessMessageError):
                    message = feed_codec.decode(datagram)
                    if scope.covers(message.run):
                        await hub.receive(message)
    except OSError as error:
        raise ConsoleError(f"live feeds cannot be received: {error}") from error


async def _poll(hub: ConsoleHub, poller: CampaignPoller) -> None:
    """Show the status of campaigns and guards until cancelled."""
    while True:
        hub.show_status(await asyncio.to_thread(poller.poll))
        await asyncio.sleep(POLL_S)


@asynccontextmanager
async def _site(
    server: ConsoleServer, end: socket.socket, tls: ssl.SSLContext | None
) -> AsyncIterator[None]:
    runner = web.AppRunner(server.application(), access_log=None, shutdown_timeout=_CLOSE_S)
    await runner.setup()
    try:
        await web.SockSite(runner, end, ssl_context=tls, backlog=_BACKLOG).start()
        yield
    finally:
        await runner.cleanup()
        server.close()


@contextmanager
def _listening(address: ConsoleAddress) -> Iterator[socket.socket]:
    try:
        family, _, _, _, place = socket.getaddrinfo(
            address.host, address.port, type=socket.SOCK_STREAM
        )[0]
        end = socket.create_server(place[:2], family=family, backlog=_BACKLOG)
    except OSError as error:
        raise ConsoleError(
            f"the console cannot listen at {address.shown}: {error.strerror or error}; give "
            "another address, or none for a free port"
        ) from error
    with end:
        end.setblocking(False)
        yield end


def _tls(settings: ConsoleSettings) -> ssl.SSLContext | None:
    if settings.tls is None:
        return None
    certificate, key = settings.tls
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise ConsoleError(
            f"{certificate} and {key} cannot be loaded as certificate and key: {error}"
        ) from error
    return context
