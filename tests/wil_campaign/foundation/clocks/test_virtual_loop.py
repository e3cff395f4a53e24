import asyncio
import threading
import time

import pytest

from wil_campaign.foundation.clocks.virtual_loop import (
    VirtualDeadlockError,
    VirtualLoop,
    run_virtual,
)


def test_time_jumps_exactly_to_each_timer() -> None:
    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        seen: list[float] = []
        for k in (3, 1, 2):
            loop.call_at(k / 250, lambda: seen.append(loop.time()))
        await asyncio.sleep(1.0)
        return [*seen, loop.time()]

    assert run_virtual(main()) == [1 / 250, 2 / 250, 3 / 250, 1.0]


def test_timers_of_one_instant_run_in_the_order_in_which_they_were_set() -> None:
    async def main() -> list[int]:
        loop = asyncio.get_running_loop()
        seen: list[int] = []
        for number in range(20):
            rounding_s = 1e-12 * (number % 3)
            loop.call_at(1.0 if number % 2 else 1.0 + rounding_s, seen.append, number)
        await asyncio.sleep(2.0)
        return seen

    seen = run_virtual(main())
    exact = [number for number in seen if number % 2 or number % 3 == 0]
    assert exact == sorted(exact)
    assert sorted(seen) == list(range(20))


def test_timers_a_rounding_apart_are_one_turn() -> None:
    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        seen: list[float] = []
        for when_s in (0.1 + 0.2, 0.3):
            loop.call_at(when_s, lambda: seen.append(loop.time()))
        await asyncio.sleep(1.0)
        return seen

    assert run_virtual(main()) == [0.3, 0.3]


def test_a_cancelled_timer_does_not_move_the_time() -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        loop.call_at(1.0, lambda: None).cancel()
        loop.call_at(3.0, lambda: None).cancel()
        asleep = asyncio.create_task(asyncio.sleep(2.0))
        await asyncio.sleep(0)
        asleep.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asleep
        return loop.time()

    assert run_virtual(main()) == 0.0


def test_a_cancelled_timer_hides_no_deadlock() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.call_at(1.0, lambda: None).cancel()
        await loop.create_future()

    with pytest.raises(VirtualDeadlockError):
        run_virtual(main())


def test_a_loop_stopped_before_it_runs_makes_one_turn() -> None:
    loop = VirtualLoop()
    try:
        loop.stop()
        loop.run_forever()
        assert loop.time() == 0.0
    finally:
        loop.close()


def test_an_hour_costs_no_time() -> None:
    began = time.monotonic()
    run_virtual(asyncio.sleep(3600.0))
    assert time.monotonic() - began < 60.0


def test_the_clock_holds_while_a_job_runs() -> None:
    release = threading.Event()

    async def main() -> tuple[float, str]:
        loop = asyncio.get_running_loop()
        job = loop.run_in_executor(None, release.wait)
        threading.Timer(0.05, release.set).start()
        await job
        return loop.time(), "done"

    assert run_virtual(main()) == (0.0, "done")


def test_results_come_in_the_order_of_submission() -> None:
    first_may_end = threading.Event()
    order: list[str] = []

    def slow() -> str:
        assert first_may_end.wait(10.0)
        return "first"

    def quick() -> str:
        first_may_end.set()
        return "second"

    async def main() -> None:
        loop = asyncio.get_running_loop()

        async def wait(job: "asyncio.Future[str]") -> None:
            order.append(await job)

        jobs = [loop.run_in_executor(None, slow), loop.run_in_executor(None, quick)]
        await asyncio.gather(*(wait(job) for job in reversed(jobs)))

    run_virtual(main())
    assert order == ["first", "second"]


def test_an_error_in_a_job_reaches_its_waiter() -> None:
    def fail() -> None:
        raise ValueError("no")

    async def main() -> None:
        loop = asyncio.get_running_loop()
        bad = loop.run_in_executor(None, fail)
        good = loop.run_in_executor(None, lambda: 5)
        assert await good == 5
        await bad

    with pytest.raises(ValueError, match="no"):
        run_virtual(main())


def test_a_cancelled_waiter_does_not_stop_the_clock() -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        job = loop.run_in_executor(None, lambda: 1)
        job.cancel()
        await asyncio.sleep(2.0)
        return loop.time()

    assert run_virtual(main()) == 2.0


def test_a_deadlock_is_an_error() -> None:
    async def main() -> None:
        await asyncio.get_running_loop().create_future()

    with pytest.raises(VirtualDeadlockError):
        run_virtual(main())


def test_timeouts_are_counted_in_virtual_time() -> None:
    async def main() -> float:
        loop = asyncio.get_running_loop()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(5.0):
                await loop.create_future()
        return loop.time()

    assert run_virtual(main()) == 5.0


def test_it_is_a_loop_of_its_own() -> None:
    loop = VirtualLoop()
    try:
        assert loop.time() == 0.0
    finally:
        loop.close()


def test_a_deadline_a_rounding_ahead_comes_also_while_others_are_busy() -> None:
    async def wait() -> float:
        loop = asyncio.get_running_loop()
        busy = asyncio.create_task(chatter(), name="busy")
        await asyncio.sleep(8.0 - 2e-14)
        for _ in range(3):
            if (left_s := 8.0 - loop.time()) > 0:
                await asyncio.sleep(left_s)
        busy.cancel()
        return loop.time()

    async def chatter() -> None:
        await asyncio.sleep(8.0 - 2e-14)
        for _ in range(1000):
            await asyncio.sleep(0)

    assert run_virtual(wait()) == 8.0
