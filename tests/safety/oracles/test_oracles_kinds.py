"""Distance, area, windows, fail_fast: each made to pass and to fail."""

from typing import Any

import pytest

from tests.safety.oracles.oracle_rigs import ScriptedProbe, build, fly, pose, stage
from wil_campaign.safety.oracles.oracle import Oracle, OracleContext, OracleError

NORTH_1 = (1.0, 0.0, -1.0)


def distance_judge(script: dict[float, list[tuple[str, str, float]]], **limits: float) -> Oracle:
    context = OracleContext(
        mode="wil",
        subject="real",
        vehicle="real",
        things=("person",),
        probe_of={"person": ScriptedProbe(script)}.__getitem__,
    )
    judge = build("distance", context=context, object="person", **limits)
    stage(judge, takeoff=0.0, at_height=1.0)
    return judge


def test_distance_between_limits() -> None:
    near = {float(t): [("person", "", d)] for t, d in ((2, 2.5), (3, 1.5), (4, 5.5), (5, 3.0))}
    judge = distance_judge(near, min_m=2.0, max_m=5.0)
    flags = [flag.text for t in near for flag in judge.on_pose(pose(t))]
    assert flags == ["real was 1.50 m from person; the limit is 2 m"]
    result = judge.result(9.0)
    assert (result.verdict, result.actual, result.limit) == ("FAIL", 1.5, (2.0, 5.0))
    assert (result.margin, result.at_s) == (-0.5, 3.0)


def test_distance_may_have_one_limit() -> None:
    near = {2.0: [("person", "", 0.5)], 3.0: [("person", "", 9.0)]}
    close, far = distance_judge(near, min_m=1.0), distance_judge(near, max_m=8.0)
    for t_s in near:
        close.on_pose(pose(t_s))
        far.on_pose(pose(t_s))
    assert (close.result(4.0).actual, far.result(4.0).actual) == (0.5, 9.0)


def test_the_distance_to_an_unknown_object_is_refused_with_a_suggestion() -> None:
    context = OracleContext(
        mode="wil",
        subject="real",
        vehicle="real",
        things=("person",),
        probe_of=lambda _: ScriptedProbe({}),
    )
    with pytest.raises(OracleError, match="no object 'persom'") as caught:
        build("distance", context=context, object="persom", min_m=1.0)
    assert (caught.value.key, caught.value.suggestion) == ("object", "person")


def test_an_area_of_its_own() -> None:
    keep = {"include": [{"circle": {"north_m": 0, "east_m": 0, "radius_m": 2}}], "up_m": (-1, 3)}
    judge = build("area", keep=keep)
    stage(judge, takeoff=1.0)
    assert fly(judge, (0, 0, -1), (0, 2.5, -1)) == ["real left its area by its east side"]
    assert judge.result(9.0).margin == pytest.approx(-0.5)


# The terms that every oracle has.


def window(first: str, last: str) -> dict[str, Any]:
    return {"from": first, "to": last}


def test_a_window_of_the_campaigns_own() -> None:
    judge = build("altitude", max_m=2.0, **window("goal", "done"))
    stage(judge, takeoff=1.0, at_height=2.0)
    assert fly(judge, (0, 0, -3)) == []
    stage(judge, goal=3.0)
    assert fly(judge, (0, 0, -3), start_s=4.0) == [
        "real is at a height of 3.00 m; the limit is 2 m"
    ]
    stage(judge, done=5.0)
    assert fly(judge, (0, 0, -1), (0, 0, -4), start_s=6.0) == []
    assert judge.result(9.0).actual == 3.0


def test_a_stage_that_is_skipped_closes_the_window_too() -> None:
    judge = build("altitude", max_m=2.0, **window("goal", "done"))
    stage(judge, takeoff=1.0, goal=3.0, land=4.0)
    assert fly(judge, (0, 0, -3), start_s=5.0) == []
    assert judge.result(9.0).detail == "no pose seen"


@pytest.mark.parametrize(
    ("given", "key"),
    [({"from": "land", "to": "goal"}, "to"), ({"from": "land"}, "from"), ({"to": "goal"}, "to")],
)
def test_an_empty_window_is_refused(given: dict[str, Any], key: str) -> None:
    kind = "time_limit"
    with pytest.raises(OracleError, match="its window is empty") as caught:
        build(kind, limit_s=1.0, **given)
    assert caught.value.key == key


def test_time_from_any_stage_to_any_other() -> None:
    judge = build("time_limit", limit_s=5.0, **window("takeoff", "at_height"))
    stage(judge, takeoff=1.0)
    assert judge.on_tick(6.0) == ()
    (flag,) = judge.on_tick(6.1)
    assert (flag.t_s, flag.text) == (6.0, "real was not at height 5 s after the takeoff command")
    stage(judge, land=7.0)
    assert judge.result(8.0).detail == "never at height"


@pytest.mark.parametrize(
    ("kind", "given", "fast"),
    [
        ("altitude", {"max_m": 2.0}, False),
        ("altitude", {"max_m": 2.0, "fail_fast": True}, True),
        ("time_limit", {"limit_s": 2.0}, True),
        ("time_limit", {"limit_s": 2.0, "fail_fast": False}, False),
        ("time_limit", {"limit_s": 2.0, "required": False}, False),
    ],
)
def test_fail_fast_where_the_campaign_says(kind: str, given: dict[str, Any], fast: bool) -> None:
    assert build(kind, **given).terms.fail_fast is fast


def test_an_oracle_known_only_at_the_end_cannot_fail_fast() -> None:
    context = OracleContext(mode="sim", subject="twin", vehicle="twin", target_ned_m=NORTH_1)
    with pytest.raises(OracleError, match="only known at the end") as caught:
        build("reached_position", context=context, tolerance_m=0.1, fail_fast=True)
    assert caught.value.key == "fail_fast"
