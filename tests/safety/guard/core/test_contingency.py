import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.guard.core.contingency import (
    Contingency,
    ContingencyAction,
    ContingencyFacts,
    ContingencyPhase,
    ContingencyPlan,
)
from wil_campaign.vehicles.autopilots.autopilot import FlightMode

FLYING = ContingencyFacts(
    armed=True, mode=FlightMode.GUIDED, landed=False, up_m=2.0, speed_m_s=1.0, seen_s=0.0
)


def started(plan: ContingencyPlan | None = None, facts: ContingencyFacts = FLYING) -> Contingency:
    contingency = Contingency(plan or ContingencyPlan())
    contingency.start(facts, 0.0)
    return contingency


def at_phase(phase: ContingencyPhase, *, plan: ContingencyPlan | None = None) -> Contingency:
    contingency = started(plan)
    contingency.phase = phase
    return contingency


def test_an_obedient_vehicle_goes_through_all_phases_of_the_way_down() -> None:
    c = Contingency(ContingencyPlan())
    assert c.start(FLYING, 0.0) == [ContingencyAction.ZERO, ContingencyAction.HOLD]
    assert c.step(FLYING, 0.05) == [ContingencyAction.ZERO]
    assert c.step(FLYING, 0.5) == [ContingencyAction.ZERO, ContingencyAction.HOLD]
    holds = replace(FLYING, mode=FlightMode.HOLD)
    assert c.step(holds, 0.6) == []
    assert c.step(replace(holds, speed_m_s=0.1), 0.7) == [ContingencyAction.LAND]
    lands = replace(FLYING, mode=FlightMode.LAND)
    assert c.step(lands, 0.8) == []
    assert c.phase is ContingencyPhase.DESCEND
    assert c.step(replace(lands, landed=True, up_m=0.0), 5.0) == [
        ContingencyAction.LAND,
        ContingencyAction.DISARM,
    ]
    assert c.step(replace(lands, armed=False, landed=True), 5.1) == []
    assert c.down
    assert [note.split(":")[0] for note in c.notes] == [
        "holding",
        "commanded to land",
        "descending",
        "on the ground",
        "down",
    ]


@pytest.mark.parametrize(
    ("phase", "facts", "to"),
    [
        (ContingencyPhase.HOLD, {"landed": True}, ContingencyPhase.DISARM),
        (ContingencyPhase.HOLD, {"mode": FlightMode.LAND}, ContingencyPhase.DESCEND),
        (
            ContingencyPhase.HOLD,
            {"mode": FlightMode.RTL, "failsafe": True},
            ContingencyPhase.SUPERVISE,
        ),
        (ContingencyPhase.HOLD, {"mode": FlightMode.RTL}, ContingencyPhase.HOLD),
        (ContingencyPhase.HOLD, {"mode": FlightMode.HOLD, "speed_m_s": 0.1}, ContingencyPhase.LAND),
        (ContingencyPhase.HOLD, {"mode": FlightMode.HOLD}, ContingencyPhase.HOLD),
        (
            ContingencyPhase.HOLD,
            {"mode": FlightMode.HOLD, "failsafe": True, "speed_m_s": 0.1},
            ContingencyPhase.LAND,
        ),
        (ContingencyPhase.LAND, {"mode": FlightMode.LAND}, ContingencyPhase.DESCEND),
        (ContingencyPhase.LAND, {"mode": FlightMode.HOLD}, ContingencyPhase.LAND),
        (ContingencyPhase.LAND, {"landed": True}, ContingencyPhase.DISARM),
        (
            ContingencyPhase.LAND,
            {"mode": FlightMode.RTL, "failsafe": True},
            ContingencyPhase.SUPERVISE,
        ),
        (ContingencyPhase.DESCEND, {"mode": FlightMode.LAND}, ContingencyPhase.DESCEND),
        (ContingencyPhase.DESCEND, {"mode": FlightMode.GUIDED}, ContingencyPhase.LAND),
        (
            ContingencyPhase.DESCEND,
            {"mode": FlightMode.LAND, "landed": True},
            ContingencyPhase.DISARM,
        ),
        (
            ContingencyPhase.DESCEND,
            {"mode": FlightMode.RTL, "failsafe": True},
            ContingencyPhase.SUPERVISE,
        ),
        (
            ContingencyPhase.SUPERVISE,
            {"mode": FlightMode.RTL, "failsafe": True},
            ContingencyPhase.SUPERVISE,
        ),
        (
            ContingencyPhase.SUPERVISE,
            {"mode": FlightMode.LAND, "failsafe": True},
            ContingencyPhase.DESCEND,
        ),
        (ContingencyPhase.SUPERVISE, {"mode": FlightMode.GUIDED}, ContingencyPhase.HOLD),
        (
            ContingencyPhase.SUPERVISE,
            {"mode": FlightMode.RTL, "landed": True},
            ContingencyPhase.DISARM,
        ),
        (
            ContingencyPhase.DISARM,
            {"mode": FlightMode.LAND, "landed": True},
            ContingencyPhase.DISARM,
        ),
        (
            ContingencyPhase.DISARM,
            {"mode": FlightMode.LAND, "landed": False},
            ContingencyPhase.HOLD,
        ),
        (ContingencyPhase.DOWN, {"armed": True}, ContingencyPhase.HOLD),
        (ContingencyPhase.TERMINATE, {"mode": FlightMode.LAND}, ContingencyPhase.TERMINATE),
        (ContingencyPhase.PILOT, {"mode": FlightMode.GUIDED}, ContingencyPhase.PILOT),
    ],
)
def test_each_phase_has_its_next_phase(
    phase: ContingencyPhase, facts: dict[str, object], to: ContingencyPhase
) -> None:
    c = at_phase(phase)
    c.step(replace(FLYING, **facts), 0.3)  # type: ignore[arg-type] # fields by name
    assert c.phase is to


@pytest.mark.parametrize(
    "phase",
    [p for p in ContingencyPhase if p not in {ContingencyPhase.IDLE, ContingencyPhase.PAUSE}],
)
def test_disarmed_is_down_and_a_pilot_ends_all_sending(phase: ContingencyPhase) -> None:
    c = at_phase(phase)
    assert c.step(replace(FLYING, armed=False), 0.3) == []
    assert c.phase is ContingencyPhase.DOWN
    c = at_phase(phase)
    piloted = replace(FLYING, pilot=True, mode=FlightMode.PILOT)
    assert [c.step(piloted, t_s) for t_s in (0.3, 1.0, 60.0)] == [[], [], []]
    assert c.phase is ContingencyPhase.PILOT


def test_a_hold_that_is_not_seen_does_not_stop_the_landing() -> None:
    c = started()
    assert c.step(FLYING, 1.95) == [ContingencyAction.ZERO, ContingencyAction.HOLD]
    assert c.step(FLYING, 2.0) == [ContingencyAction.ZERO, ContingencyAction.LAND]
    # and it goes on asking, and streaming, for ever
    assert c.step(FLYING, 600.0) == [ContingencyAction.ZERO, ContingencyAction.LAND]


def test_braking_has_its_time_even_when_the_speed_is_not_known() -> None:
    c = started()
    holds = ContingencyFacts(armed=True, mode=FlightMode.HOLD, landed=None)
    assert c.step(holds, 0.9) == []
    assert c.step(holds, 1.0) == [ContingencyAction.LAND]


def sink(
    c: Contingency, facts: ContingencyFacts, *, since_s: float, seconds: float, rate: float
) -> set[ContingencyAction]:
    """Step at 20 Hz while the height falls at `rate`; returns all that was sent."""
    sent: set[ContingencyAction] = set()
    for i in range(round(seconds * 20)):
        t_s = since_s + i / 20
        up_m = 50.0 - rate * i / 20
        facts_then = replace(facts, up_m=up_m, seen_s=t_s, speed_m_s=abs(rate))
        sent.update(c.step(facts_then, t_s))
    return sent


LANDING = replace(FLYING, mode=FlightMode.LAND)


def test_motors_are_cut_only_after_repeated_stalls() -> None:
    c = at_phase(ContingencyPhase.DESCEND, plan=ContingencyPlan(terminate=True))
    assert sink(c, LANDING, since_s=1.0, seconds=14.9, rate=0.0) == {
        ContingencyAction.LAND,
        ContingencyAction.DISARM,
    }
    assert ContingencyAction.TERMINATE in sink(c, LANDING, since_s=15.9, seconds=1.0, rate=0.0)


def test_no_opt_in_no_termination_and_it_never_gives_up() -> None:
    c = at_phase(ContingencyPhase.DESCEND)
    sent = sink(c, LANDING, since_s=1.0, seconds=300, rate=0.0)
    assert sent == {ContingencyAction.LAND, ContingencyAction.DISARM}


@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.GUIDED])
def test_slow_descent_is_progress_however_long_it_takes(mode: FlightMode) -> None:
    c = at_phase(ContingencyPhase.DESCEND, plan=ContingencyPlan(terminate=True))
    sent = sink(c, replace(FLYING, mode=mode), since_s=1.0, seconds=900, rate=0.03)
    assert ContingencyAction.TERMINATE not in sent


@pytest.mark.parametrize(
    "facts",
    [
        replace(LANDING, up_m=None, seen_s=None),
        replace(LANDING, up_m=2.0, seen_s=0.0),
        replace(FLYING, up_m=None, seen_s=None),
    ],
)
def test_time_without_evidence_never_cuts_motors(facts: ContingencyFacts) -> None:
    c = at_phase(ContingencyPhase.LAND, plan=ContingencyPlan(terminate=True))
    sent = {action for i in range(20 * 600) for action in c.step(facts, 1.0 + i / 20)}
    assert ContingencyAction.TERMINATE not in sent


def test_progress_forgives_earlier_stalls() -> None:
    c = at_phase(ContingencyPhase.DESCEND, plan=ContingencyPlan(terminate=True))
    sink(c, LANDING, since_s=0.0, seconds=12, rate=0.0)
    sink(c, replace(LANDING), since_s=12.0, seconds=4, rate=0.5)
    assert ContingencyAction.TERMINATE not in sink(c, LANDING, since_s=16.0, seconds=12, rate=0.0)


RTL = replace(FLYING, mode=FlightMode.RTL, failsafe=True)


def hopeless(facts: ContingencyFacts) -> Contingency:
    """Return a contingency that cuts the motors, of which nothing has arrived."""
    c = at_phase(ContingencyPhase.LAND, plan=ContingencyPlan(terminate=True))
    assert ContingencyAction.TERMINATE in sink(c, facts, since_s=0.05, seconds=16.0, rate=0.0)
    return c


@pytest.mark.parametrize(
    ("facts", "rate", "phase"),
    [
        (LANDING, 0.5, ContingencyPhase.DESCEND),
        (RTL, -0.5, ContingencyPhase.SUPERVISE),
        # Its heartbeats are lost.
        (replace(FLYING, mode=FlightMode.HOLD), 0.5, ContingencyPhase.LAND),
    ],
)
def test_motors_are_not_cut_any_more_once_it_comes_down(
    facts: ContingencyFacts, rate: float, phase: ContingencyPhase
) -> None:
    """What cuts them may arrive late, by a link that was open in one direction only."""
    c = hopeless(replace(FLYING, mode=FlightMode.HOLD))
    sink(c, facts, since_s=20.0, seconds=1.0, rate=rate)
    assert ContingencyAction.TERMINATE not in sink(c, facts, since_s=21.0, seconds=2.0, rate=rate)
    assert c.phase is phase


def test_a_failsafe_that_moves_is_left_alone() -> None:
    c = started()
    sent = [c.step(replace(RTL, seen_s=i / 20, up_m=2.0 + i / 20), i / 20) for i in range(1, 600)]
    assert not any(sent)
    assert c.phase is ContingencyPhase.SUPERVISE


def test_a_failsafe_that_flies_on_for_ever_is_made_to_land() -> None:
    c = started()
    sent = [c.step(replace(RTL, seen_s=i / 20), i / 20) for i in range(1, 20 * 62)]
    assert not any(sent[: 20 * 59])
    assert sent[-20 * 2 :].count([ContingencyAction.LAND]) > 1
    assert c.phase is ContingencyPhase.LAND


def test_a_failsafe_without_positions_has_its_time_too() -> None:
    c = started()
    blind = replace(RTL, up_m=None, speed_m_s=None, seen_s=None)
    assert not any(c.step(blind, i / 20) for i in range(1, 20 * 59))
    assert c.step(blind, 61.0) == [ContingencyAction.LAND]


def test_a_failsafe_that_sinks_slowly_is_left_alone() -> None:
    c = started()
    assert not sink(c, RTL, since_s=0.05, seconds=300, rate=0.05)


@pytest.mark.parametrize("rate_hz", [4, 20, 50])
def test_a_failsafe_that_climbs_home_and_sinks_fast_for_minutes_is_left_alone(rate_hz: int) -> None:
    c = started()
    for i in range(1, 170 * rate_hz):
        t_s = i / rate_hz
        up_m = min(20.0 + t_s, 50.0, 70.0 - 0.4 * t_s)  # level from 30 s to 50 s
        assert not c.step(replace(RTL, seen_s=t_s, up_m=up_m, speed_m_s=0.4), t_s), t_s
    assert c.phase is ContingencyPhase.SUPERVISE


def test_a_failsafe_that_circles_and_sways_is_made_to_land() -> None:
    c = started()
    for i in range(1, 20 * 62):
        up_m = 20.0 + 0.45 * math.sin(i / 20)
        c.step(replace(RTL, seen_s=i / 20, up_m=up_m, speed_m_s=1.5), i / 20)
    assert c.phase is ContingencyPhase.LAND


def test_a_failsafe_that_hangs_is_overruled_once_and_for_all() -> None:
    c = started()
    hangs = replace(RTL, speed_m_s=0.0)
    sent = [c.step(replace(hangs, seen_s=i / 20), i / 20) for i in range(1, 200)]
    assert not any(sent[:100])
    assert [ContingencyAction.LAND, ContingencyAction.DISARM] in sent
    assert c.phase is ContingencyPhase.LAND


def test_rtl_as_landing_and_land_when_it_is_not_taken() -> None:
    c = at_phase(ContingencyPhase.HOLD, plan=ContingencyPlan(landing=FlightMode.RTL))
    assert c.step(replace(FLYING, mode=FlightMode.HOLD, speed_m_s=0.0), 0.1) == [
        ContingencyAction.RTL
    ]
    holds = replace(FLYING, mode=FlightMode.HOLD)
    assert c.step(holds, 0.6) == [ContingencyAction.RTL]
    assert c.step(holds, 4.2) == [ContingencyAction.LAND]
    c = at_phase(ContingencyPhase.LAND, plan=ContingencyPlan(landing=FlightMode.RTL))
    c.step(replace(FLYING, mode=FlightMode.RTL), 0.3)
    assert c.phase is ContingencyPhase.DESCEND


def test_pause_holds_and_resumes() -> None:
    c = Contingency(ContingencyPlan())
    assert c.pause(FLYING, 0.0) == [ContingencyAction.ZERO, ContingencyAction.HOLD]
    assert c.step(FLYING, 0.1) == [ContingencyAction.ZERO]
    assert c.step(replace(FLYING, mode=FlightMode.HOLD), 60.0) == []
    assert not c.started
    c.resume(61.0)
    assert c.step(FLYING, 61.1) == []
    assert c.pause(replace(FLYING, armed=False), 62.0) == []


def test_a_start_overrides_a_pause_for_good() -> None:
    c = Contingency(ContingencyPlan())
    c.pause(FLYING, 0.0)
    assert ContingencyAction.HOLD in c.start(FLYING, 0.1)
    c.resume(0.2)
    assert c.pause(FLYING, 0.3) == []
    assert c.phase is ContingencyPhase.HOLD
    assert c.start(FLYING, 0.4) == []


modes = st.sampled_from([None, *FlightMode])
facts_strategy = st.builds(
    ContingencyFacts,
    armed=st.sampled_from([True, True, True, None, False]),
    mode=modes,
    landed=st.sampled_from([None, True, False]),
    failsafe=st.booleans(),
    pilot=st.sampled_from([False, False, False, True]),
    up_m=st.one_of(st.none(), st.floats(-1, 60)),
    speed_m_s=st.one_of(st.none(), st.floats(0, 5)),
    seen_s=st.one_of(st.none(), st.floats(0, 30)),
)


@given(st.lists(st.tuples(facts_strategy, st.floats(0.01, 4)), max_size=60), st.booleans())
def test_an_obedient_vehicle_comes_down_from_any_state(
    steps: list[tuple[ContingencyFacts, float]], opted_in: bool
) -> None:
    c = started(ContingencyPlan(terminate=opted_in))
    t_s = 0.0
    for facts, wait_s in steps:
        t_s += wait_s
        sent = c.step(facts, t_s)
        assert c.started
        assert opted_in or ContingencyAction.TERMINATE not in sent
        if c.phase in {ContingencyPhase.PILOT, ContingencyPhase.DOWN}:
            assert sent == []
        elif facts.armed and c.phase is not ContingencyPhase.TERMINATE:
            # However it got here: from here an obedient vehicle is down in no time.
            assert _comes_down(replace_copy(c), t_s)


def replace_copy(c: Contingency) -> Contingency:
    twin = Contingency(c.plan)
    twin.__dict__.update(c.__dict__)
    twin.notes = []
    return twin


def _comes_down(c: Contingency, t_s: float) -> bool:
    """Fly a vehicle that obeys from here on; it hears LAND and ends disarmed."""
    mode, up_m, armed = FlightMode.GUIDED, 2.0, True
    for i in range(1, 20 * 40):
        now_s = t_s + i / 20
        facts = ContingencyFacts(armed, mode, up_m <= 0.0, up_m=up_m, speed_m_s=0.0, seen_s=now_s)
        for action in c.step(facts, now_s):
            if action is ContingencyAction.HOLD:
                mode = FlightMode.HOLD
            elif action in {ContingencyAction.LAND, ContingencyAction.RTL}:
                mode = FlightMode.LAND
            elif action is ContingencyAction.DISARM and up_m <= 0.0:
                armed = False
        if mode is FlightMode.LAND:
            up_m -= 0.025
    return c.down
