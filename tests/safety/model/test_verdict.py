import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.verdict import (
    EXCEPTION,
    NEVER_BEGAN,
    DecisiveEvent,
    DecisiveKind,
    decide_verdict,
)

KINDS: tuple[DecisiveKind, ...] = ("ERROR", "INVALID", "FAIL", "ABORTED")


def result(
    name: str, *, passed: bool, required: bool = True, at_s: float | None = None, detail: str = ""
) -> OracleResult:
    return OracleResult(
        name=name,
        vehicle="real",
        required=required,
        verdict="PASS" if passed else "FAIL",
        actual=0.125,
        limit=(None, 0.5),
        unit="m",
        margin=-0.1,
        at_s=at_s,
        detail=detail,
    )


def test_all_passed_is_pass() -> None:
    decision = decide_verdict([], [result("a", passed=True)], end_s=9)
    assert (decision.verdict, decision.reason, decision.also) == ("PASS", "", ())


@pytest.mark.parametrize(("first", "second"), list(itertools.combinations(KINDS, 2)))
def test_order_at_one_instant_and_in_time(first: DecisiveKind, second: DecisiveKind) -> None:
    early, late = DecisiveEvent(3.0, second, "early"), DecisiveEvent(3.0, first, "late")
    assert decide_verdict([early, late], [], end_s=9).verdict == first
    late = DecisiveEvent(3.1, first, "late")
    decision = decide_verdict([late, early], [], end_s=9)
    assert (decision.verdict, decision.reason) == (second, "early")
    assert decision.also == (late,)


def test_a_required_oracle_fails_the_run_at_its_moment() -> None:
    results = [
        result("later", passed=False),
        result("reported", passed=False, required=False, at_s=1.0),
        result("first", passed=False, at_s=4.0, detail="touched gate.left"),
    ]
    decision = decide_verdict([DecisiveEvent(6.0, "ABORTED", "by hand")], results, end_s=9)
    assert decision.verdict == "FAIL"
    assert decision.reason == "first of real failed: touched gate.left"
    assert decision.at_s == 4.0
    assert [(event.t_s, event.kind, event.text) for event in decision.also] == [
        (6.0, "ABORTED", "by hand"),
        (9.0, "FAIL", "later of real failed: 0.125 m against [open, 0.5] m"),
    ]


def test_a_fault_that_never_began_hides_no_failure() -> None:
    never = DecisiveEvent(9.0, "INVALID", "an injected fault never began", NEVER_BEGAN)
    assert decide_verdict([never], [result("a", passed=True)], end_s=9).verdict == "INVALID"
    assert decide_verdict([never], [result("a", passed=False)], end_s=9).verdict == "FAIL"


def test_a_flag_is_not_reported_twice() -> None:
    flag = DecisiveEvent(2.0, "FAIL", "real touched gate.left", "collision/real")
    decision = decide_verdict([flag], [result("collision", passed=False, at_s=3.0)], end_s=9)
    assert (decision.reason, decision.also) == ("real touched gate.left", ())


def test_a_flight_that_was_not_completed_never_passes() -> None:
    decision = decide_verdict([], [result("a", passed=True)], end_s=9, completed=False)
    assert (decision.verdict, decision.reason) == ("ERROR", "the flight was not completed")
    abort = DecisiveEvent(2.0, "ABORTED", "by hand")
    assert decide_verdict([abort], [], end_s=9, completed=False).verdict == "ABORTED"


events = st.builds(
    DecisiveEvent,
    st.one_of(st.integers(0, 3).map(float), st.just(math.nan)),
    st.sampled_from(KINDS),
    st.sampled_from("abc"),
)


@given(st.lists(events, min_size=1, max_size=6), st.randoms(use_true_random=False))
def test_the_order_in_which_events_are_reported_does_not_matter(
    told: list[DecisiveEvent], shuffler: object
) -> None:
    shuffled = list(told)
    getattr(shuffler, "shuffle")(shuffled)  # noqa: B009 - hypothesis's random is untyped
    one, other = decide_verdict(told, [], end_s=9), decide_verdict(shuffled, [], end_s=9)
    assert one.verdict == other.verdict
    assert one.verdict != "PASS"
    assert len(one.also) == len(told) - 1


def test_a_missed_goal_comes_before_the_time_out_that_it_led_to() -> None:
    timeout = DecisiveEvent(
        40.0, "FAIL", "real was not done 40 s after its goal", "time_limit/real"
    )
    missed = OracleResult(
        "reached", "real", True, "FAIL", None, 0.5, "m", None, None, "never flew through second"
    )
    found = decide_verdict([timeout], [missed], end_s=50.0, timeouts={"time_limit/real"})
    assert found.source == "reached/real"
    assert "never flew through second" in found.reason
    assert [event.source for event in found.also] == ["time_limit/real"]
    assert found.at_s == timeout.t_s, "the time was up before the end"
    touched = DecisiveEvent(30.0, "FAIL", "real touched gate.left", "collision/real")
    first = decide_verdict([touched, timeout], [missed], end_s=50.0, timeouts={"time_limit/real"})
    assert first.source == "collision/real"


@pytest.mark.parametrize(
    ("vehicle", "silent_s", "verdict"),
    [("real", 16.1, "ERROR"), ("real", 12.0, "INVALID"), ("twin", 16.1, "INVALID")],
)
def test_signals_of_a_vehicle_that_is_being_lost_are_part_of_its_loss(
    vehicle: str, silent_s: float, verdict: str
) -> None:
    lost = DecisiveEvent(19.0, "ERROR", "nothing received from real for 3 s", "guard.lost/real")
    silent = DecisiveEvent(silent_s, "INVALID", "no sample", f"evidence/pose/{vehicle}")
    decision = decide_verdict([silent, lost], [], end_s=60.0)
    assert decision.verdict == verdict
    assert len(decision.also) == 1


def test_a_reason_says_the_worst_value_and_not_only_the_first() -> None:
    near = DecisiveEvent(2.0, "FAIL", "real came within 0.5998 m of box", "clearance/real")
    worst = {"clearance/real": "at worst 0.213 m", "speed/real": ""}
    decision = decide_verdict([near], (), end_s=9.0, worst=worst)
    assert decision.reason == "real came within 0.5998 m of box; at worst 0.213 m"
    doubt = DecisiveEvent(2.0, "INVALID", "no pose", "clearance/real")
    assert decide_verdict([doubt], (), end_s=9.0, worst=worst).reason == "no pose"


def test_a_value_beside_its_limit_has_the_digits_that_tell_them_apart() -> None:
    result = OracleResult("distance", "real", True, "FAIL", 0.5999, 0.6, "m", -0.0001, 3.0)
    decision = decide_verdict((), [result], end_s=9.0)
    assert decision.reason == "distance of real failed: 0.5999 m against 0.6 m"


def test_an_exception_hides_nothing_that_was_decided_before_it_at_its_time() -> None:
    """Who hears of what decided the run may raise: that is no cause of it."""
    raised = DecisiveEvent(3.0, "ERROR", "a listener raised", EXCEPTION)
    for kind in KINDS:
        decided = DecisiveEvent(3.0, kind, "left the fence", "guard.breach/real")
        for recorded in ([decided, raised], [decided, raised, raised]):
            assert decide_verdict(recorded, [], end_s=9).reason == "left the fence"
        assert decide_verdict([raised, decided], [], end_s=9).reason == "a listener raised"
    later = DecisiveEvent(3.5, "FAIL", "touched", "collision/real")
    assert decide_verdict([later, raised], [], end_s=9).verdict == "ERROR"
