"""Every way in which a task can end otherwise than it was asked to."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.tasks import (
    SuppressedErrors,
    TaskAccount,
    finish_in_task,
    leaf_errors,
    open_task_group,
    raising_first_task_error,
    start_task,
    stop_tasks,
)


class ExpectedError(Exception):
    pass


def faults_of(main: Callable[[], Awaitable[None]]) -> list[tuple[str, str]]:
    """Run under an account; return the types of the faults, and where they arose."""
    faults: list[tuple[str, str]] = []

    def take(error: BaseException, where: str) -> None:
        faults.append((type(error).__name__, where))

    async def accounted() -> None:
        account = TaskAccount(fault=take, expected=(ExpectedError,))
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, what: take(what["exception"], what["message"]))
        with account.of(loop):
            await main()

    run_virtual(accounted())
    return faults


async def wait() -> None:
    await asyncio.sleep(10.0)


async def fail(error: BaseException) -> None:
    await asyncio.sleep(1.0)
    raise error


async def fail_together(count: int) -> None:
    async with open_task_group() as tasks:
        for number in range(count):
            tasks.create_task(fail(ExpectedError()), name=f"task {number}")


def test_tasks_that_return_or_are_stopped_are_no_faults() -> None:
    async def main() -> None:
        task = start_task(wait(), name="stopped")
        await asyncio.sleep(1.0)
        await stop_tasks(task)
        async with open_task_group() as tasks:
            tasks.create_task(wait(), name="returns")

    assert faults_of(main) == []


def test_an_unexpected_exception_is_a_fault_also_when_its_task_is_stopped_later() -> None:
    async def main() -> None:
        task = start_task(fail(KeyError("x")), name="fails")
        await asyncio.sleep(2.0)
        with pytest.raises(KeyError):
            await stop_tasks(task)

    assert faults_of(main) == [("KeyError", "fails")]


def test_an_unrequested_cancellation_is_a_fault() -> None:
    async def main() -> None:
        async with open_task_group() as tasks:
            tasks.create_task(fail(asyncio.CancelledError()), name="child")

    assert faults_of(main) == [("CancelledError", "child")]


def test_an_expected_error_is_a_fault_only_when_it_is_not_read() -> None:
    async def main() -> None:
        start_task(fail(ExpectedError()), name="unread")
        read = start_task(fail(ExpectedError()), name="read")
        with pytest.raises(ExpectedError):
            await read

    assert faults_of(main) == [("ExpectedError", "unread")]


def test_a_task_that_still_runs_at_the_end_is_a_fault() -> None:
    async def main() -> None:
        start_task(wait(), name="left over")

    assert faults_of(main) == [("RuntimeError", "left over")]


def test_a_task_that_must_finish_is_not_cut_off_by_cancellations() -> None:
    done: list[float] = []

    async def landing() -> None:
        await asyncio.sleep(5.0)
        done.append(asyncio.get_running_loop().time())

    async def main() -> None:
        task = start_task(finish_in_task(landing(), name="landing"), name="flight")
        for _ in range(3):
            await asyncio.sleep(1.0)
            task.cancel()
        await stop_tasks(task)
        assert task.cancelled()

    assert faults_of(main) == []
    assert done == [5.0]


def test_a_group_raises_a_single_error_as_it_is_and_several_as_a_group() -> None:
    async def main() -> None:
        with pytest.raises(ExpectedError):
            await fail_together(1)
        with pytest.raises(ExceptionGroup):
            await fail_together(2)

    assert faults_of(main) == []


def test_the_first_error_of_a_kind_leaves_its_group_alone() -> None:
    expected, other = ExpectedError("first"), KeyError("other")
    with pytest.raises(ExpectedError) as single, raising_first_task_error(ExpectedError, OSError):
        raise ExceptionGroup("tasks", [ExceptionGroup("inner", [expected, OSError("second")])])
    assert single.value is expected
    with pytest.raises(ExceptionGroup) as several, raising_first_task_error(ExpectedError):
        raise ExceptionGroup("tasks", [other, expected])
    assert leaf_errors(several.value) == [expected, other]
    with pytest.raises(ExceptionGroup) as none, raising_first_task_error(ExpectedError):
        raise ExceptionGroup("tasks", [other])
    assert leaf_errors(none.value) == [other]
    with pytest.raises(KeyError), raising_first_task_error(ExpectedError):
        raise other


def test_a_contained_exception_is_reported_and_ctrl_c_is_not_contained() -> None:
    async def main() -> None:
        with SuppressedErrors("a listener"):
            raise KeyError("x")
        with pytest.raises(KeyboardInterrupt), SuppressedErrors("a listener"):
            raise KeyboardInterrupt

    assert faults_of(main) == [("KeyError", "a listener")]


def test_what_is_to_be_finished_is_given_up_with_its_loop() -> None:
    """A second interrupt breaks a loop off; Python then closes the coroutines that it left."""
    with asyncio.Runner() as runner:
        loop = runner.get_loop()
        landing = finish_in_task(asyncio.sleep(600.0), name="landing")
        task = loop.create_task(landing)
        runner.run(asyncio.sleep(0.0))
        landing.close()
        assert not task.done()
