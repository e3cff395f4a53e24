"""A loop whose clock runs faster than the wall's."""

import asyncio
import socket
import time

import pytest

from wil_campaign.foundation.clocks.paced_loop import PacedLoop, call_wall_later
from wil_campaign.foundation.clocks.progress import ClockProgressReporter
from wil_campaign.foundation.clocks.sim_clock_controller import ClockSegment
from wil_campaign.foundation.clocks.virtual_loop import run_virtual


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


def test_a_loop_goes_on_by_the_next_piece_of_the_clock_and_never_back() -> None:
    async def flown() -> list[float]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        times_s = [loop.time()]
        loop.follow(ClockSegment(time.monotonic(), loop.time(), 50.0))
        await asyncio.sleep(5.0)
        times_s.append(loop.time())
        loop.follow(ClockSegment(time.monotonic(), loop.time() - 1.0, 50.0))
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
        loop.follow(ClockSegment(time.monotonic(), loop.time(), 0.0))
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


def test_a_timer_beyond_the_end_of_a_piece_waits_idle_for_the_next() -> None:
    async def waited() -> tuple[float, float]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        began_s, rung = loop.time(), asyncio.Event()
        loop.follow(ClockSegment(time.monotonic(), began_s, 10.0, holds_s=0.05))
        loop.call_at(began_s + 0.501, rung.set)
        loop.call_wall_later(
            0.4, lambda: loop.follow(ClockSegment(time.monotonic(), began_s + 0.5, 10.0))
        )
        cpu_s = time.process_time()
        await rung.wait()
        return loop.time() - began_s, time.process_time() - cpu_s

    began_s = time.monotonic()
    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        took_s, cpu_s = runner.run(waited())
    assert 0.5 <= took_s < 30.0
    assert time.monotonic() - began_s >= 0.4
    assert cpu_s < 0.1


def test_a_loop_reports_how_far_it_has_come_and_a_thread_s_job_holds_it_back() -> None:
    async def reported() -> tuple[list[float], float, float, list[float]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        reports: list[float] = []
        progress = ClockProgressReporter(loop=loop, report=reports.append)
        while len(reports) <= 3:  # noqa: ASYNC110 - its turns are what is reported
            await asyncio.sleep(0.1)
        before = list(reports)
        began_s = loop.time()
        await asyncio.to_thread(time.sleep, 0.3)
        ended_s = loop.time()
        during = reports[len(before) :]
        await asyncio.sleep(0.1)
        progress.stop()
        assert reports[-1] > ended_s
        return before, began_s, ended_s, during

    with asyncio.Runner(loop_factory=lambda: PacedLoop(10.0)) as runner:
        before, began_s, ended_s, during = runner.run(reported())
    assert before == sorted(before)
    assert before[-1] <= began_s
    assert len(before) > 3
    assert ended_s >= began_s + 3.0
    # A busy machine may note the job's start late, by less than half of what it takes.
    assert max(during, default=0.0) <= ended_s - 1.5


def test_a_loop_that_is_ahead_of_the_first_piece_reports_how_far_it_is() -> None:
    async def ahead() -> tuple[float, list[float]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        reports: list[float] = []
        loop.follow(ClockSegment(time.monotonic(), loop.time() - 1.0, 4.0, holds_s=0.01))
        stands_s = loop.time()
        progress = ClockProgressReporter(loop=loop, report=reports.append)
        rung = asyncio.Event()
        loop.call_wall_later(0.2, rung.set)
        await rung.wait()
        progress.stop()
        return stands_s, reports

    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        stands_s, reports = runner.run(ahead())
    assert reports == [stands_s]


def test_a_loop_reports_after_its_timers_ran_and_its_sockets_were_read() -> None:
    async def flown() -> list[tuple[float, float, int]]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        began_s = loop.time()
        done_s, seen = [began_s], list[tuple[float, float, int]]()
        has_seen_enough = asyncio.Event()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        ours.setblocking(False)
        sent, read = [0], [0]

        def take() -> None:
            ours.recv(10)
            read[0] += 1

        def tick(count: int) -> None:
            done_s.append(began_s + count * 0.008)
            if count % 40 == 0:
                time.sleep(0.01)  # late: several are due, and several packets come
                for _ in range(8):
                    theirs.send(b"word")
                    sent[0] += 1
            loop.call_at(began_s + (count + 1) * 0.008, tick, count + 1)

        loop.add_reader(ours, take)
        tick(0)

        def report(run_s: float) -> None:
            seen.append((run_s, done_s[-1], sent[0] - read[0]))
            if len(seen) > 20:
                has_seen_enough.set()

        progress = ClockProgressReporter(loop=loop, report=report)
        async with asyncio.timeout(1000.0):  # without a processor for long it reports nothing
            await has_seen_enough.wait()
        progress.stop()
        loop.remove_reader(ours)
        ours.close()
        theirs.close()
        return seen

    with asyncio.Runner(loop_factory=lambda: PacedLoop(10.0)) as runner:
        seen = runner.run(flown())
    assert all(done_s > run_s - 0.008 - 1e-6 for run_s, done_s, _ in seen)
    assert all(unread == 0 for _, _, unread in seen)


def test_a_loop_that_is_flooded_reports_all_the_same() -> None:
    async def flooded() -> list[float]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        ours, theirs = socket.socketpair()
        theirs.send(b"never read")
        loop.add_reader(ours, lambda: None)
        reports: list[float] = []
        has_seen_enough = asyncio.Event()

        def report(run_s: float) -> None:
            reports.append(run_s)
            if len(reports) > 3:
                has_seen_enough.set()

        progress = ClockProgressReporter(loop=loop, report=report)
        async with asyncio.timeout(600.0):
            await has_seen_enough.wait()
        progress.stop()
        loop.remove_reader(ours)
        ours.close()
        theirs.close()
        return reports

    with asyncio.Runner(loop_factory=lambda: PacedLoop(10.0)) as runner:
        assert len(runner.run(flooded())) > 3


def test_the_first_reader_reads_before_all_others() -> None:
    async def read() -> list[str]:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, PacedLoop)
        pairs = [socket.socketpair() for _ in range(6)]
        order: list[str] = []

        def reader(name: str, end: socket.socket) -> None:
            end.recv(10)
            order.append(name)

        for index, (ours, theirs) in enumerate(pairs):
            if index == 4:
                loop.add_first_reader(ours, lambda: reader("first", pairs[4][0]))
            else:
                loop.add_reader(ours, reader, str(index), ours)
            theirs.send(b"word")
        await asyncio.sleep(0.05)
        for ours, theirs in pairs:
            loop.remove_reader(ours)
            ours.close()
            theirs.close()
        return order

    with asyncio.Runner(loop_factory=PacedLoop) as runner:
        order = runner.run(read())
    assert (order[0], len(order)) == ("first", 6)


def test_without_a_paced_loop_the_wall_is_the_loop_s_time() -> None:
    async def waited() -> float:
        rung = asyncio.Event()
        began_s = asyncio.get_running_loop().time()
        call_wall_later(7.0, rung.set)
        await rung.wait()
        return asyncio.get_running_loop().time() - began_s

    assert run_virtual(waited()) == 7.0
