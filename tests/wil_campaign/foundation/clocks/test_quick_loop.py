"""The loop with short turns does what asyncio's own does, in the same order."""

import asyncio
import os
import selectors
import signal
import socket
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from wil_campaign.foundation.clocks.quick_loop import QuickLoop, quick_loop

LOOPS: tuple[Callable[[], asyncio.AbstractEventLoop], ...] = (QuickLoop, asyncio.new_event_loop)


def on_each(main: Callable[[], Coroutine[Any, Any, list[str]]], *, debug: bool = False) -> None:
    """Run the same on both loops: they differ in nothing that can be seen."""
    seen = []
    for factory in LOOPS:
        with asyncio.Runner(loop_factory=factory, debug=debug) as runner:
            seen.append(runner.run(main()))
    assert seen[0] == seen[1]
    assert seen[0]


@pytest.mark.parametrize("debug", [False, True])
def test_timers_callbacks_and_sockets_come_in_asyncio_s_order(debug: bool) -> None:
    async def main() -> list[str]:
        loop, ran, end = asyncio.get_running_loop(), list[str](), asyncio.Event()
        one, other = socket.socketpair()
        one.setblocking(False)
        other.setblocking(False)

        def read() -> None:
            ran.append(f"read {one.recv(9)!r}")
            loop.remove_reader(one)
            loop.add_writer(one, write)

        def write() -> None:
            ran.append("write")
            loop.remove_writer(one)
            end.set()

        loop.call_soon(ran.append, "first")
        loop.call_soon(lambda: loop.call_soon(ran.append, "turn after"))
        loop.call_at(loop.time() - 1.0, ran.append, "past")
        for _ in range(5):
            await asyncio.sleep(0.0)
        # On a busy machine all of them may be due in one turn, and have one order all the same.
        now_s = loop.time()
        for name, delay_s in (("late", 0.02), ("soon", 0.01), ("gone", 0.015)):
            timer = loop.call_at(now_s + delay_s, ran.append, name)
            if name == "gone":
                timer.cancel()
        loop.call_at(now_s + 0.05, other.send, b"word")
        loop.add_reader(one, read)
        with one, other:
            await end.wait()
        assert ran[-4:] == ["soon", "late", "read b'word'", "write"]
        return ran

    on_each(main, debug=debug)


def test_a_reader_that_another_removes_in_the_same_turn_is_not_called() -> None:
    async def main() -> list[str]:
        loop, ran = asyncio.get_running_loop(), list[str]()
        loop.set_exception_handler(lambda _, context: ran.append(str(context["message"])))
        pairs = [socket.socketpair() for _ in range(2)]

        def read() -> None:
            ran.append("read")
            for end, _ in pairs:
                loop.remove_reader(end)

        for end, far in pairs:
            loop.add_reader(end, read)
            far.send(b"word")
        await asyncio.sleep(0.05)
        for end, far in pairs:
            end.close()
            far.close()
        assert ran == ["read"]
        return ran

    on_each(main)


def test_a_closed_far_end_wakes_its_reader() -> None:
    async def main() -> list[str]:
        loop = asyncio.get_running_loop()
        one, other = socket.socketpair()
        one.setblocking(False)
        loop.call_later(0.01, other.close)
        with one:
            return [repr(await loop.sock_recv(one, 9))]

    on_each(main)


def test_more_sockets_than_a_turn_takes_are_all_read() -> None:
    async def main() -> list[str]:
        loop, ran, all_read = asyncio.get_running_loop(), set[int](), asyncio.Event()
        pairs = [socket.socketpair() for _ in range(40)]

        def read(number: int) -> None:
            ran.add(number)
            if len(ran) == len(pairs):
                all_read.set()

        for number, (end, far) in enumerate(pairs):
            loop.add_reader(end, read, number)
            far.send(b"word")
        async with asyncio.timeout(60.0):
            await all_read.wait()
        for end, far in pairs:
            loop.remove_reader(end)
            end.close()
            far.close()
        return [str(len(ran))]

    on_each(main)


def test_cancelled_timers_are_dropped_before_they_are_due() -> None:
    async def main() -> list[str]:
        loop = asyncio.get_running_loop()
        waits = loop.call_later(1e5, print)
        for _ in range(500):
            loop.call_later(1e6, print).cancel()
        await asyncio.sleep(0.01)
        left = len(vars(loop)["_scheduled"])
        waits.cancel()
        assert left <= 2
        return [str(left)]

    on_each(main)


def test_an_exception_of_a_callback_goes_to_the_handler_and_the_loop_goes_on() -> None:
    async def main() -> list[str]:
        loop, ran = asyncio.get_running_loop(), list[str]()
        loop.set_exception_handler(lambda _, context: ran.append(repr(context["exception"])))
        loop.call_soon(lambda: 1 / 0)
        await asyncio.sleep(0.0)
        loop.add_signal_handler(signal.SIGUSR1, ran.append, "signal")
        os.kill(os.getpid(), signal.SIGUSR1)
        ran.append(str(await loop.run_in_executor(None, lambda: 7)))
        await asyncio.sleep(0.01)
        return sorted(ran)

    on_each(main)


def test_the_loop_is_asyncios_without_epoll(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = quick_loop()
    loop.close()
    assert isinstance(loop, QuickLoop)
    monkeypatch.delattr(selectors, "EpollSelector")
    loop = quick_loop()
    loop.close()
    assert not isinstance(loop, QuickLoop)


def test_the_loop_is_asyncios_where_asyncio_is_built_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "wil_campaign.foundation.clocks.quick_loop._OF_SELECTOR", {"_fd_to_key", "_renamed"}
    )
    loop = quick_loop()
    loop.close()
    assert not isinstance(loop, QuickLoop)
