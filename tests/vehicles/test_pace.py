"""A loop whose clock runs faster than the wall's."""

import asyncio
import socket
import time

from vehicles.pace import PacedLoop


def test_waits_take_as_much_of_the_wall_s_time_as_the_pace_leaves() -> None:
    async def waited() -> float:
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        await asyncio.sleep(20.0)
        return loop.time() - began_s

    began_s = time.monotonic()
    with asyncio.Runner(loop_factory=lambda: PacedLoop(50.0)) as runner:
        assert runner.run(waited()) >= 20.0
    assert 0.4 <= time.monotonic() - began_s < 15.0


def test_sockets_are_heard_meanwhile() -> None:
    async def heard() -> bytes:
        loop = asyncio.get_running_loop()
        one, other = socket.socketpair()
        with one, other:
            one.setblocking(False)
            loop.call_later(1.0, other.send, b"word")
            async with asyncio.timeout(100.0):
                return await loop.sock_recv(one, 10)

    with asyncio.Runner(loop_factory=lambda: PacedLoop(20.0)) as runner:
        assert runner.run(heard()) == b"word"
