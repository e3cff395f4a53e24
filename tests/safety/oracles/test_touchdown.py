"""How fast a vehicle meets the ground, wherever that is and whatever its positions are off by."""

import math
from collections.abc import Callable, Collection

import numpy as np
import pytest

from tests.safety.oracles.oracle_rigs import build, pose, stage, state
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.oracles.oracle import OracleContext

Height = Callable[[float], float]


def landing(
    sink_m_s: float,
    *,
    max_m_s: float | None = 1.0,
    rest_m: float = 0.0,
    off_m: Height = lambda _: 0.0,
    noise_m: float = 0.0,
    rate_hz: float = 50.0,
    lost: Collection[int] = (),
    profile_m_s: float | None = None,
) -> OracleResult:
    """Return the result of a landing from 1 m above the place of rest, which stands for 2 s.

    lost: poses that are missing, counted from the first on the ground.
    """
    context = OracleContext(mode="real", subject="real", vehicle="real", touchdown_m_s=profile_m_s)
    judge = build("touchdown", context=context, max_m_s=max_m_s)
    stage(judge, takeoff=0.0, at_height=1.0, land=2.0)
    down_s = 2.0 + 1.0 / sink_m_s
    noise = np.random.default_rng(1).normal(0.0, noise_m, 1000)
    for index in range(round((down_s + 2.0 - 2.0) * rate_hz)):
        t_s = 2.0 + index / rate_hz
        if index - math.ceil((down_s - 2.0) * rate_hz) in lost:
            continue
        up_m = rest_m + max(0.0, 1.0 - sink_m_s * (t_s - 2.0)) + off_m(t_s) + noise[index]
        judge.on_pose(pose(t_s, (0, 0, -up_m)))
    stage(judge, landed=down_s + 2.0)
    return judge.result(down_s + 3.0)


@pytest.mark.parametrize(("sink_m_s", "verdict"), [(0.7, "PASS"), (1.8, "FAIL")])
@pytest.mark.parametrize("rest_m", [0.0, 0.75, -2.0])
@pytest.mark.parametrize("rate_hz", [10.0, 50.0])
def test_the_sink_rate_is_judged_wherever_the_ground_is(
    sink_m_s: float, verdict: str, rest_m: float, rate_hz: float
) -> None:
    result = landing(sink_m_s, rest_m=rest_m, rate_hz=rate_hz)
    assert (result.verdict, result.limit, result.unit) == (verdict, 1.0, "m/s")
    assert result.actual == pytest.approx(sink_m_s, rel=0.1 if rate_hz > 10 else 0.3)
    assert result.at_s == pytest.approx(2.0 + 1.0 / sink_m_s, abs=0.3)


@pytest.mark.parametrize("sink_m_s", [1.5, 1.6, 1.75, 1.9, 2.0, 3.0])
@pytest.mark.parametrize("lost", [(0,), (-1,), (-1, 0)])
def test_lost_poses_hide_no_hard_landing(sink_m_s: float, lost: tuple[int, ...]) -> None:
    result = landing(sink_m_s, rate_hz=10.0, lost=lost)
    assert result.verdict == "FAIL"
    assert result.actual == pytest.approx(sink_m_s)
    assert landing(0.7, rate_hz=10.0, lost=lost).verdict == "PASS"


@pytest.mark.parametrize("drift_m_s", [-0.05, 0.05])
def test_an_estimate_that_drifts_while_it_stands_hides_no_hard_landing(drift_m_s: float) -> None:
    def off_m(t_s: float) -> float:
        return drift_m_s * t_s

    assert landing(1.8, off_m=off_m).verdict == "FAIL"
    assert landing(0.7, off_m=off_m).verdict == "PASS"


@pytest.mark.parametrize("begin_s", [2.0, 7.02, 11.0, 12.04, 33.3, 1234.56])
def test_a_fall_is_as_fast_whenever_it_begins(begin_s: float) -> None:
    """Times that are no binary fractions round: 11.36 - 11.26 is less than 0.1."""
    judge = build("touchdown", context=OracleContext(mode="real", subject="real", vehicle="real"))
    stage(judge, takeoff=0.0, at_height=1.0, land=begin_s)
    heights_m = [max(0.0, 0.5 - 4.9 * (index / 50) ** 2) for index in range(50)]
    for index, up_m in enumerate(heights_m):
        judge.on_pose(pose(round(begin_s + index / 50, 6), (0, 0, -up_m)))
    stage(judge, landed=begin_s + 1.0)
    fastest_m_s = max((heights_m[i - 5] - heights_m[i]) / 0.1 for i in range(5, 50))
    assert judge.result(begin_s + 1.0).actual == pytest.approx(fastest_m_s)


def test_noise_of_positions_is_no_hard_landing() -> None:
    assert landing(0.7, noise_m=0.005).verdict == "PASS"


def test_without_a_limit_of_campaign_or_profile_it_is_measured() -> None:
    measured = landing(1.8, max_m_s=None)
    assert (measured.verdict, measured.limit, measured.margin) == ("PASS", None, None)
    assert measured.actual == pytest.approx(1.8, rel=0.05)
    by_profile = landing(1.8, max_m_s=None, profile_m_s=1.0)
    assert (by_profile.verdict, by_profile.limit) == ("FAIL", 1.0)
    assert landing(1.8, max_m_s=2.0, profile_m_s=1.0).verdict == "PASS"


def test_a_fast_descent_that_ends_above_the_ground_is_none() -> None:
    """It brakes from 2 m/s at half a metre, and comes down at 0.5 m/s."""

    def off_m(t_s: float) -> float:
        return max(0.0, 1.5 - 1.5 * (t_s - 2.0))

    result = landing(0.5, off_m=off_m)
    assert result.verdict == "PASS"


def test_a_flight_that_has_not_landed_is_not_measured() -> None:
    judge = build("touchdown", max_m_s=1.0)
    stage(judge, takeoff=0.0, at_height=1.0, land=2.0)
    judge.on_pose(pose(2.5))
    result = judge.result(3.0)
    assert (result.verdict, result.actual, result.detail) == ("PASS", None, "not landed")
    assert not math.isnan(result.limit)  # type: ignore[arg-type]  # a number


@pytest.mark.parametrize("sees", [True, False])
def test_a_vehicle_that_flew_to_the_ground_by_itself_has_no_landing_that_was_missed(
    sees: bool,
) -> None:
    judge = build("touchdown", max_m_s=1.0)
    stage(judge, takeoff=0.0, at_height=1.0)
    judge.on_state(state(1.5, landed=False))
    judge.on_state(state(2.0, landed=True))
    if sees:
        judge.on_pose(pose(2.0))
    stage(judge, land=2.1, landed=2.15)
    result = judge.result(2.15)
    if sees:
        told = ("PASS", None, "it stood on the ground before it was to land")
    else:
        told = ("INVALID", None, "no pose seen while it landed")
    assert (result.verdict, result.actual, result.detail) == told


@pytest.mark.parametrize("flown", [True, False])
def test_a_report_from_long_ago_or_from_before_the_takeoff_shows_no_stand(flown: bool) -> None:
    judge = build("touchdown", max_m_s=1.0)
    stage(judge, takeoff=0.0, at_height=1.0)
    if flown:
        judge.on_state(state(1.5, landed=False))
    judge.on_state(state(2.0, landed=True))
    judge.on_pose(pose(2.0))
    land_s = 4.1 if flown else 2.1
    stage(judge, land=land_s, landed=land_s + 0.05)
    result = judge.result(land_s + 0.05)
    assert (result.verdict, result.detail) == ("INVALID", "no pose seen while it landed")
