"""That vehicle and object were near each other, and for how long."""

import pytest

from tests.safety.oracles.oracle_rigs import ScriptedProbe, build, pose, stage
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.oracles.oracle import OracleContext, OracleError


def met(distances_m: dict[float, float], **parameters: float) -> OracleResult:
    """Return the result of an encounter with a person at these distances, by time."""
    script = {t_s: [("person", "", distance_m)] for t_s, distance_m in distances_m.items()}
    context = OracleContext(
        mode="wil",
        subject="real",
        vehicle="real",
        things=("person",),
        probe_of={"person": ScriptedProbe(script)}.__getitem__,
    )
    judge = build("encounter", context=context, object="person", within_m=2.0, **parameters)
    stage(judge, takeoff=0.0, at_height=0.5, goal=1.0)
    for t_s in distances_m:
        if t_s >= 8.0:
            stage(judge, land=8.0)
        judge.on_pose(pose(t_s))
    return judge.result(9.0)


def test_time_counts_where_the_two_were_near_at_both_ends() -> None:
    near = {0.9: 1.0, 2.0: 1.0, 3.0: 2.0, 4.0: 2.1, 5.0: 1.5, 6.0: 1.0, 8.0: 1.0}
    result = met(near, for_s=2.0)
    assert (result.verdict, result.actual, result.limit, result.unit) == ("PASS", 2.0, 2.0, "s")
    short = met(near, for_s=2.5)
    assert (short.verdict, short.margin) == ("FAIL", -0.5)
    assert short.detail == "person was near for 2.00 s; 2.5 s within 2 m are asked for"


def test_a_time_is_not_shorter_by_the_rounding_of_its_parts() -> None:
    result = met({tenth / 10: 1.0 for tenth in range(11, 56)}, for_s=4.4)
    assert (result.verdict, result.actual) == ("PASS", 5.5 - 1.1)


def test_an_object_that_never_came_near_was_not_met() -> None:
    result = met({2.0: 2.0004, 3.0: 9.0})
    assert (result.verdict, result.margin) == ("FAIL", None)
    assert result.detail.startswith("person was never nearer than 2.0004 m; 0 s within 2 m")
    assert met({2.0: 2.0, 3.0: 9.0}).verdict == "PASS"


def test_an_object_that_is_not_there_is_refused() -> None:
    context = OracleContext(mode="wil", subject="real", vehicle="real", things=("person",))
    with pytest.raises(OracleError, match="no object 'persom'"):
        build("encounter", context=context, object="persom", within_m=1.0)
