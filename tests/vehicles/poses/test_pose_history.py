"""Pose history: interpolates, predicts a little, refuses to bridge gaps."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.worlds.frames import Pose, angle_between, quat_from_euler


def _moving(t_s: float) -> Pose:
    return Pose((t_s, -2.0 * t_s, 0.5 * t_s), quat_from_euler(0.0, 0.0, t_s))


def _filled(*, until_s: float = 1.0, rate_hz: float = 100.0) -> PoseHistory:
    history = PoseHistory(2.0)
    for number in range(round(until_s * rate_hz) + 1):
        t_s = number / rate_hz
        assert history.add(t_s, _moving(t_s), (1.0, -2.0, 0.5))
    return history


@given(st.floats(0.0, 1.0))
def test_interpolates_between_samples(t_s: float) -> None:
    at = _filled().at(t_s)
    assert at.pose is not None
    assert at.kind == "interpolated"
    assert at.gap_s <= 0.01 + 1e-9
    assert at.pose.position_ned_m == pytest.approx(_moving(t_s).position_ned_m, abs=1e-9)
    assert angle_between(at.pose.q_wxyz, _moving(t_s).q_wxyz) < 1e-6


def test_predicts_by_velocity_for_a_short_time_only() -> None:
    history = _filled()
    soon = history.at(1.015)
    assert soon.pose is not None
    assert soon.kind == "predicted"
    assert soon.gap_s == pytest.approx(0.015)
    assert soon.pose.position_ned_m == pytest.approx((1.015, -2.03, 0.5075))
    late = history.at(1.05)
    assert (late.pose, late.kind) == (_moving(1.0), "latest")
    assert late.gap_s == pytest.approx(0.05)


def test_nothing_is_predicted_without_velocity() -> None:
    history = PoseHistory(1.0)
    history.add(0.0, _moving(0.0))
    assert history.at(0.01).kind == "latest"


def test_gaps_are_not_bridged() -> None:
    history = PoseHistory(5.0, max_gap_s=0.1)
    history.add(0.0, _moving(0.0))
    history.add(0.5, _moving(0.5))
    inside = history.at(0.2)
    assert (inside.pose, inside.kind, inside.gap_s) == (None, "none", 0.5)
    assert history.at(0.5).kind == "interpolated"
    assert history.at(0.0).pose == _moving(0.0)


def test_there_is_no_pose_before_all_samples_or_without_any() -> None:
    empty = PoseHistory(1.0).at(3.0)
    assert (empty.pose, empty.kind, empty.gap_s) == (None, "none", math.inf)
    assert PoseHistory(1.0).latest().kind == "none"
    early = _filled().at(-0.25)
    assert (early.pose, early.kind, early.gap_s) == (None, "none", 0.25)


def test_time_running_backwards_is_rejected_and_counted() -> None:
    history = _filled()
    before = len(history)
    for t_s in (0.5, 1.0, math.nan, math.inf):
        assert not history.add(t_s, Pose((9.0, 9.0, 9.0)))
    assert history.rejected == 4
    assert len(history) == before
    assert history.latest().pose == _moving(1.0)


def test_keeps_the_horizon_and_not_more() -> None:
    history = _filled(until_s=60.0)
    assert 200 <= len(history) <= 203
    assert history.at(58.001).kind == "interpolated"
    assert history.at(57.9).kind == "none"


@given(st.lists(st.floats(0.001, 0.3), min_size=1, max_size=80), st.floats(-1.0, 20.0))
def test_never_invents_a_pose(steps_s: list[float], t_s: float) -> None:
    history = PoseHistory(4.0, max_gap_s=0.15)
    now_s, times = 0.0, []
    for step_s in steps_s:
        now_s += step_s
        history.add(now_s, _moving(now_s), (1.0, -2.0, 0.5))
        times.append(now_s)
    at = history.at(t_s)
    if at.kind == "none":
        assert at.pose is None
    elif at.kind == "latest":
        assert at.pose == _moving(times[-1])
        assert at.gap_s > 0.02
    else:
        assert at.pose is not None
        assert at.pose.position_ned_m == pytest.approx(_moving(t_s).position_ned_m, abs=1e-6)
