"""Messages that come quicker than they are read do not hold the loop up."""

import asyncio
import socket
import time
from typing import Any

from wil_campaign.plugins.readings.subscription import Subscription


class Flooded:
    """A socket with messages without end; as far as a subscription looks at it."""

    def __init__(self, end: socket.socket, messages: int) -> None:
        self._end = end
        self.left = messages

    def fileno(self) -> int:
        return self._end.fileno()

    def poll(self, *_: object) -> int:
        return int(self.left > 0)

    def recv_multipart(self, *_: object) -> list[bytes]:
        self.left -= 1
        return [b"topic", b"%d" % self.left]


def busy_for(seconds: float) -> None:
    until_s = time.perf_counter() + seconds
    while time.perf_counter() < until_s:
        pass


async def test_a_flood_is_read_in_turns_of_the_loop() -> None:
    ours, theirs = socket.socketpair()
    flooded: Any = Flooded(ours, 400)
    taken: list[bytes] = []

    def take(data: bytes, _: float) -> None:
        taken.append(data)
        busy_for(0.001)

    subscription = Subscription(flooded, take)
    with ours, theirs:
        subscription.start()
        turns: list[int] = []
        while flooded.left and len(turns) < 1000:
            await asyncio.sleep(0)
            turns.append(len(taken))
        assert taken == [b"%d" % k for k in reversed(range(400))], "all of it, in order"
        assert len(turns) > 20
        flooded.left = 400
        theirs.send(b"1")
        while len(taken) == 400:  # noqa: ASYNC110 - a socket sets no event
            await asyncio.sleep(0)
        subscription.stop()
        held = len(taken)
        await asyncio.sleep(0.05)
        assert len(taken) == held < 800, "nothing is taken afterwards"
