"""The cause of a run's verdict as a person would say it; pure."""

import math
from collections.abc import Mapping, Sequence
from itertools import takewhile

from wil_campaign.orchestrator.report.reading.cause import NearestPass
from wil_campaign.orchestrator.report.reading.distances import TimedPose
from wil_campaign.orchestrator.report.words import number_text
from wil_campaign.orchestrator.run_results.run_result import RunResult
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.worlds.figures import distinct_value_text

_STILL_M = 0.3
"""A vehicle that stays within this distance of a place stands still: hover and drift."""
_LONG_S = 5.0
"""A shorter stop is not worth a headline."""
_TARGETS = frozenset({"reached", "reached_position"})
_TOUCHED = "touched "
_BY_FENCE = "guard.fence/"
_WORDS = {"real": "The real vehicle", "twin": "The twin"}


def headline_of(
    result: RunResult,
    oracle: OracleResult | None,
    poses: Sequence[TimedPose],
    *,
    stages: Mapping[str, float],
    at_s: float | None,
    speed_m_s: float | None = None,
    passed: NearestPass | None = None,
) -> str:
    """Return one sentence about what the vehicle did; empty where the reason has to serve.

    A second one says that the autonomy had not begun to fly. oracle: the one that decided. poses:
    of its vehicle, in the order of time. at_s: when it was decided. speed_m_s: of the vehicle then.
    passed: the nearest pass of the target.
    """
    did = _did(result, oracle, poses, stages=stages, at_s=at_s, speed_m_s=speed_m_s, passed=passed)
    return f"{did} The autonomy had not begun to fly." if did and result.before_autonomy else did


def _did(
    result: RunResult,
    oracle: OracleResult | None,
    poses: Sequence[TimedPose],
    *,
    stages: Mapping[str, float],
    at_s: float | None,
    speed_m_s: float | None,
    passed: NearestPass | None,
) -> str:
    """Return what the vehicle of a FAIL did; empty where the reason has to serve."""
    if result.verdict == "FAIL" and result.decided_by.startswith(_BY_FENCE):
        return _landed_by_guard(result, _when(at_s, stages))
    if result.verdict != "FAIL" or oracle is None:
        return ""
    subject = _WORDS.get(oracle.vehicle, oracle.vehicle)
    if oracle.name.startswith("collision"):
        return f"{subject} {oracle.detail}{_when(at_s, stages)}{_at_speed(speed_m_s)}."
    if oracle.name == "clearance" and oracle.actual is not None:
        return f"{subject} {_near(oracle, oracle.actual, _when(at_s, stages))}."
    if oracle.name in _TARGETS:
        return f"{subject} {_missed(oracle, poses, stages, passed)}."
    left = f"{subject} left its fence{_when(at_s, stages)}."
    return left if oracle.name == "geofence" else ""


def _landed_by_guard(result: RunResult, when: str) -> str:
    """Return that the guard landed a vehicle at its fence, and why."""
    vehicle = result.decided_by.removeprefix(_BY_FENCE)
    why = result.bare_reason.partition(";")[0].removeprefix(f"{vehicle} ")
    why = f"could not{why.removeprefix('cannot')}" if why.startswith("cannot ") else why
    subject = _WORDS.get(vehicle, vehicle)
    return f"{subject} was landed by the guard{when}: it {why}."


def _near(oracle: OracleResult, actual_m: float, crossed: str) -> str:
    """Return how near a vehicle came at worst or that it touched, and when it crossed the limit."""
    limit_m = oracle.limit if isinstance(oracle.limit, int | float) else actual_m
    when = f", crossed{crossed}" if crossed else ""
    limit = f"(limit {limit_m:g} m{when})"
    if oracle.detail.startswith(_TOUCHED):
        return f"{oracle.detail} {limit}"
    near_m = distinct_value_text(actual_m, limit_m, digits=3)
    return f"came within {near_m} m of {oracle.detail.removeprefix('closest to ')} {limit}"


def _when(at_s: float | None, stages: Mapping[str, float]) -> str:
    if at_s is None or "goal" not in stages:
        return ""
    since_s = at_s - stages["goal"]
    word = "after" if since_s >= 0.0 else "before"
    return f" {abs(since_s):.1f} s {word} the goal was given"


def _at_speed(speed_m_s: float | None) -> str:
    return "" if speed_m_s is None else f", at {number_text(speed_m_s, 'm/s', 1)}"


def _missed(
    oracle: OracleResult,
    poses: Sequence[TimedPose],
    stages: Mapping[str, float],
    passed: NearestPass | None,
) -> str:
    """Return how a vehicle missed its target: it never moved, it stopped, or it flew past."""
    begin_s, end_s = stages.get("goal", math.inf), stages.get("land", math.inf)
    flown = [pose for pose in poses if begin_s <= pose[0] <= end_s]
    at_first_s, at_last_s = _still_s(flown), _still_s(flown[::-1])
    if flown and at_first_s >= flown[-1][0] - flown[0][0]:
        return f"did not move for {at_first_s:.0f} s after the goal was given"
    beside = _beside(oracle.detail)
    if beside:
        return f"missed: it {beside}"
    if passed is None:
        return "did not reach its goal"
    nearest = f"came no nearer to its goal than {_left(oracle, passed)}"
    is_stopped = at_last_s >= _LONG_S
    return f"stopped for the last {at_last_s:.0f} s, and {nearest}" if is_stopped else nearest


def _left(oracle: OracleResult, passed: NearestPass) -> str:
    """Return how far from its goal a vehicle stayed; of a position with the tolerance."""
    if oracle.name != "reached_position" or not isinstance(oracle.limit, float):
        return number_text(passed.distance_m, "m", 1)
    left_m = passed.distance_m if oracle.actual is None else oracle.actual
    return f"{distinct_value_text(left_m, oracle.limit, digits=1)} m (limit {oracle.limit:g} m)"


def _beside(detail: str) -> str:
    parts = (part.strip() for part in detail.split(";"))
    return next((part for part in parts if part.startswith("passed ")), "")


def _still_s(poses: Sequence[TimedPose]) -> float:
    """Return for how long a vehicle stays at the first of these places; 0 without any."""
    near = list(takewhile(lambda one: _is_near(poses[0], one), poses))
    return abs(near[-1][0] - near[0][0]) if near else 0.0


def _is_near(one: TimedPose, other: TimedPose) -> bool:
    return math.dist(one[1].position_ned_m, other[1].position_ned_m) <= _STILL_M
