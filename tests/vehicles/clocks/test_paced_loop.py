"""A loop whose clock runs faster than the wall's."""

import asyncio
import socket
import time

import pytest

from orchestrator.model.clock import run_virtual
from vehicles.clocks.paced_loop import PacedLoop, call_wall_later
from vehicles.clocks.sim_clock_controller import Segment


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


def test_a_wall_timer_that_another_cancels_as_both_are_due_does_not_run() -> None:
    async def late() -> tuple[list[str], list[object]]:
        loop, ran, errors = asyncio.get_running_loop(), list[str](), list[object]()
        loop.set_exception_handler(lambda _, context: errors.append(context.get("exception")))
        timers: list[asyncio.Handle] = []

        def first() -> None:
            ran.append("first")
            timers[1].cancel()

        timers += [call_wall_later(0.0, first), call_wall_later(0.0, lambda: ran.append("second"))]
        time.sleep(0.01)  # noqa: ASYNC251 - both are due at the loop's next turn
        await asyncio.sleep(0.1)
        return ran, errors

    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        assert runner.run(late()) == (["first"], [])


def test_sockets_are_served_meanwhile() -> None:
    async def received() -> bytes:
        loop = asyncio.get_running_loop()
        one, other = socket.socketpair()
        with one, other:
            one.setblocking(False)
            loop.call_later(1.0, other.send, b"word")
            async with asyncio.timeout(100.0):
                return await loop.sock_recv(one, 10)

    with asyncio.Runner(loop_factory=lambda: PacedLoop(20.0)) as runner:
        assert runner.run(received()) == b"word"


def test_another_piece_of_the_clock_is_gone_on_by_and_time_never_goes_back() -> None:
    async def flown() -> list[float]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        times_s = [loop.time()]
        loop.follow(Segment(time.monotonic(), loop.time(), 50.0))
        await asyncio.sleep(5.0)
        times_s.append(loop.time())
        loop.follow(Segment(time.monotonic(), loop.time() - 1.0, 50.0))
        times_s.append(loop.time())
        await asyncio.sleep(1.0)
        times_s.append(loop.time())
        return times_s

    began_s = time.monotonic()
    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        times_s = runner.run(flown())
    assert times_s == sorted(times_s)
    assert times_s[-1] - times_s[0] >= 6.0
    assert time.monotonic() - began_s < 5.0


def test_the_walls_timers_come_while_the_clock_stands() -> None:
    async def waited() -> float:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        loop.follow(Segment(time.monotonic(), loop.time(), 0.0))
        began_s, rung = loop.time(), asyncio.Event()
        loop.call_later(0.001, rung.set)
        never = loop.call_wall_later(0.05, lambda: pytest.fail("was cancelled"))
        never.cancel()
        loop.call_wall_later(0.1, rung.set)
        await rung.wait()
        return loop.time() - began_s

    began_s = time.monotonic()
    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        assert runner.run(waited()) == 0.0
    assert 0.1 <= time.monotonic() - began_s < 5.0


def test_without_a_paced_loop_the_wall_is_the_loop_s_time() -> None:
    async def waited() -> float:
        rung = asyncio.Event()
        began_s = asyncio.get_running_loop().time()
        call_wall_later(7.0, rung.set)
        await rung.wait()
        return asyncio.get_running_loop().time() - began_s

    assert run_virtual(waited()) == 7.0
