"""The run clock between the process that leads it and one that follows: both ends of its socket."""

import asyncio
import time

from wil_campaign.foundation.clocks.lockstep import LEAD_S
from wil_campaign.foundation.clocks.paced_loop import PacedLoop
from wil_campaign.foundation.clocks.sim_clock_controller import ClockSegment
from wil_campaign.foundation.processes.clock_socket import (
    ClockSockets,
    InheritedClock,
    clock_environment,
)


async def until(condition: asyncio.Event, limit_s: float = 20.0) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, PacedLoop)
    timer = loop.call_wall_later(limit_s, condition.set)
    await condition.wait()
    timer.cancel()


async def followed() -> tuple[list[float], float, float, list[str]]:
    """Lead a clock in the loop that follows it; then close the leader's end."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, PacedLoop)
    reports, left, there = list[float](), list[str](), asyncio.Event()

    def reached(name: str, run_s: float) -> None:
        assert name == "twin"
        reports.append(run_s)
        if run_s > begun_s + 0.5 * LEAD_S:
            there.set()

    sockets = ClockSockets(reached=reached, left=left.append)
    theirs = sockets.open("twin")
    clock = InheritedClock.of(loop, clock_environment(theirs))
    assert clock is not None
    theirs.detach()  # the clock has it, as a child would
    loop.follow(ClockSegment(time.monotonic(), loop.time(), 0.0))  # however late the piece is read
    begun_s = loop.time()
    sockets.send(ClockSegment(time.monotonic(), begun_s, 4.0, LEAD_S / 4.0))
    await until(there)
    rung = asyncio.Event()
    loop.call_wall_later(0.1, rung.set)
    await rung.wait()
    stood_s = loop.time() - begun_s
    sockets.close()
    await asyncio.sleep(1.0)
    return reports, stood_s, loop.segment.rate, left


def test_a_child_stands_where_a_piece_ends_and_goes_on_alone_without_its_leader() -> None:
    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        reports, stood_s, rate, left = runner.run(followed())
    assert reports == sorted(reports)
    assert abs(stood_s - LEAD_S) < 1e-6
    assert (rate, left) == (4.0, [])


def test_a_leader_learns_of_a_child_s_end() -> None:
    async def ended() -> list[str]:
        left, gone = list[str](), asyncio.Event()

        def leave(name: str) -> None:
            left.append(name)
            gone.set()

        sockets = ClockSockets(reached=lambda *_: None, left=leave)
        sockets.open("real").close()
        async with asyncio.timeout(20.0):
            await gone.wait()
        sockets.send(ClockSegment(0.0, 0.0, 1.0))
        sockets.close()
        return left

    assert asyncio.run(ended()) == ["real"]


def test_without_a_socket_there_is_no_clock_to_follow() -> None:
    async def found() -> InheritedClock | None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        return InheritedClock.of(loop, clock_environment(None))

    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        assert runner.run(found()) is None
