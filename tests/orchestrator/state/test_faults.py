"""Faults: each is kept once, also where whoever takes it raises."""

import asyncio
from collections.abc import Callable

import pytest

from wil_campaign.orchestrator.state.faults import InternalFault, InternalFaults


def faults_of(take: Callable[[InternalFault], None]) -> tuple[InternalFaults, list[str]]:
    logged: list[str] = []
    faults = InternalFaults(
        time=lambda: 1.0, log=lambda fault: logged.append(fault.text), take=take
    )
    return faults, logged


def test_an_exception_of_a_fault_handler_is_recorded_and_not_handled() -> None:
    taken: list[str] = []

    def take(fault: InternalFault) -> None:
        taken.append(fault.text)
        raise LookupError("no such style")

    faults, logged = faults_of(take)
    with faults.recording("a verdict"):
        raise ValueError("boom")
    assert taken == ["a verdict: ValueError: boom"]
    assert logged == [
        "a verdict: ValueError: boom",
        "the report of a fault in a verdict: LookupError: no such style",
    ]
    assert [fault.text for fault in faults.all] == logged


def test_a_fault_that_its_handler_raises_again_is_recorded_once() -> None:
    boom = ValueError("boom")

    def take(_: InternalFault) -> None:
        raise boom

    faults, logged = faults_of(take)
    faults.record(boom, "a display")
    assert logged == ["a display: ValueError: boom"]


def test_a_cancellation_that_a_fault_handler_requests_is_raised() -> None:
    def take(_: InternalFault) -> None:
        task = asyncio.current_task()
        assert task is not None
        task.cancel()
        raise asyncio.CancelledError

    faults, logged = faults_of(take)

    async def run() -> None:
        faults.record(ValueError("boom"), "a display")

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(run())
    assert logged == ["a display: ValueError: boom"]


def test_a_fault_has_the_notes_of_its_exception() -> None:
    error = IndexError("list index out of range")
    error.add_note("(oracle 'gentle' of twin, gentle.py line 24)")
    assert InternalFault.of(error, "in flight", 1.0).text == (
        "in flight: IndexError: list index out of range "
        "(oracle 'gentle' of twin, gentle.py line 24)"
    )
