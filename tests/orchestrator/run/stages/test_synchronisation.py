"""Skews of a pair: which command is timed, and that each limit ends a run that exceeds it."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.orchestrator.flights import all_landed
from wil_campaign.orchestrator.run.stages.synchronisation import Synchronisation
from wil_campaign.orchestrator.run.vehicles import pair as pair_module
from wil_campaign.orchestrator.state.liftoff_detector import LiftoffDetector
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.vehicles.clocks.timesync import VehicleClock

LIMITS: Any = SimpleNamespace(
    max_command_skew_s=0.1, max_takeoff_skew_s=0.2, max_t0_skew_s=0.3, takeoff_timeout_s=20.0
)
ARM, TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF
Record = Callable[[str, float, bytes], None]


def pair(*names: str) -> tuple[Synchronisation, RunState, Record, dict[str, Any]]:
    run_state = RunState(time=lambda: 5.0)
    sync = Synchronisation(setup=LIMITS, run_state=run_state)
    contexts = {name: SimpleNamespace(name=name, liftoff=LiftoffDetector()) for name in names}
    sync.attach(cast("Any", tuple(contexts.values())))
    run_state.enter("takeoff")
    return sync, run_state, sync.recording(lambda _name, _t_s, _frame: None), contexts


def frame(command: int, *, as_int: bool = False) -> bytes:
    sender = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    if as_int:
        message = mavlink.MAVLink_command_int_message(
            1, 1, 3, command, 0, 0, *([0.0] * 4), 0, 0, 1.2
        )
    else:
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *([0.0] * 7))
    return bytes(message.pack(sender))


def liftoff(context: Any, began_s: float) -> None:
    for step in range(4):
        context.liftoff.observe(began_s + step / 2, height_m=step / 2, climb_m_s=1.0)


@pytest.mark.parametrize("as_int", [False, True])
def test_the_first_takeoff_command_is_timed_and_no_other_frame(as_int: bool) -> None:
    sync, _, record, _ = pair("real", "twin")
    for name, armed_s, off_s in (("real", 1.0, 3.0), ("twin", 2.0, 3.05)):
        record(name, armed_s, frame(ARM))
        record(name, off_s, frame(TAKEOFF, as_int=as_int))
        record(name, 9.0 if name == "twin" else off_s, frame(TAKEOFF, as_int=as_int))
    assert sync.result().command_skew_s == pytest.approx(0.05)


@pytest.mark.parametrize(("late_s", "decided"), [(0.0, 0), (0.3, 1)])
def test_a_stagger_that_is_meant_is_no_skew_of_the_commands(late_s: float, decided: int) -> None:
    sync, run_state, record, contexts = pair("real", "twin")
    sync.stagger({"real": 0.0, "twin": 1.5})
    for name, command_s in (("real", 0.0), ("twin", 1.5 + late_s)):
        record(name, command_s, frame(TAKEOFF))
        liftoff(contexts[name], 3.0)
    sync.check_takeoff()
    assert len(run_state.decisive) == decided
    assert sync.result().liftoff_delays_s == pytest.approx({"real": 3.0, "twin": 1.5 - late_s})


def test_no_command_but_a_takeoff_gives_a_skew() -> None:
    sync, _, record, _ = pair("real", "twin")
    for name in ("real", "twin"):
        record(name, 1.0, frame(ARM))
    assert sync.result().command_skew_s is None


@pytest.mark.parametrize(
    ("skews_s", "reason"),
    [
        ((0.0, 0.0), None),
        ((0.1, 0.2), None),
        ((0.11, 0.0), "command skew 0.110 s exceeds 0.1 s"),
        ((0.0, 0.25), "takeoff skew 0.250 s exceeds 0.2 s"),
    ],
)
def test_a_pair_beyond_its_limits_at_takeoff_is_invalid(
    skews_s: tuple[float, float], reason: str | None
) -> None:
    sync, run_state, record, contexts = pair("real", "twin")
    for name, command_s, lifted_s in (("real", 0.0, 0.0), ("twin", *skews_s)):
        record(name, command_s, frame(TAKEOFF))
        liftoff(contexts[name], lifted_s)
    sync.check_takeoff()
    decided = [(event.kind, event.text) for event in run_state.decisive]
    assert decided == ([] if reason is None else [("INVALID", reason)])


@pytest.mark.parametrize(("doubt_s", "decided"), [(0.02, 0), (0.03, 1)])
def test_the_limit_of_the_liftoffs_counts_the_doubt_of_both_clocks(
    doubt_s: float, decided: int
) -> None:
    sync, run_state, record, contexts = pair("real", "twin")
    for name, lifted_s in (("real", 0.0), ("twin", 0.15)):
        record(name, 0.0, frame(TAKEOFF))
        contexts[name].liftoff.observe(lifted_s - 1.0, height_m=0.0, climb_m_s=0.0, doubt_s=doubt_s)
        liftoff(contexts[name], lifted_s)
    sync.check_takeoff()
    text = "takeoff skew 0.150 s may be up to 0.210 s, for the vehicles' clocks are known to "
    reasons = [event.text for event in run_state.decisive]
    assert reasons == [f"{text}0.060 s; the limit is 0.2 s"] * decided


@pytest.mark.parametrize(
    ("commanded", "lifted", "reason"),
    [
        (("real",), ("real", "twin"), "command skew was not measured: no takeoff command to twin"),
        (("real", "twin"), ("twin",), "takeoff skew was not measured: no liftoff of real"),
    ],
)
def test_a_skew_that_was_not_measured_is_invalid(
    commanded: tuple[str, ...], lifted: tuple[str, ...], reason: str
) -> None:
    sync, run_state, record, contexts = pair("real", "twin")
    for name in commanded:
        record(name, 0.0, frame(TAKEOFF))
    for name in lifted:
        liftoff(contexts[name], 0.0)
    sync.check_takeoff()
    assert [(event.kind, event.text) for event in run_state.decisive] == [("INVALID", reason)]


@pytest.mark.parametrize(("skew_s", "decided"), [(0.3, []), (0.35, ["INVALID"])])
def test_a_goal_given_too_far_apart_is_invalid(skew_s: float, decided: list[str]) -> None:
    sync, run_state, _, _ = pair("real", "twin")
    sync.goal_given("real", 0.0)
    assert run_state.decisive == []
    sync.goal_given("twin", skew_s)
    assert [event.kind for event in run_state.decisive] == decided
    assert sync.result().t0_skew_s == skew_s


@pytest.mark.parametrize(
    ("given", "left", "is_done", "decided"),
    [
        (("real",), False, True, 1),
        (("real", "twin"), False, True, 0),
        (("real",), True, True, 0),
        (("real",), False, False, 0),
        ((), False, True, 0),
    ],
    ids=["alone", "both", "dropped out", "ended before", "neither"],
)
def test_a_twin_that_was_never_flown_is_invalid(
    given: tuple[str, ...], left: bool, is_done: bool, decided: int
) -> None:
    """Its program gave no setpoint, the twin hovered, and a skew that nobody measured passed."""
    sync, run_state, _, _ = pair("real", "twin")
    run_state.enter("goal")
    for name in given:
        sync.goal_given(name, 0.0)
    if left:
        run_state.drop_out("twin", "for the test")
    if is_done:
        run_state.enter("done")
    run_state.enter("land")
    reasons = [event.text for event in run_state.decisive]
    assert reasons == ["t0 skew was not measured: no setpoint to twin"] * decided
    assert not run_state.over.is_set(), "it lands already"


def test_one_vehicle_alone_has_no_skew_to_measure() -> None:
    sync, run_state, record, contexts = pair("twin")
    record("twin", 0.0, frame(TAKEOFF))
    liftoff(contexts["twin"], 0.0)
    sync.check_takeoff()
    assert run_state.decisive == []
    assert sync.result().takeoff_skew_s is None


def test_drift_of_an_estimate_on_the_ground_is_no_liftoff() -> None:
    """Both drifted up at one time while they stood; that they never left the ground is INVALID."""
    run_state = RunState(time=lambda: 5.0)
    sync = Synchronisation(setup=LIMITS, run_state=run_state)
    contexts: Any = [
        SimpleNamespace(name=name, liftoff=LiftoffDetector()) for name in ("real", "twin")
    ]
    sync.attach(tuple(contexts))
    for context in contexts:
        liftoff(context, 1.0)
    assert sync.result().takeoff_skew_s == pytest.approx(0.0)
    run_state.enter("takeoff")
    assert sync.result().takeoff_skew_s is None
    sync.check_takeoff()
    reasons = [one.text for one in run_state.decisive if one.source == "sync/takeoff"]
    assert reasons == ["takeoff skew was not measured: no liftoff of real and twin"]


@pytest.mark.parametrize(
    ("doubt_s", "for_s", "decided"), [(0.3, 4.0, 1), (0.3, 2.0, 0), (0.2, 9.0, 0)]
)
def test_a_clock_in_doubt_is_noticed_in_flight(doubt_s: float, for_s: float, decided: int) -> None:
    run_state = RunState(time=lambda: 5.0)
    sync = Synchronisation(setup=LIMITS, run_state=run_state, max_clock_error_s=0.25)
    clock, heard = SimpleNamespace(uncertainty_s=0.0), list[Callable[[Any], None]]()
    driver = SimpleNamespace(clock=clock, on_estimate=heard.append)
    sync.watch_clocks((cast("Any", SimpleNamespace(name="real", driver=driver)),))

    def fly(from_s: float, seconds: float, doubt_s: float) -> None:
        clock.uncertainty_s = doubt_s
        for tick in range(round(seconds * 50)):
            heard[0](SimpleNamespace(t_s=from_s + tick / 50))

    fly(0.0, 9.0, doubt_s)
    run_state.enter("takeoff")
    fly(9.0, 5.0, 0.001)
    fly(14.0, for_s, doubt_s)
    fly(25.0, 5.0, 0.001)
    run_state.enter("landed")
    fly(30.0, 9.0, doubt_s)
    text = "the clock of real is known to 0.300 s only, for 3 s from 14.0 s on; "
    text += "preflight.max_clock_error_s is 0.25 s"
    decisive = [(one.kind, one.source, one.text) for one in run_state.decisive]
    assert decisive == [("INVALID", "sync/clock", text)] * decided


@pytest.mark.parametrize("is_overridden", [False, True])
def test_a_vehicle_that_stops_to_answer_timesync_in_flight_proves_nothing(
    is_overridden: bool, fly_run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stamps are mapped by an old pace: its distances and skews are of other moments."""
    answered = VehicleClock.answered

    def until_takeoff(self: VehicleClock, *, tc1: int, ts1: int, arrived_s: float) -> bool:
        return arrived_s < 8.0 and answered(self, tc1=tc1, ts1=ts1, arrived_s=arrived_s)

    monkeypatch.setattr(VehicleClock, "answered", until_takeoff)
    monkeypatch.setattr(pair_module, "_CLOCK_DRIFT", 0.02)  # that of an attached vehicle
    sets = ["preflight.max_clock_error_s=0.05"]
    sets += ["preflight.override.clock=the test"] * is_overridden
    result, folder = fly_run(sets=tuple(sets))
    assert all_landed(folder)
    if is_overridden:
        assert result.verdict == "PASS"
        return
    assert result.verdict == "INVALID"
    assert " is known to 0.110 s only, for 3 s from 15.1 s on" in result.reason
