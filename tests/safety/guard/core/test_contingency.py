from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.guard.core.contingency import (
    Action,
    Contingency,
    ContingencyPlan,
    Facts,
    Phase,
)
from wil_campaign.vehicles.autopilots.autopilot import Mode

FLYING = Facts(armed=True, mode=Mode.GUIDED, landed=False, up_m=2.0, speed_m_s=1.0, seen_s=0.0)


def started(plan: ContingencyPlan | None = None, facts: Facts = FLYING) -> Contingency:
    contingency = Contingency(plan or ContingencyPlan())
    contingency.start(facts, 0.0)
    return contingency


def at_phase(phase: Phase, *, plan: ContingencyPlan | None = None) -> Contingency:
    contingency = started(plan)
    contingency.phase = phase
    return contingency


def test_an_obedient_vehicle_goes_through_all_phases_of_the_way_down() -> None:
    c = Contingency(ContingencyPlan())
    assert c.start(FLYING, 0.0) == [Action.ZERO, Action.HOLD]
    assert c.step(FLYING, 0.05) == [Action.ZERO]
    assert c.step(FLYING, 0.5) == [Action.ZERO, Action.HOLD]
    holds = replace(FLYING, mode=Mode.HOLD)
    assert c.step(holds, 0.6) == []
    assert c.step(replace(holds, speed_m_s=0.1), 0.7) == [Action.LAND]
    lands = replace(FLYING, mode=Mode.LAND)
    assert c.step(lands, 0.8) == []
    assert c.phase is Phase.DESCEND
    assert c.step(replace(lands, landed=True, up_m=0.0), 5.0) == [Action.LAND, Action.DISARM]
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
        (Phase.HOLD, {"landed": True}, Phase.DISARM),
        (Phase.HOLD, {"mode": Mode.LAND}, Phase.DESCEND),
        (Phase.HOLD, {"mode": Mode.RTL, "failsafe": True}, Phase.SUPERVISE),
        (Phase.HOLD, {"mode": Mode.RTL}, Phase.HOLD),
        (Phase.HOLD, {"mode": Mode.HOLD, "speed_m_s": 0.1}, Phase.LAND),
        (Phase.HOLD, {"mode": Mode.HOLD}, Phase.HOLD),
        (Phase.HOLD, {"mode": Mode.HOLD, "failsafe": True, "speed_m_s": 0.1}, Phase.LAND),
        (Phase.LAND, {"mode": Mode.LAND}, Phase.DESCEND),
        (Phase.LAND, {"mode": Mode.HOLD}, Phase.LAND),
        (Phase.LAND, {"landed": True}, Phase.DISARM),
        (Phase.LAND, {"mode": Mode.RTL, "failsafe": True}, Phase.SUPERVISE),
        (Phase.DESCEND, {"mode": Mode.LAND}, Phase.DESCEND),
        (Phase.DESCEND, {"mode": Mode.GUIDED}, Phase.LAND),
        (Phase.DESCEND, {"mode": Mode.LAND, "landed": True}, Phase.DISARM),
        (Phase.DESCEND, {"mode": Mode.RTL, "failsafe": True}, Phase.SUPERVISE),
        (Phase.SUPERVISE, {"mode": Mode.RTL, "failsafe": True}, Phase.SUPERVISE),
        (Phase.SUPERVISE, {"mode": Mode.LAND, "failsafe": True}, Phase.DESCEND),
        (Phase.SUPERVISE, {"mode": Mode.GUIDED}, Phase.HOLD),
        (Phase.SUPERVISE, {"mode": Mode.RTL, "landed": True}, Phase.DISARM),
        (Phase.DISARM, {"mode": Mode.LAND, "landed": True}, Phase.DISARM),
        (Phase.DISARM, {"mode": Mode.LAND, "landed": False}, Phase.HOLD),
        (Phase.DOWN, {"armed": True}, Phase.HOLD),
        (Phase.TERMINATE, {"mode": Mode.LAND}, Phase.TERMINATE),
        (Phase.PILOT, {"mode": Mode.GUIDED}, Phase.PILOT),
    ],
)
def test_each_phase_has_its_next_phase(phase: Phase, facts: dict[str, object], to: Phase) -> None:
    c = at_phase(phase)
    c.step(replace(FLYING, **facts), 0.3)  # type: ignore[arg-type] # fields by name
    assert c.phase is to


@pytest.mark.parametrize("phase", [p for p in Phase if p not in {Phase.IDLE, Phase.PAUSE}])
def test_disarmed_is_down_and_a_pilot_ends_all_sending(phase: Phase) -> None:
    c = at_phase(phase)
    assert c.step(replace(FLYING, armed=False), 0.3) == []
    assert c.phase is Phase.DOWN
    c = at_phase(phase)
    piloted = replace(FLYING, pilot=True, mode=Mode.PILOT)
    assert [c.step(piloted, t_s) for t_s in (0.3, 1.0, 60.0)] == [[], [], []]
    assert c.phase is Phase.PILOT


def test_a_hold_that_is_not_seen_does_not_stop_the_landing() -> None:
    c = started()
    assert c.step(FLYING, 1.95) == [Action.ZERO, Action.HOLD]
    assert c.step(FLYING, 2.0) == [Action.ZERO, Action.LAND]
    # and it goes on asking, and streaming, for ever
    assert c.step(FLYING, 600.0) == [Action.ZERO, Action.LAND]


def test_braking_has_its_time_even_when_the_speed_is_not_known() -> None:
    c = started()
    holds = Facts(armed=True, mode=Mode.HOLD, landed=None)
    assert c.step(holds, 0.9) == []
    assert c.step(holds, 1.0) == [Action.LAND]


def sink(
    c: Contingency, facts: Facts, *, since_s: float, seconds: float, rate: float
) -> set[Action]:
    """Step at 20 Hz while the height falls at `rate`; returns all that was sent."""
    sent: set[Action] = set()
    for i in range(round(seconds * 20)):
        t_s = since_s + i / 20
        up_m = 50.0 - rate * i / 20
        sent.update(c.step(replace(facts, up_m=up_m, seen_s=t_s, speed_m_s=rate), t_s))
    return sent


LANDING = replace(FLYING, mode=Mode.LAND)


def test_motors_are_cut_only_after_repeated_stalls() -> None:
    c = at_phase(Phase.DESCEND, plan=ContingencyPlan(terminate=True))
    assert sink(c, LANDING, since_s=1.0, seconds=14.9, rate=0.0) == {Action.LAND, Action.DISARM}
    assert Action.TERMINATE in sink(c, LANDING, since_s=15.9, seconds=1.0, rate=0.0)


def test_no_opt_in_no_termination_and_it_never_gives_up() -> None:
    c = at_phase(Phase.DESCEND)
    sent = sink(c, LANDING, since_s=1.0, seconds=300, rate=0.0)
    assert sent == {Action.LAND, Action.DISARM}


@pytest.mark.parametrize("mode", [Mode.LAND, Mode.GUIDED])
def test_slow_descent_is_progress_however_long_it_takes(mode: Mode) -> None:
    c = at_phase(Phase.DESCEND, plan=ContingencyPlan(terminate=True))
    sent = sink(c, replace(FLYING, mode=mode), since_s=1.0, seconds=900, rate=0.03)
    assert Action.TERMINATE not in sent


@pytest.mark.parametrize(
    "facts",
    [
        replace(LANDING, up_m=None, seen_s=None),
        replace(LANDING, up_m=2.0, seen_s=0.0),
        replace(FLYING, up_m=None, seen_s=None),
    ],
)
def test_time_without_evidence_never_cuts_motors(facts: Facts) -> None:
    c = at_phase(Phase.LAND, plan=ContingencyPlan(terminate=True))
    sent = {action for i in range(20 * 600) for action in c.step(facts, 1.0 + i / 20)}
    assert Action.TERMINATE not in sent


def test_progress_forgives_earlier_stalls() -> None:
    c = at_phase(Phase.DESCEND, plan=ContingencyPlan(terminate=True))
    sink(c, LANDING, since_s=0.0, seconds=12, rate=0.0)
    sink(c, replace(LANDING), since_s=12.0, seconds=4, rate=0.5)
    assert Action.TERMINATE not in sink(c, LANDING, since_s=16.0, seconds=12, rate=0.0)


RTL = replace(FLYING, mode=Mode.RTL, failsafe=True)


def test_a_failsafe_that_moves_is_left_alone() -> None:
    c = started()
    sent = [c.step(replace(RTL, seen_s=i / 20, up_m=2.0 + i / 20), i / 20) for i in range(1, 600)]
    assert not any(sent)
    assert c.phase is Phase.SUPERVISE


def test_a_failsafe_that_flies_on_for_ever_is_made_to_land() -> None:
    c = started()
    sent = [c.step(replace(RTL, seen_s=i / 20), i / 20) for i in range(1, 20 * 62)]
    assert not any(sent[: 20 * 59])
    assert sent[-20 * 2 :].count([Action.LAND]) > 1
    assert c.phase is Phase.LAND


def test_a_failsafe_without_positions_has_its_time_too() -> None:
    c = started()
    blind = replace(RTL, up_m=None, speed_m_s=None, seen_s=None)
    assert not any(c.step(blind, i / 20) for i in range(1, 20 * 59))
    assert c.step(blind, 61.0) == [Action.LAND]


def test_a_failsafe_that_sinks_slowly_is_left_alone() -> None:
    c = started()
    assert not sink(c, RTL, since_s=0.05, seconds=300, rate=0.05)


def test_a_failsafe_that_hangs_is_overruled_once_and_for_all() -> None:
    c = started()
    hangs = replace(RTL, speed_m_s=0.0)
    sent = [c.step(replace(hangs, seen_s=i / 20), i / 20) for i in range(1, 200)]
    assert not any(sent[:100])
    assert [Action.LAND, Action.DISARM] in sent
    assert c.phase is Phase.LAND


def test_rtl_as_landing_and_land_when_it_is_not_taken() -> None:
    c = at_phase(Phase.HOLD, plan=ContingencyPlan(landing=Mode.RTL))
    assert c.step(replace(FLYING, mode=Mode.HOLD, speed_m_s=0.0), 0.1) == [Action.RTL]
    holds = replace(FLYING, mode=Mode.HOLD)
    assert c.step(holds, 0.6) == [Action.RTL]
    assert c.step(holds, 4.2) == [Action.LAND]
    c = at_phase(Phase.LAND, plan=ContingencyPlan(landing=Mode.RTL))
    c.step(replace(FLYING, mode=Mode.RTL), 0.3)
    assert c.phase is Phase.DESCEND


def test_pause_holds_and_resumes() -> None:
    c = Contingency(ContingencyPlan())
    assert c.pause(FLYING, 0.0) == [Action.ZERO, Action.HOLD]
    assert c.step(FLYING, 0.1) == [Action.ZERO]
    assert c.step(replace(FLYING, mode=Mode.HOLD), 60.0) == []
    assert not c.started
    c.resume(61.0)
    assert c.step(FLYING, 61.1) == []
    assert c.pause(replace(FLYING, armed=False), 62.0) == []


def test_a_start_overrides_a_pause_for_good() -> None:
    c = Contingency(ContingencyPlan())
    c.pause(FLYING, 0.0)
    assert Action.HOLD in c.start(FLYING, 0.1)
    c.resume(0.2)
    assert c.pause(FLYING, 0.3) == []
    assert c.phase is Phase.HOLD
    assert c.start(FLYING, 0.4) == []


modes = st.sampled_from([None, *Mode])
facts_strategy = st.builds(
    Facts,
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
    steps: list[tuple[Facts, float]], opted_in: bool
) -> None:
    c = started(ContingencyPlan(terminate=opted_in))
    t_s = 0.0
    for facts, wait_s in steps:
        t_s += wait_s
        sent = c.step(facts, t_s)
        assert c.started
        assert opted_in or Action.TERMINATE not in sent
        if c.phase in {Phase.PILOT, Phase.DOWN}:
            assert sent == []
        elif facts.armed and c.phase is not Phase.TERMINATE:
            # However it got here: from here an obedient vehicle is down in no time.
            assert _comes_down(replace_copy(c), t_s)


def replace_copy(c: Contingency) -> Contingency:
    twin = Contingency(c.plan)
    twin.__dict__.update(c.__dict__)
    twin.notes = []
    return twin


def _comes_down(c: Contingency, t_s: float) -> bool:
    """Fly a vehicle that obeys from here on; it hears LAND and ends disarmed."""
    mode, up_m, armed = Mode.GUIDED, 2.0, True
    for i in range(1, 20 * 40):
        now_s = t_s + i / 20
        facts = Facts(armed, mode, up_m <= 0.0, up_m=up_m, speed_m_s=0.0, seen_s=now_s)
        for action in c.step(facts, now_s):
            if action is Action.HOLD:
                mode = Mode.HOLD
            elif action in {Action.LAND, Action.RTL}:
                mode = Mode.LAND
            elif action is Action.DISARM and up_m <= 0.0:
                armed = False
        if mode is Mode.LAND:
            up_m -= 0.025
    return c.down
