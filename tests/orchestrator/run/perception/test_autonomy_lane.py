"""An autonomy's calls beside the loop, which they never hold up; what is too slow is its fault."""

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from tests.orchestrator.conftest import STEP, Fly
from wil_campaign.orchestrator.run.perception.autonomy_calls import AutonomyFault
from wil_campaign.orchestrator.run.perception.autonomy_lane import LoopLane, ThreadLane
from wil_campaign.orchestrator.state import call_marker
from wil_campaign.orchestrator.state.call_marker import CallMark, adopt_call_mark
from wil_campaign.vehicles.autonomy import Command
from wil_campaign.vehicles.readings import RangefinderReading
from wil_campaign.vehicles.setpoints import VelocitySetpoint
from wil_campaign.worlds.frames import Pose

STILL = Command(VelocitySetpoint((0.0, 0.0, 0.0)))
READING = RangefinderReading(1.0, 1.0, 0, "real", 2.0, 0.1, 9.0, Pose((0.0, 0.0, 0.0)))


@asynccontextmanager
async def lane(
    faults: list[AutonomyFault] | None = None, check: Callable[[], None] = lambda: None, **more: Any
) -> AsyncIterator[ThreadLane]:
    found = faults if faults is not None else []
    settings = {"rate_hz": 20.0, "call_s": 30.0, "longest_s": 0.1, **more}
    opened = ThreadLane(name="real", check=check, fault=found.append, **settings)
    try:
        yield opened
    finally:
        opened.close()


async def test_calls_are_made_in_their_order_in_another_thread() -> None:
    seen: list[object] = []
    async with lane() as calls:
        for number in range(3):
            calls.offer(lambda _, number=number: seen.append(number), READING, "perceive")  # type: ignore[misc]

        def act() -> Command:
            seen.append(threading.current_thread().name)
            return STILL

        assert await calls.act(act) == STILL
        assert seen == [0, 1, 2, "autonomy of real"]
        assert (calls.act_times.count, calls.perceive_times.count) == (1, 3)


async def test_a_call_is_marked_with_its_vehicle_and_whether_it_shows_a_goal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """For whoever outlives this process: its log may lack the last lines."""
    monkeypatch.setattr(call_marker, "_mark", None)
    mark, seen = CallMark(), []
    adopt_call_mark(mark.descriptor)

    def see(*_: object) -> Command:
        seen.append((mark.vehicle, mark.has_goal))
        return STILL

    in_loop = LoopLane(name="real", call_s=30.0, check=lambda: None)
    async with lane() as beside:
        for calls in (in_loop, beside):
            calls.offer(see, READING, "perceive")
            await calls.act(see)
            see()
    assert seen[:3] == [("real", False), ("real", True), ("", False)]
    assert seen[3:5] == seen[:2]


async def test_the_loop_goes_on_while_a_call_waits_and_the_fault_has_place_and_figures() -> None:
    release, turns = threading.Event(), 0
    async with lane() as calls:

        def act() -> Command:
            release.wait()
            return STILL

        asking = asyncio.create_task(calls.act(act))
        while not asking.done():
            turns += 1
            await asyncio.sleep(0.005)
        release.set()
        with pytest.raises(AutonomyFault) as failed:
            await asking
    assert turns > 10
    text = str(failed.value)
    assert text.startswith("is too slow for the wall clock: it is 0.1")
    assert " s behind: act has not answered for 0." in text
    assert "test_autonomy_lane.py:" in text
    assert "`release.wait()`" in text
    assert "of the 0.050 s between two of them (autonomy.rate_hz)" in text
    assert failed.value.kind == "FAIL"


async def test_an_act_that_always_takes_longer_than_its_period_is_too_slow_by_and_by() -> None:
    pause = threading.Event()
    async with lane(longest_s=0.3) as calls:

        def act() -> Command:
            pause.wait(0.1)
            return STILL

        async def act_on() -> None:
            while True:
                await calls.act(act)

        with pytest.raises(
            AutonomyFault,
            match=r"it is 0\.[3-9]\d s behind.*; act (took|has not answered for) 0\.(1|099)",
        ):
            await act_on()
        assert calls.act_times.count > 1


async def test_an_autonomy_that_is_late_once_catches_up() -> None:
    pause = threading.Event()
    async with lane() as calls:
        for wait_s in (0.1, 0.0, 0.0, 0.1, 0.0, 0.0, 0.1):

            def act(wait_s: float = wait_s) -> Command:
                pause.wait(wait_s)
                return STILL

            assert await calls.act(act) == STILL


async def test_the_limit_of_a_call_comes_before_the_longest_wait() -> None:
    release = threading.Event()
    async with lane(call_s=0.06, longest_s=60.0) as calls:
        with pytest.raises(AutonomyFault, match=r"gave no answer within 0\.06 s, its limit"):
            await calls.act(release.wait)
        release.set()


async def test_readings_that_wait_too_long_are_the_autonomy_s_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("wil_campaign.orchestrator.run.perception.autonomy_lane._OLDEST_S", 0.0)
    release, waited = threading.Event(), list[bool]()
    async with lane() as calls:
        calls.offer(lambda _: waited.append(release.wait()), READING, "perceive")
        with pytest.raises(AutonomyFault, match=r"too slow.*1 readings wait"):
            calls.offer(lambda _: None, READING, "perceive")
        release.set()


async def test_faults_of_both_kinds_arrive_in_the_loop() -> None:
    faults: list[AutonomyFault] = []
    async with lane(faults) as calls:

        def perceive(_: object) -> None:
            raise ValueError("blind")

        def act() -> Command:
            raise KeyError("lost")

        calls.offer(perceive, READING, "perceive")
        with pytest.raises(AutonomyFault, match="crashed: KeyError"):
            await calls.act(act)
        assert [str(fault)[:26] for fault in faults] == ["crashed: ValueError: blind"]

    def check() -> None:
        raise AutonomyFault("uses too much memory", kind="ERROR")

    async with lane(check=check) as calls:
        with pytest.raises(AutonomyFault, match="too much memory") as failed:
            await calls.act(lambda: STILL)
    assert failed.value.kind == "ERROR"


async def test_a_loop_that_stood_still_is_not_the_autonomy_s_fault() -> None:
    """As of a process that was stopped: the call was over long before the loop could see it."""
    async with lane() as calls:
        asking = asyncio.create_task(calls.act(lambda: STILL))
        await asyncio.sleep(0)
        threading.Event().wait(0.3)
        assert await asking == STILL
        assert calls.held_up() == ""


async def test_a_call_that_keeps_the_interpreter_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wil_campaign.orchestrator.run.perception.autonomy_lane._HELD_S", 0.05)
    async with lane(longest_s=60.0) as calls:

        def act() -> Command:
            _ = 3 ** (1 << 20)  # one operation, which lets nothing else of Python run
            return STILL

        while not calls.held_up():
            await calls.act(act)
        assert "held up the program: act used the processor for 0." in calls.held_up()


async def test_a_call_without_an_end_is_interrupted_at_the_end_of_the_run() -> None:
    ended = threading.Event()
    async with lane() as calls:

        def act() -> Command:
            try:
                while True:
                    pass
            finally:
                ended.set()

        with pytest.raises(AutonomyFault, match="too slow"):
            await calls.act(act)
    assert await asyncio.to_thread(ended.wait, 30.0)


def test_the_result_counts_calls_slower_than_real_time_on_the_virtual_clock(
    fly_run: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a limit that any autonomy exceeds: a slow one would cost the test its time."""
    monkeypatch.setattr(
        "wil_campaign.orchestrator.run.perception.autonomy_runner.LONGEST_BEHIND_S", -1e9
    )
    result, _ = fly_run(mode="sim", sets=STEP)
    (slow,) = result.slow
    assert (slow.vehicle, slow.needed_s > 0.0) == ("twin", True)
    assert slow.had_s == pytest.approx(1.0, abs=0.2)
