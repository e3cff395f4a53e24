import math
from typing import Any

import pytest

from tests.safety.oracles.oracle_rigs import build, fly, numbers, pose, stage, state
from wil_campaign.safety.fence.geofence import Circle, Fence, Polygon
from wil_campaign.safety.model.samples import FenceSample, LinkSample
from wil_campaign.safety.oracles.limit_oracle import LimitOracle
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext, OracleError, OracleTerms


def test_geofence_worst_margin_and_each_exit() -> None:
    judge = build("geofence")
    stage(judge, takeoff=1.0)
    texts = fly(judge, (0, 0, -1), (3.8, 0, -1), (4.3, 0, -1), (4.4, 0, -1), (0, 0, -1), (0, 0, -3))
    assert texts == ["real left the fence by its north side", "real left the fence by its ceiling"]
    result = judge.result(9.0)
    assert result.verdict == "FAIL"
    assert result.margin == result.actual == pytest.approx(-0.5)
    assert result.at_s == 8.0
    assert judge.worst_text == "at worst 0.50 m outside"


def test_geofence_has_no_floor_near_the_ground() -> None:
    judge = build("geofence")
    stage(judge, takeoff=1.0)
    assert fly(judge, (0, 0, 9)) == []
    stage(judge, at_height=3.0)
    assert fly(judge, (0, 0, 9), start_s=3.0) == ["real left the fence by its floor"]
    stage(judge, land=5.0)
    assert fly(judge, (0, 0, 9), start_s=5.0) == []
    assert judge.result(9.0).at_s == 3.0


def test_geofence_is_left_between_two_poses_inside() -> None:
    fence = Fence(
        inclusions=[Polygon(((-1, -2), (9, -2), (9, 2), (-1, 2)))],
        exclusions=[Circle((2.5, 0.0), 0.2)],
        floor_up_m=0.0,
        ceiling_up_m=3.0,
    )
    judge = build(
        "geofence",
        context=OracleContext(mode="sim", subject="real", vehicle="real", fence=fence),
    )
    stage(judge, takeoff=1.0, at_height=2.0)
    # 5 m/s at 10 Hz: half a metre from pose to pose, across an exclusion of 0.4 m.
    flags = [
        flag
        for count in range(5)
        for flag in judge.on_pose(pose(2.0 + count / 10, (1.75 + count / 2, 0.05, -1)))
    ]
    assert [flag.text for flag in flags] == ["real left the fence by its exclusion"]
    result = judge.result(9.0)
    assert result.verdict == "FAIL"
    assert result.actual == pytest.approx(-0.15, abs=1e-3)
    assert result.at_s == pytest.approx(2.15, abs=0.01)


@pytest.mark.parametrize("back", [False, True])
def test_an_exclusion_near_one_end_of_a_long_way_is_found(back: bool) -> None:
    wall = Polygon(((0.2, -2), (0.21, -2), (0.21, 2), (0.2, 2)))
    fence = Fence(exclusions=[wall], floor_up_m=-50.0, ceiling_up_m=50.0)
    context = OracleContext(mode="sim", subject="real", vehicle="real", fence=fence)
    judge = build("geofence", context=context)
    stage(judge, takeoff=1.0, at_height=2.0)
    ends = ((0.15, 0.0, -1), (6.0, 0.0, -1))
    first, last = reversed(ends) if back else ends
    assert not judge.on_pose(pose(2.0, first))
    (flag,) = judge.on_pose(pose(2.1, last))
    assert flag.text == "real left the fence by its exclusion"


def test_geofence_judges_no_way_that_another_fence_or_no_window_was_over() -> None:
    def across(north_m: float) -> Fence:
        circle = Circle((north_m, 0.0), 0.2)
        return Fence(exclusions=[circle], floor_up_m=0.0, ceiling_up_m=3.0)

    context = OracleContext(mode="sim", subject="real", vehicle="real", fence=across(-5.0))
    judge = build("geofence", context=context)
    stage(judge, at_height=0.5)
    judge.on_pose(pose(0.8, (-6.0, 0.0, -1)))
    stage(judge, takeoff=1.0)
    assert fly(judge, (0, 0, -1)) == []
    judge.on_fence(FenceSample(2.5, "real", across(1.0)))
    assert fly(judge, (2, 0, -1), start_s=3.0) == []
    assert fly(judge, (0, 0, -1), start_s=4.0) == ["real left the fence by its exclusion"]


def test_geofence_needs_a_fence() -> None:
    with pytest.raises(OracleError, match="no geofence"):
        build("geofence", context=OracleContext(mode="sim", subject="twin", vehicle="twin"))


def test_altitude_band() -> None:
    judge = build("altitude", min_m=0.5, max_m=2.0)
    stage(judge, takeoff=1.0)
    assert fly(judge, (0, 0, 0), (0, 0, -1.9)) == []
    stage(judge, at_height=5.0)
    assert fly(judge, (0, 0, -1), (0, 0, -0.4), (0, 0, -0.3), start_s=5.0) == [
        "real is at a height of 0.40 m; the limit is 0.5 m"
    ]
    stage(judge, land=8.0)
    assert fly(judge, (0, 0, 0), start_s=9.0) == []
    result = judge.result(9.0)
    assert (result.verdict, result.limit, result.at_s) == ("FAIL", (0.5, 2.0), 7.0)
    assert result.margin == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ("limits", "up_m", "margin_m"),
    [({"max_m": 2.0}, 2.0, 0.0), ({"min_m": 0.5}, 0.5, 0.0), ({"min_m": 0.0}, 0.5, 0.5)],
)
def test_altitude_exactly_at_its_limit_and_above_zero(
    limits: dict[str, Any], up_m: float, margin_m: float
) -> None:
    judge = build("altitude", **limits)
    stage(judge, takeoff=0.0, at_height=0.5, goal=1.0)
    judge.on_pose(pose(2.0, (0, 0, -up_m)))
    result = judge.result(3.0)
    assert (result.verdict, result.margin) == ("PASS", margin_m)


def test_altitude_with_one_limit() -> None:
    judge = build("altitude", max_m=2.3)
    stage(judge, takeoff=1.0)
    fly(judge, (0, 0, -1.2))
    result = judge.result(9.0)
    assert (result.verdict, result.limit) == ("PASS", 2.3)
    assert result.margin == pytest.approx(1.1)


def test_faults_are_flagged_once_each() -> None:
    judge = build("vehicle_fault")
    judge.on_state(state(0.0, fault="before takeoff"))
    stage(judge, takeoff=1.0)
    judge.on_state(state(2.0))
    assert [f.text for f in judge.on_state(state(3.0, fault="low battery"))] == [
        "real: low battery"
    ]
    assert not judge.on_state(state(4.0, fault="low battery"))
    assert judge.on_state(state(5.0, fault="EKF"))
    result = judge.result(9.0)
    assert (result.verdict, result.at_s, result.detail) == ("FAIL", 3.0, "low battery; EKF")


def ending(down_m: float, **stages: float) -> Oracle:
    """Return the oracle of a vehicle that flies, and is so far down at 3.9 s."""
    judge = build("vehicle_fault")
    stage(judge, takeoff=1.0, at_height=2.0, **stages)
    judge.on_pose(pose(3.9, (0, 0, down_m)))
    judge.on_state(state(3.9))
    return judge


in_its_goal_or_landing = pytest.mark.parametrize(
    "stages", [{}, {"land": 3.0}], ids=["goal", "land"]
)
"""An autonomy may land and disarm the vehicle itself, and end its goal then."""


@in_its_goal_or_landing
@pytest.mark.parametrize("first", ["disarmed", "landed"])
def test_a_landing_vehicle_may_report_in_any_order_that_it_disarmed_and_landed(
    first: str, stages: dict[str, float]
) -> None:
    """HEARTBEAT and EXTENDED_SYS_STATE come in no order."""
    judge = ending(-0.1, **stages)
    assert not judge.on_state(state(4.0, armed=first == "landed", landed=first == "landed"))
    assert judge.result(4.0).verdict == ("FAIL" if first == "disarmed" else "PASS")
    assert not judge.on_state(state(4.2, armed=False, landed=True))
    assert not judge.on_pose(pose(4.4, (0, 0, 0.05)))
    assert not judge.on_tick(9.0)
    assert not judge.on_pose(pose(9.1, (0, 0, 0.4)))
    assert judge.result(9.2).verdict == "PASS"


@in_its_goal_or_landing
@pytest.mark.parametrize("first", ["disarmed", "landed"])
def test_a_vehicle_that_disarms_in_the_air_does_not_pass(
    first: str, stages: dict[str, float]
) -> None:
    """Its autopilot reports the ground of a disarmed vehicle wherever that is."""
    judge = ending(-1.2, **stages)
    assert not judge.on_state(state(4.0, armed=first == "landed", landed=first == "landed"))
    flags = [
        *judge.on_pose(pose(4.25, (0, 0, -0.9))),
        *judge.on_state(state(4.9, armed=False, landed=True)),
    ]
    assert [flag.text for flag in flags] == ["real: disarmed in flight"]
    result = judge.result(9.0)
    assert (result.verdict, result.at_s, result.detail) == ("FAIL", 4.0, "disarmed in flight")


@in_its_goal_or_landing
def test_a_vehicle_that_disarms_and_never_reports_the_ground_fails(
    stages: dict[str, float],
) -> None:
    judge = ending(-1.2, **stages)
    assert not judge.on_state(state(4.0, armed=False))
    assert not judge.on_tick(5.1)
    assert [flag.text for flag in judge.on_tick(5.3)] == ["real: disarmed in flight"]


@in_its_goal_or_landing
def test_a_vehicle_that_is_armed_again_before_it_falls_was_disarmed_in_flight(
    stages: dict[str, float],
) -> None:
    judge = ending(-1.2, **stages)
    assert not judge.on_state(state(4.0, armed=False))
    assert [flag.text for flag in judge.on_state(state(4.1))] == ["real: disarmed in flight"]
    assert not judge.on_pose(pose(4.4, (0, 0, -1.1)))
    assert judge.result(9.0).at_s == 4.0


@in_its_goal_or_landing
def test_a_vehicle_that_is_armed_again_at_once_has_not_landed(stages: dict[str, float]) -> None:
    """Between the two its autopilot reports the ground, wherever that is."""
    judge = ending(-1.2, **stages)
    assert not judge.on_state(state(4.0, armed=False))
    assert not judge.on_state(state(4.05, armed=False, landed=True))
    assert [flag.text for flag in judge.on_state(state(4.1))] == ["real: disarmed in flight"]


@pytest.mark.parametrize(("down_m", "verdict"), [(0.0, "FAIL"), (-1.2, "PASS")])
@pytest.mark.parametrize("fell_s", [4.4, 6.4], ids=["heartbeat-lost", "disarmed-later"])
def test_a_vehicle_that_reports_the_ground_in_the_air_and_is_disarmed_later_falls(
    fell_s: float, down_m: float, verdict: str
) -> None:
    judge = ending(-1.2)
    judge.on_state(state(4.0, landed=True))
    for t_s in (4.2, 4.4, 5.9, 6.2, 6.4, 7.0):
        judge.on_pose(pose(t_s, (0, 0, -1.2 if t_s < fell_s else down_m)))
        judge.on_state(state(t_s, armed=t_s < 6.0, landed=True))
    assert judge.result(9.0).verdict == verdict


def test_a_link_gap_is_flagged_when_it_is_over() -> None:
    judge = build("link", max_gap_s=1.0)
    judge.on_received(LinkSample(0.0, "real"))
    stage(judge, takeoff=5.0)
    for t_s in (5.2, 5.4, 6.4):
        assert not judge.on_received(LinkSample(t_s, "real"))
    flags = judge.on_received(LinkSample(8.4, "real"))
    assert [(f.t_s, f.text) for f in flags] == [(8.4, "real was silent for 2.0 s, more than 1 s")]
    assert not judge.on_received(LinkSample(8.5, "real"))
    result = judge.result(9.0)
    assert result.verdict == "FAIL"
    assert result.actual == pytest.approx(2.0)
    assert result.at_s == 8.4
    assert result.margin == pytest.approx(-1.0)


def test_a_link_gap_that_does_not_end_is_no_flag_but_fails() -> None:
    # Who never comes back is lost: an ERROR of the guard's, which a flag must not forestall.
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_received(LinkSample(0.5, "real"))
    assert not judge.on_tick(30.0)
    assert judge.result(30.0).verdict == "FAIL"


def test_silence_until_the_end_counts() -> None:
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_received(LinkSample(0.5, "real"))
    assert judge.result(1.2).verdict == "PASS"
    assert judge.result(4.0).actual == 3.5


def test_silence_after_landing_does_not_count() -> None:
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_received(LinkSample(0.5, "real"))
    stage(judge, land=0.7, landed=1.0)
    assert numbers(judge.result(60.0)) == ("PASS", 0.5, 1.0, 0.5, 0.5)


@pytest.mark.parametrize(
    ("armed", "landed", "detail"),
    [
        (False, True, ""),
        (True, True, "still armed"),
        (True, False, "still armed and not on the ground"),
        (False, False, "not on the ground"),
        (False, None, "never reported whether it is on the ground"),
    ],
)
def test_the_oracle_landed_fails_while_armed_or_not_on_the_ground(
    armed: bool, landed: bool | None, detail: str
) -> None:
    judge = build("landed")
    judge.on_state(state(1.0))
    judge.on_state(state(2.0, armed=armed, landed=landed))
    result = judge.result(3.0)
    assert (result.verdict, result.detail) == ("FAIL" if detail else "PASS", detail)


def test_a_value_that_is_not_finite_never_reaches_a_result() -> None:
    judge = build("time_limit", limit_s=1)
    result = judge.verdict(passed=True, actual=math.nan, margin=1.0)
    assert (result.verdict, result.actual, result.margin) == ("INVALID", None, None)
    assert "not finite" in result.detail


@pytest.mark.parametrize(
    ("margins", "verdict"),
    [
        ((1.0, math.nan, 2.0), "INVALID"),
        ((math.nan, 1.0), "INVALID"),
        ((1.0, -1.0, math.nan), "FAIL"),
        ((math.nan, -1.0, math.nan), "FAIL"),
    ],
)
def test_a_margin_that_is_not_a_number_is_no_pass(margins: tuple[float, ...], verdict: str) -> None:
    """Each comparison with it is false: after a finite one it was as if it had not been."""
    judge = LimitOracle(OracleTerms(name="own", vehicle="real", required=True), unit="m", limit=1.0)
    for t_s, margin in enumerate(margins):
        judge.judge_margin(t_s, 0.035, margin, lambda: "real left it")
    result = judge.result(9.0)
    assert result.verdict == verdict
    if verdict == "INVALID":
        assert result.detail == "it got a value that is not finite (value 0.035, margin nan)"


def test_asking_for_a_result_changes_none() -> None:
    judge = build("link", max_gap_s=1.0)
    stage(judge, takeoff=0.0)
    judge.on_received(LinkSample(0.5, "real"))
    assert judge.result(0.9).actual == 0.5
    assert judge.result(2.0).actual == 1.5
    # Heard at 0.8, as was learned later: the gap of 1.5 s never was.
    judge.on_received(LinkSample(0.8, "real"))
    assert judge.result(0.8).actual == 0.5
