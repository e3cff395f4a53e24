"""The oracle of STL formulas: its signals, its margin, its window, and failing fast."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.safety.oracles.oracle_rigs import FENCE, SCENE, build, pose, stage
from wil_campaign.plugins.stl.monitor import FormulaRobustness, StlMonitor
from wil_campaign.plugins.stl.stl_oracle import StlOracle
from wil_campaign.plugins.stl.stl_signals import signal_docs, signals_of
from wil_campaign.safety.fence.geofence import Circle, Fence
from wil_campaign.safety.model.oracle_results import Flag, OracleResult
from wil_campaign.safety.model.samples import (
    FenceSample,
    LinkSample,
    PoseSample,
    ReferenceSample,
    StateSample,
)
from wil_campaign.safety.model.verdict import DecisiveEvent, decide_verdict
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext, OracleError
from wil_campaign.safety.oracles.oracle_terms import StageTracker
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.vehicles.embedded.physics.airframe import Airframe
from wil_campaign.vehicles.embedded.physics.contact_world import contact_box_of
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene

BODY = contact_box_of(Airframe())
CONTEXT = OracleContext(
    mode="wil",
    subject="real",
    vehicle="real",
    things=SCENE.names,
    probe_of=lambda name: ClearanceProbe(Scene((SCENE[name],)), BODY, within_m=1e6),
    target_ned_m=(3, 0, -1),
    fence=FENCE,
)


def stl(text: str, *, context: OracleContext = CONTEXT, **parameters: Any) -> Oracle:
    return build("stl", context=context, stl=text, **parameters)


def heights(judge: Oracle, *ups_m: float, start_s: float = 3.0) -> None:
    for i, up_m in enumerate(ups_m):
        judge.on_pose(pose(start_s + i, (0, 0, -up_m)))


def test_robustness_is_the_margin_of_the_comparison_that_decides() -> None:
    judge = stl("always[0,30] (0.5 <= up_m <= 2)")
    heights(judge, 9.0, start_s=0.0)
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    heights(judge, 1.0, 1.75, 0.75)
    result = judge.result(9.0)
    assert (result.verdict, result.margin) == ("PASS", 0.25)
    assert (result.actual, result.limit, result.unit, result.at_s) == (1.75, 2.0, "m", 4.0)
    heights(judge, 0.25, start_s=6.0)
    stage(judge, land=7.0)
    heights(judge, 0.0, start_s=8.0)
    result = judge.result(9.0)
    assert (result.verdict, result.margin) == ("FAIL", -0.25)
    assert (result.actual, result.limit, result.unit, result.at_s) == (0.25, 0.5, "m", 6.0)


def test_the_margin_of_a_fence_follows_the_fence_of_the_own_vehicle_alone() -> None:
    judge = stl("always (fence_margin_m >= 0)")
    judge.on_pose(pose(0.5, (0, 0, -1)))
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    wide = Fence.box(north_m=(-9, 9), east_m=(-9, 9), up_m=(-9, 9))
    judge.on_fence(FenceSample(3.5, "twin", wide))
    judge.on_pose(pose(4.0, (3.75, 0, -1)))
    assert judge.result(9.0).margin == 0.25
    judge.on_fence(
        FenceSample(4.5, "real", Fence.box(north_m=(-1, 3.5), east_m=(-2, 2), up_m=(-0.5, 2.5)))
    )
    judge.on_pose(pose(5.0, (3.375, 0, -1)))
    assert judge.result(9.0).margin == 0.125


def test_the_margin_of_a_fence_is_that_of_the_way_where_it_led_outside() -> None:
    judge = stl("always (fence_margin_m >= 0)")
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    fence = Fence(exclusions=[Circle((2.0, 0.0), 0.25)], floor_up_m=0.0, ceiling_up_m=9.0)
    judge.on_fence(FenceSample(3.0, "real", fence))
    judge.on_pose(pose(3.1, (1.5, 0, -1)))
    judge.on_pose(pose(3.2, (2.5, 0, -1)))
    result = judge.result(9.0)
    assert (result.verdict, result.margin, result.at_s) == ("FAIL", -0.25, 3.2)


def compared(judge: Oracle, source: str, north_m: float, yaw_rad: float = 0.0) -> None:
    """Flies north at 1 m/s, and tells another source's pose of 0.1 s before."""
    judge.on_pose(pose(4.0, (1.0, 0, -1), velocity=(1.0, 0, 0)))
    q = Pose.of(0, 0, 0, yaw_rad=yaw_rad).q_wxyz
    judge.on_reference(ReferenceSample(3.9, "real", source, (north_m, 0, -1), (0.5, 0, 0), q))
    judge.on_reference(ReferenceSample(3.9, "twin", source, (99, 0, -1), (9, 0, 0), q))
    judge.on_pose(pose(4.1, (1.1, 0, -1), velocity=(1.0, 0, 0)))


@pytest.mark.parametrize(
    ("judged_by", "source", "has_value"),
    [
        ("mocap", "mavlink", True),
        ("simulator", "mavlink", True),
        ("mavlink", "truth", True),
        ("mavlink", "simulator", True),
        ("mavlink", "mocap", False),
        ("mocap", "truth", False),
    ],
)
def test_the_error_of_the_estimate(judged_by: str, source: str, has_value: bool) -> None:
    context = replace(CONTEXT, pose_source=judged_by)
    for text, actual in (
        ("eventually (estimate_error_m > 0.3)", 0.4),
        ("eventually (estimate_speed_error_m_s > 0.3)", 0.5),
        ("eventually (estimate_heading_error_deg > 5)", 10.0),
    ):
        judge = stl(text, context=context)
        stage(judge, takeoff=1.0, at_height=2.0, goal=3.9)
        compared(judge, source, 0.5, math.radians(-10.0))
        result = judge.result(9.0)
        assert result.verdict == ("PASS" if has_value else "INVALID")
        if has_value:
            assert result.actual == pytest.approx(actual)


def test_times_count_from_the_stage_that_opens_the_window() -> None:
    judge = stl("eventually[0,2] (up_m >= 1)")
    heights(judge, 0.0, start_s=2.5)
    stage(judge, takeoff=1.0, goal=3.0)
    heights(judge, 0.0, 0.5, start_s=4.5)
    assert judge.result(5.0).margin == -1.0
    heights(judge, 2.0, start_s=5.1)
    assert judge.result(9.0).verdict == "FAIL"


@pytest.mark.parametrize(("text", "verdict"), [("up_m >= 1", "PASS"), ("up_m > 1", "FAIL")])
def test_a_strict_comparison_fails_exactly_at_the_limit(text: str, verdict: str) -> None:
    judge = stl(f"always ({text})")
    stage(judge, goal=3.0)
    heights(judge, 1.0)
    assert judge.result(9.0).verdict == verdict
    other = stl(f"not eventually (not ({text}))")
    stage(other, goal=3.0)
    heights(other, 1.0)
    assert other.result(9.0).verdict == verdict


def test_the_margin_of_a_formula_that_fails_at_the_very_limit_is_zero() -> None:
    # By the minimum alone `up_m >= 1` decides, which holds; `up_m > 2` fails by more.
    judge = stl("always (up_m >= 1 and (up_m > 2 or up_m < 1))")
    stage(judge, goal=3.0)
    heights(judge, 1.0)
    result = judge.result(9.0)
    assert (result.verdict, result.margin, result.limit) == ("FAIL", 0.0, 1.0)
    assert result.detail == "up_m < 1 is violated: 1.000 m against 1 m"


def test_contact_is_no_clearance() -> None:
    judge = stl("always (clearance_m > 0)")
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    judge.on_pose(pose(3.0, (0, 0, -1)))
    assert judge.result(9.0).verdict == "PASS"
    # Between two poses it flies through the gate's bar: the way counts, not its ends.
    judge.on_pose(pose(3.1, (2.5, -0.55, -1)))
    judge.on_pose(pose(3.2, (3.5, -0.55, -1)))
    result = judge.result(9.0)
    assert (result.verdict, result.actual, result.margin) == ("FAIL", 0.0, 0.0)


def test_floors_count_in_the_air_only() -> None:
    from wil_campaign.worlds.scene.scene import SceneObject
    from wil_campaign.worlds.scene.shapes import room_shape

    hall = Scene((SceneObject(1, "hall", room_shape(6.0, 6.0, 3.0), Pose((0, 0, 0))),))
    context = OracleContext(
        mode="sim",
        subject="real",
        vehicle="real",
        things=hall.names,
        probe_of=lambda _: ClearanceProbe(hall, BODY, within_m=1e6),
    )
    judge = stl("always (clearance_m >= 0.5)", context=context, **{"from": "takeoff"})
    stage(judge, takeoff=1.0)
    judge.on_pose(pose(1.5, (0, 0, -0.2)))
    assert judge.result(2.0).verdict == "PASS"
    stage(judge, at_height=2.0)
    judge.on_pose(pose(2.5, (0, 0, -0.3)))
    assert judge.result(3.0).verdict == "FAIL"


def values(name: str, *samples: object) -> list[float]:
    """Return the value of a signal after each sample."""
    unit = signals_of(CONTEXT, StageTracker())[name].kind.unit
    text = f"always ({name} >= -1e9)" if unit else f"eventually ({name})"
    window: dict[str, Any] = {"from": "takeoff", "to": "end"}
    judge = stl(text, **window)
    stage(judge, takeoff=0.0, at_height=0.0)
    found = []
    for sample in samples:
        match sample:
            case PoseSample():
                judge.on_pose(sample)
            case StateSample():
                judge.on_state(sample)
            case LinkSample():
                judge.on_received(sample)
        assert isinstance(judge, StlOracle)
        found += judge._trace.values()[name].tolist()[-1:]
    return [value for value in found if not math.isnan(value)]


def test_signals_have_the_values_of_the_pose() -> None:
    leaning = PoseSample(1.0, "real", Pose((1, 2, -3), (0.5**0.5, 0.5**0.5, 0, 0)), (3, 4, -12))
    expected = {
        "north_m": 1, "east_m": 2, "up_m": 3, "speed_m_s": 13, "ground_speed_m_s": 5,
        "climb_m_s": 12, "roll_deg": 90, "pitch_deg": 0, "yaw_deg": 0, "tilt_deg": 90,
        "goal_distance_m": 12**0.5, "fence_margin_m": -0.5,
    }  # fmt: skip
    for name, value in expected.items():
        assert values(name, leaning) == [pytest.approx(value)], name
    (gate_m,) = values("distance_gate_m", leaning)
    assert values("clearance_m", leaning) == [gate_m]
    assert 1.5 < gate_m < 3.0


def test_signals_have_the_values_that_the_vehicle_reports() -> None:
    unknown = StateSample(1.0, "real", True, FlightMode.GUIDED)
    known = StateSample(2.0, "real", False, FlightMode.HOLD, "", True, "x", 0.25, 11.5, "no height")
    other = StateSample(3.0, "twin", True, FlightMode.GUIDED, "", False, None, 1.0, 12.0)
    assert values("battery_percent", unknown, known, other) == [25.0, 25.0]
    assert values("battery_v", unknown, known) == [11.5]
    assert values("armed", unknown, known, other) == [1.0, 0.0, 0.0]
    assert values("on_ground", unknown, known) == [1.0]
    assert values("estimator_sound", unknown, known) == [1.0, 0.0]
    assert values("mode_hold", unknown, known) == [0.0, 1.0]


def test_the_distance_to_the_twin_needs_both() -> None:
    twin = PoseSample(1.0, "twin", Pose((0, 0, -1)), (2, 0, 0))
    assert values("twin_distance_m", pose(0.5), twin, pose(2.0, (0, 0, -1))) == [2.0]
    assert stl("always (twin_distance_m < 1)").watches == ("real", "twin")
    assert stl("always (up_m < 1)").watches == ("real",)


def test_silence_grows_until_it_is_received() -> None:
    assert values("silence_s", pose(1.0), LinkSample(1.5, "real"), pose(2.0), pose(3.5)) == [
        1.0,
        1.0,
        0.5,
        2.0,
    ]


def test_every_signal_is_documented_and_every_documented_one_is_there() -> None:
    docs = set(signal_docs())
    found = set(signals_of(CONTEXT, StageTracker()))
    assert {name for name in found if not name.startswith("distance_")} == docs - {
        "distance_<thing>_m"
    }
    assert {"distance_gate_m", "distance_ring_m"} <= found


@pytest.mark.parametrize(
    ("name", "context"),
    [
        ("clearance_m", OracleContext(mode="sim", subject="real", vehicle="real")),
        ("fence_margin_m", OracleContext(mode="sim", subject="real", vehicle="real")),
        ("goal_distance_m", OracleContext(mode="sim", subject="real", vehicle="real")),
        ("twin_distance_m", OracleContext(mode="real", subject="real", vehicle="real")),
    ],
)
def test_a_signal_that_this_campaign_has_not_is_refused(name: str, context: OracleContext) -> None:
    with pytest.raises(OracleError, match=f"unknown signal '{name}'") as caught:
        stl(f"always ({name} > 1)", context=context)
    assert (caught.value.key, caught.value.offset) == ("stl", 8)


def test_a_signal_that_was_never_received_cannot_be_judged() -> None:
    judge = stl("always (battery_v > 10 and up_m > 0)")
    stage(judge, goal=1.0)
    heights(judge, 1.0, start_s=1.0)
    result = judge.result(9.0)
    assert (result.verdict, result.at_s) == ("INVALID", 1.0)
    assert result.detail == "battery_v has no value at 1.000 s"
    decision = decide_verdict((), (result,), end_s=9.0)
    assert decision.verdict == "INVALID"
    assert decision.reason == f"stl of real cannot be judged: {result.detail}"


def test_a_charge_that_is_unknown_after_it_was_known_cannot_be_judged() -> None:
    """The formula went on with the last value that was known, and was satisfied."""
    judge = stl("always[0, 5] (battery_percent > 20)")
    stage(judge, goal=0.0)
    judge.on_state(StateSample(0.0, "real", True, FlightMode.GUIDED, battery_fraction=0.9))
    assert judge.result(6.0).verdict == "PASS"
    judge.on_state(StateSample(3.0, "real", True, FlightMode.GUIDED))
    result = judge.result(6.0)
    assert (result.verdict, result.at_s) == ("INVALID", 3.0)
    assert result.detail == "battery_percent has no value at 3.000 s"


def test_a_signal_that_begins_late_hides_no_earlier_violation() -> None:
    """Ten seconds at 9 m were dropped, because the battery was first received after them."""
    judge = stl("always (up_m <= 2 and battery_v > 10)")
    stage(judge, goal=0.0)
    heights(judge, *[9.0] * 10, start_s=0.0)
    judge.on_state(StateSample(10.0, "real", True, FlightMode.GUIDED, battery_v=12.0))
    heights(judge, 1.0, start_s=10.5)
    assert judge.result(12.0).verdict == "INVALID"
    in_time = stl("always (up_m <= 2 and battery_v > 10)")
    in_time.on_state(StateSample(-1.0, "real", True, FlightMode.GUIDED, battery_v=12.0))
    stage(in_time, goal=0.0)
    heights(in_time, *[9.0] * 10, 1.0, start_s=0.0)
    assert in_time.result(12.0).verdict == "FAIL"


@pytest.mark.parametrize(("first_s", "verdict"), [(3.5, "PASS"), (3.6, "INVALID")])
def test_a_first_value_counts_from_the_opening_on_if_it_is_not_late(
    first_s: float, verdict: str
) -> None:
    judge = stl("always (up_m <= 2)")
    stage(judge, goal=3.0)
    heights(judge, 1.0, start_s=first_s)
    assert judge.result(9.0).verdict == verdict


@pytest.mark.parametrize(
    ("text", "detail"),
    [
        ("always[0,90] (up_m <= 2)", ""),
        ("eventually[0,90] (up_m <= 2)", ""),
        ("always[6,6] (up_m <= 2)", ""),
        ("always[8,9] (once[0,5] (up_m <= 2))", ""),
        ("always[60,90] (up_m <= 2)", "up_m <= 2 is needed from 63.000 s"),
        ("up_m > 0 and not eventually[6.1,7] (not up_m <= 2)", "up_m <= 2 is needed from 9.100 s"),
        ("always[3,4] (eventually[4,9] (up_m > 0))", "up_m > 0 is needed from 10.000 s"),
        ("always[20,30] (once[0,5] (up_m <= 2))", "up_m <= 2 is needed from 18.000 s"),
        ("(up_m > 0) until[60,90] (up_m <= 2)", "up_m <= 2 is needed from 63.000 s"),
    ],
)
def test_a_formula_that_needs_samples_after_its_window_cannot_be_judged(
    text: str, detail: str
) -> None:
    judge = stl(text)
    stage(judge, goal=3.0)
    heights(judge, *[1.0] * 6)
    stage(judge, land=9.0)
    result = judge.result(12.0)
    assert result.verdict == ("INVALID" if detail else "PASS")
    whole = f"{detail} on, and its window ended at 9.000 s"
    assert result.detail == (whole if detail else "")


def test_a_window_that_never_opens_cannot_be_judged() -> None:
    judge = stl("always (up_m <= 2)")
    heights(judge, 1.0)
    result = judge.result(9.0)
    assert (result.verdict, result.at_s) == ("INVALID", None)
    assert result.detail == "the formula was not evaluated: its window never began"


@pytest.mark.parametrize("formula", ["{} >= 0", "not ({} >= 0)", "{} < 0"])
def test_a_division_by_zero_cannot_be_judged(formula: str) -> None:
    judge = stl(f"always ({formula.format('(up_m - up_m) / (up_m - up_m)')})")
    stage(judge, goal=3.0)
    heights(judge, 1.0)
    result = judge.result(9.0)
    assert (result.verdict, result.margin, result.at_s) == ("INVALID", None, 3.0)
    assert result.detail.endswith("is not finite at 3.000 s")


def fly(judge: Oracle, *rows: tuple[float, float]) -> OracleResult:
    """Feed a height and a speed a second from the goal on."""
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    for i, (up_m, speed_m_s) in enumerate(rows):
        judge.on_pose(PoseSample(3.0 + i, "real", Pose((0, 0, -up_m)), (speed_m_s, 0, 0)))
    return judge.result(9.0)


def test_a_reason_names_the_part_that_was_violated_in_its_unit() -> None:
    """The speed rule is violated; the height that makes it apply is not what went wrong."""
    judge = stl("always (up_m < 0.5 implies speed_m_s <= 1.2)")
    result = fly(judge, (2.0, 3.0), (0.45, 2.0), (0.4, 1.0))
    assert result.detail == "speed_m_s <= 1.2 is violated: 2.000 m/s against 1.2 m/s"
    assert (result.actual, result.limit, result.unit, result.at_s) == (2.0, 1.2, "m/s", 4.0)
    assert result.margin == pytest.approx(-0.8)
    reason = decide_verdict((), (result,), end_s=9.0).reason
    assert reason == f"stl of real failed: {result.detail}"


@pytest.mark.parametrize(
    ("text", "rows", "detail"),
    [
        ("up_m < 0.5 implies speed_m_s <= 1.2", [(0.5, 3.0), (0.6, 3.0)], "column 20"),
        ("up_m <= 0.5 implies speed_m_s <= 1.2", [(0.5, 1.0), (0.6, 3.0)], ""),
        ("armed implies up_m > 9 -> up_m > 1", [(2.0, 0.0)], "column 32"),
        ("(up_m > 9 -> armed) and (up_m > 8 -> armed)", [(2.0, 0)], "column 19 and column 43"),
        ("up_m > 1", [(2.0, 0.0)], ""),
    ],
)
def test_a_pass_says_which_premise_never_held(
    text: str, rows: list[tuple[float, float]], detail: str
) -> None:
    """It holds whatever the vehicle does, and shows nothing of what follows the premise."""
    judge = stl(f"always ({text})")
    judge.on_state(StateSample(2.0, "real", True, FlightMode.GUIDED))
    result = fly(judge, *rows)
    wanted = f"the premise of the implication at {detail} never held" if detail else ""
    assert (result.verdict, result.detail) == ("PASS", wanted)


@pytest.mark.parametrize(
    ("text", "detail"),
    [
        ("always not (up_m > 1)", "up_m <= 1 is violated: 2.000 m against 1 m"),
        (
            "always (abs(up_m - 3) <= 0.5)",
            "abs(up_m - 3) <= 0.5 is violated: 1.000 m against 0.5 m",
        ),
        ("always (2 * up_m <= north_m)", "2 * up_m <= north_m is violated: 4.000 m against 0 m"),
        ("always (1 >= up_m)", "1 >= up_m is violated: 2.000 m against 1 m"),
        ("eventually (up_m >= 5)", "up_m >= 5 is violated: 2.000 m against 5 m"),
    ],
)
def test_a_reason_writes_the_part_as_the_formula_does(text: str, detail: str) -> None:
    assert fly(stl(text), (2.0, 0.0)).detail == detail


def test_the_margin_is_never_one_of_another_unit() -> None:
    """A tenth of a metre is less than the metre per second; as shares of the limits it is not."""
    judge = stl("always (up_m >= 0.1 and speed_m_s <= 5)")
    result = fly(judge, (0.2, 4.0))
    assert (result.verdict, result.margin, result.unit) == ("PASS", 1.0, "m/s")


def test_a_signal_that_is_true_or_false_has_no_margin() -> None:
    judge = stl("always (armed and up_m <= 2)")
    judge.on_state(StateSample(2.0, "real", True, FlightMode.GUIDED))
    assert fly(judge, (0.25, 0.0)).margin == 1.75
    judge.on_state(StateSample(5.0, "real", False, FlightMode.GUIDED))
    result = judge.result(9.0)
    assert (result.verdict, result.margin, result.at_s) == ("FAIL", None, 5.0)
    assert result.detail == "armed is violated"


def test_the_best_that_is_still_possible_is_shown_in_flight() -> None:
    judge = stl("always[0,30] (up_m >= 0.5)")
    assert (judge.so_far(1.0).verdict, judge.so_far(1.0).detail) == (
        "INVALID",
        "its window has not begun",
    )
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    heights(judge, 1.0, 0.75, 2.0)
    result = judge.so_far(5.0)
    assert (result.verdict, result.margin, result.limit, result.unit) == ("PASS", 0.25, 0.5, "m")
    heights(judge, 0.25, 9.0, start_s=6.0)
    # It is looked at once a second, and at each stage.
    assert [judge.so_far(t_s).margin for t_s in (5.9, 6.0)] == [0.25, -0.25]
    assert judge.so_far(6.0).detail == "up_m >= 0.5 is violated: 0.250 m against 0.5 m"
    heights(judge, 0.125, start_s=6.5)
    stage(judge, land=6.6)
    assert judge.so_far(6.6).margin == judge.result(6.6).margin == -0.375


def test_what_is_still_open_is_shown_as_no_failure_until_it_is_certain() -> None:
    judge = stl("eventually[0,5] (up_m >= 2)")
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    heights(judge, 1.0, 1.5)
    result = judge.so_far(4.0)
    assert (result.verdict, result.margin, result.detail) == ("PASS", None, "decided at the end")
    # No sample after the end of the interval has come yet: one of before may still come.
    assert judge.so_far(8.5).verdict == "PASS"
    heights(judge, 1.0, 1.0, start_s=8.5)
    result = judge.so_far(9.6)
    assert (result.verdict, result.margin) == ("FAIL", -0.5)


def test_it_fails_fast_once_it_can_hold_no_more() -> None:
    judge = stl("always[0,10] (up_m >= 1 -> eventually[0,2] (up_m >= 3))", fail_fast=True)
    stage(judge, goal=3.0)
    flags: list[Flag] = []
    for tenth in range(80):
        t_s = 3.0 + tenth / 10.0
        judge.on_pose(pose(t_s, (0, 0, -1.5)))
        flags += judge.on_tick(t_s)
    (flag,) = flags
    assert 5.0 <= flag.t_s <= 6.0
    assert flag.decisive
    assert flag.text == (
        "real: stl cannot be satisfied any more: up_m >= 3 is violated: 1.500 m against 3 m"
    )


def test_a_pose_that_comes_late_may_satisfy_a_formula_in_time() -> None:
    judge = stl("eventually[0,2] (up_m >= 3)", fail_fast=True)
    stage(judge, goal=3.0)
    heights(judge, 1.0, 2.9)
    # The pose of 4.9 s is on its way when the two seconds are over.
    assert judge.on_tick(5.3) == ()
    heights(judge, 3.1, start_s=4.9)
    heights(judge, 1.0, start_s=5.4)
    assert judge.on_tick(6.4) == ()
    assert judge.result(9.0).verdict == "PASS"


def test_contact_fails_fast_although_its_margin_is_zero() -> None:
    judge = stl("always (clearance_m > 0)", fail_fast=True)
    stage(judge, takeoff=1.0, at_height=2.0, goal=3.0)
    for t_s, north_m in ((3.0, 0.0), (3.1, 2.5), (3.2, 3.5), (3.3, 3.5)):
        judge.on_pose(pose(t_s, (north_m, -0.55, -1)))
    (flag,) = judge.on_tick(4.0)
    assert flag.text == (
        "real: stl cannot be satisfied any more: clearance_m > 0 is violated: 0.000 m against 0 m"
    )


def _rows_of_looks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list to which each look in flight adds how many rows it looks at."""
    rows: list[int] = []
    at_best = StlMonitor.at_best

    def counted(monitor: StlMonitor, times_s: Any, *rest: Any) -> Any:
        rows.append(len(times_s))
        return at_best(monitor, times_s, *rest)

    monkeypatch.setattr(StlMonitor, "at_best", counted)
    return rows


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize(
    ("text", "most"),
    [
        ("always (up_m >= 0)", 25),
        ("always (up_m >= 1 -> eventually[0,2] (up_m >= 0))", 45),
        ("always ((up_m >= 0) until[1,3] (up_m >= 0.5) and not always[0,5] (up_m < 0))", 75),
        ("always (once[0,4] (up_m >= 0))", 65),
        ("always[3,60] (up_m >= 0) and always (up_m <= 3)", 625),
    ],
)
def test_a_look_in_flight_costs_no_more_after_many_minutes(
    monkeypatch: pytest.MonkeyPatch, text: str, most: int, watched: bool
) -> None:
    """After an hour at 50 Hz one took a quarter of a second, each second, of the loop's time."""
    judge, rows = stl(text, fail_fast=not watched), _rows_of_looks(monkeypatch)
    stage(judge, goal=0.0)
    for tenth in range(6000):
        judge.on_pose(pose(tenth / 10.0, (0, 0, -2)))
        assert judge.on_tick(tenth / 10.0) == ()
        if watched:
            assert judge.so_far(tenth / 10.0).verdict == "PASS"
    assert max(rows) <= most
    assert len(rows) > 500
    assert judge.result(600.0).verdict == "PASS"


def test_looks_at_a_formula_that_stays_undecided_become_rarer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each looks at the whole flight: after three hours one took two seconds, each second."""
    judge, rows = stl("(up_m >= 0) until (up_m >= 9)"), _rows_of_looks(monkeypatch)
    stage(judge, goal=0.0)
    for tenth in range(6000):
        judge.on_pose(pose(tenth / 10.0, (0, 0, -2)))
        assert judge.so_far(tenth / 10.0).verdict == "PASS"
    assert rows[:3] == [1, 11, 21]
    assert 200 < len(rows) < 300


def test_a_formula_whose_window_is_over_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[float] = []
    robustness = StlMonitor.robustness

    def counted(monitor: StlMonitor, times_s: Any, signals: Any, end_s: float) -> Any:
        looks.append(end_s)
        return robustness(monitor, times_s, signals, end_s)

    monkeypatch.setattr(StlMonitor, "robustness", counted)
    judge = stl("always (up_m >= 0)")
    stage(judge, goal=0.0)
    judge.on_pose(pose(0.5, (0, 0, -2)))
    stage(judge, land=1.0)
    assert {judge.so_far(1.0 + second).margin for second in range(60)} == {2.0}
    assert looks == [1.0]
    judge.on_pose(pose(0.9, (0, 0, -1)))
    assert judge.so_far(62.0).margin == 1.0


@pytest.mark.parametrize(
    "text",
    [
        "always (up_m >= 0.2)",
        "always (up_m > 0.2) and always (up_m <= 1.99)",
        "always (up_m >= 1 -> eventually[0,2] (up_m >= 1.2))",
        "always ((up_m >= 0.3) until[1,3] (up_m >= 1.1))",
        "always (once[0,4] (up_m >= 1.2))",
        "always (up_m >= 1 -> historically[1,2] (up_m >= 0.5) or once[1,3] (speed_m_s <= 0.1))",
        "always[0,30] (up_m >= 0.4)",
        "always eventually (up_m >= 1.9) and always (up_m >= 0.4)",
        "(up_m >= 0.3) until (up_m >= 1.99)",
    ],
)
def test_a_look_in_flight_at_a_part_is_one_at_all(text: str) -> None:
    """What is settled is not looked at again; flags and margins are those of all rows."""
    rng, failed = np.random.default_rng(1), 0
    for _ in range(10):
        judge, watched = stl(text, fail_fast=True), stl(text)
        assert isinstance(judge, StlOracle)
        judges = [judge, watched]
        for one in judges:
            stage(one, goal=0.0)
        flags: list[Flag] = []
        for fifth in range(250):
            t_s, up_m = fifth / 5.0, float(rng.uniform(0.0, 2.0)) ** 0.3
            velocity = (float(rng.uniform(0.0, 1.0)), 0.0, 0.0)
            for one in judges:
                one.on_pose(pose(t_s, (0, 0, -up_m), velocity))
            flags += judge.on_tick(t_s)
            if fifth % 5 == 0:
                times_s, values = judge._trace.times_s, judge._trace.values()
                whole = judge._monitor.at_best(times_s, values, times_s[-1] + 1e-9)
                assert isinstance(whole, FormulaRobustness)
                assert bool(flags) == (not whole.holds)
                so_far = watched.so_far(t_s)
                assert so_far.verdict == ("PASS" if whole.holds else "FAIL")
                if so_far.margin is not None and "->" not in text:
                    assert so_far.margin == whole.value
        failed += bool(flags)
    assert failed


def test_a_signal_that_stays_unknown_is_not_looked_for_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    judge, rows = stl("always (speed_m_s <= 9)"), _rows_of_looks(monkeypatch)
    stage(judge, goal=0.0)
    for tenth in range(6000):
        speed_m_s = math.nan if tenth == 50 else 1.0
        judge.on_pose(pose(tenth / 10.0, (0, 0, -2), (speed_m_s, 0, 0)))
        seen = judge.so_far(tenth / 10.0).verdict
        assert seen == ("INVALID" if tenth >= 50 else "PASS")
    assert len(rows) < 12


def test_it_does_not_fail_fast_where_the_campaign_does_not_say() -> None:
    judge = stl("always (up_m >= 1)")
    stage(judge, goal=3.0)
    heights(judge, 0.0)
    assert judge.on_tick(5.0) == ()


def test_times_that_go_back_or_stand_still_are_borne() -> None:
    judge = stl("always (up_m >= 1)")
    stage(judge, goal=3.0)
    for t_s, up_m in ((3.0, 2.0), (4.0, 2.0), (4.0, 3.0), (3.9, 1.5), (5.0, math.pi)):
        judge.on_pose(pose(t_s, (0, 0, -up_m)))
    assert judge.result(9.0).margin == 0.5


def test_a_violation_among_samples_that_arrive_late_is_seen() -> None:
    """Poses come over a link, stamped when they were measured; a state has the time of arrival."""
    judge = stl("always (up_m >= 1)")
    stage(judge, goal=3.0)
    heights(judge, 2.0)
    judge.on_state(StateSample(3.1, "real", True, FlightMode.GUIDED))
    for t_s, up_m in ((3.04, 2.0), (3.06, 0.5), (3.08, 2.0)):
        judge.on_pose(pose(t_s, (0, 0, -up_m)))
    result = judge.result(9.0)
    assert (result.verdict, result.margin) == ("FAIL", -0.5)


@pytest.mark.parametrize(
    ("text", "at_s"),
    [
        ("eventually (up_m >= 5)", None),
        ("eventually[0,1.5] (up_m >= 5)", 5.0),
        ("always (up_m <= 2.5)", 4.0),
        ("eventually (up_m >= 2 and eventually (up_m <= 1))", None),
    ],
)
def test_a_failure_has_the_time_at_which_it_became_one(text: str, at_s: float | None) -> None:
    """Rows at 3, 4, 5 and 6 s; the worst is none of these times."""
    result = fly(stl(text), (2.0, 0.0), (3.0, 0.0), (4.0, 0.0), (4.5, 0.0))
    assert (result.verdict, result.at_s) == ("FAIL", at_s)


def test_a_signal_that_ends_comes_before_a_failure_known_only_at_the_end() -> None:
    """Else positions that stop would be blamed on what they did not show."""
    result = fly(stl("eventually (up_m >= 5)"), (2.0, 0.0), (3.0, 0.0))
    silent = DecisiveEvent(8.0, "INVALID", "no sample since 4 s", "evidence/pose/real")
    assert decide_verdict((silent,), (result,), end_s=9.0).verdict == "INVALID"
