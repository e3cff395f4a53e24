"""What comes over a link, for tests on the wall clock."""

import asyncio
from collections.abc import Callable

import pytest

from tests.ports import free_port
from wil_campaign.vehicles.links.link import Link


class Inbox:
    """Collects what a link receives, and waits for it."""

    def __init__(self, link: Link) -> None:
        self.data = b""
        self.pieces: list[bytes] = []
        self.times_s: list[float] = []
        link.receive(self._take)

    def _take(self, data: bytes, t_s: float) -> None:
        self.data += data
        self.pieces.append(data)
        self.times_s.append(t_s)

    async def holds(self, data: bytes, within_s: float = 5.0) -> None:
        await until(lambda: data in self.data, within_s)


async def until(condition: Callable[[], bool], within_s: float = 5.0) -> None:
    async with asyncio.timeout(within_s):
        while not condition():  # noqa: ASYNC110 - what is waited for is not ours
            await asyncio.sleep(0.005)


@pytest.fixture
def free_tcp_port() -> int:
    return free_port()


@pytest.fixture
def inbox() -> type[Inbox]:
    return Inbox


@pytest.fixture
def wait_until() -> Callable[..., object]:
    return until
