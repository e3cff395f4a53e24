"""Injected faults: a signal stops or freezes at its time, and comes back when that is over."""

import asyncio
from dataclasses import replace

import pytest

from wil_campaign.campaigns.values.signal_faults import SignalFault
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.signal_faults import (
    FaultyOnDemand,
    SignalFaults,
)
from wil_campaign.vehicles.cameras.rendered_cameras import NoImageError
from wil_campaign.vehicles.faults import FaultySignal
from wil_campaign.vehicles.readings import RangefinderReading, Reading
from wil_campaign.vehicles.readings.copies import restamp_reading
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

READING = RangefinderReading(
    t_s=1.0, arrived_s=1.1, seq=1, source="real", range_m=2.0, range_min_m=0.1, range_max_m=9.0
)


def later(range_m: float) -> RangefinderReading:
    return replace(READING, t_s=2.0, arrived_s=2.1, seq=2, range_m=range_m)


def test_a_signal_without_a_fault_passes() -> None:
    signal = FaultySignal(restamp_reading)
    assert signal.passed(READING) is READING


def test_a_signal_that_stops_gives_nothing_and_comes_back() -> None:
    signal = FaultySignal(restamp_reading)
    signal.passed(READING)
    signal.fault = "stop"
    assert signal.passed(later(3.0)) is None
    signal.fault = None
    assert signal.passed(later(3.0)) == later(3.0)


def test_a_signal_that_freezes_repeats_its_last_value_with_new_stamps() -> None:
    signal = FaultySignal(restamp_reading)
    signal.fault = "freeze"
    assert signal.passed(READING) is None, "nothing came before"
    signal.fault = None
    signal.passed(READING)
    signal.fault = "freeze"
    assert signal.passed(later(3.0)) == later(2.0)


def test_faults_begin_after_their_stage_and_end() -> None:
    notes: list[str] = []

    async def fly() -> list[float]:
        loop = asyncio.get_running_loop()
        run_state = RunState(time=loop.time)
        fault = SignalFault(
            vehicle="real", sensor="range", kind="stop", stage="goal", after_s=1.0, for_s=2.0
        )
        faults = SignalFaults([fault], run_state=run_state, note=notes.append)
        assert faults.signal("twin", "range", restamp_reading) is None
        assert faults.signal("real", None, restamp_reading) is None
        signal = faults.signal("real", "range", restamp_reading)
        assert signal is not None
        passed: list[float] = []
        begin_s = loop.time()
        for tick in range(60):
            if tick in {10, 40}:
                run_state.enter("goal")  # a second entry begins nothing
            if signal.passed(READING) is not None:
                passed.append(round(loop.time() - begin_s, 3))
            await asyncio.sleep(0.1)
        return passed

    passed = run_virtual(fly())
    silent = sorted({round(0.1 * tick, 3) for tick in range(60)} - set(passed))
    assert silent[0] == pytest.approx(2.0, abs=0.11)
    assert silent[-1] == pytest.approx(3.9, abs=0.11)
    assert len(silent) == pytest.approx(20, abs=1)
    assert [note.partition(":")[0] for note in notes] == ["begun", "ended"]


def test_a_sensor_that_is_asked_and_has_stopped_gives_no_image() -> None:
    class Asked:
        async def ask(
            self, body: Pose, t_s: float, *, want_depth: bool = False, want_ids: bool = False
        ) -> Reading:
            del body, want_depth, want_ids
            return replace(READING, t_s=t_s)

    async def ask() -> None:
        signal: FaultySignal[Reading] = FaultySignal(restamp_reading)
        sensor = FaultyOnDemand(Asked(), signal)
        assert (await sensor.ask(AT_ORIGIN, 3.0)).t_s == 3.0
        signal.fault = "stop"
        with pytest.raises(NoImageError, match="has stopped"):
            await sensor.ask(AT_ORIGIN, 4.0)

    asyncio.run(ask())


@pytest.mark.parametrize(
    ("sensor", "after_s", "is_decided", "begins"),
    [
        ("range", 1.0, False, True),
        ("range", 9.0, False, False),
        ("unread", 1.0, False, False),
        ("range", 9.0, True, True),
    ],
)
def test_a_run_whose_fault_never_began_is_invalid(
    sensor: str, after_s: float, is_decided: bool, begins: bool
) -> None:
    async def fly() -> list[str]:
        run_state = RunState(time=asyncio.get_running_loop().time)
        fault = SignalFault(
            vehicle="real", sensor=sensor, kind="stop", stage="goal", after_s=after_s
        )
        faults = SignalFaults([fault], run_state=run_state, note=lambda _: None)
        faults.signal("real", "range", restamp_reading)
        run_state.enter("goal")
        await asyncio.sleep(5.0)
        if is_decided:
            run_state.decide("FAIL", "a contact")
        run_state.enter("end")
        return [f"{event.kind}: {event.text}" for event in run_state.decisive]

    never = f"INVALID: an injected fault never began: the autonomy's sensor {sensor} of real stops"
    decided = run_virtual(fly())
    assert decided == ["FAIL: a contact"] if is_decided else len(decided) == (not begins)
    assert all(one.startswith((never, "FAIL")) for one in decided)
