"""Speeds, attitudes, batteries, estimators, modes, and the distance of the pair."""

import math

import pytest

from tests.safety.oracles.oracle_rigs import build, numbers, pose, stage
from wil_campaign.safety.model.samples import PoseSample, StageSample, StateSample
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Vec3, quat_from_euler


def moving(t_s: float, *velocity: float) -> PoseSample:
    return pose(t_s, velocity=(velocity[0], velocity[1], velocity[2]))


def leaning(t_s: float, roll_deg: float = 0.0, pitch_deg: float = 0.0) -> PoseSample:
    q = quat_from_euler(math.radians(roll_deg), math.radians(pitch_deg), 2.0)
    return PoseSample(t_s, "real", Pose((0, 0, -1), q), (0, 0, 0))


def state_of(
    t_s: float,
    *,
    mode: FlightMode = FlightMode.GUIDED,
    percent: float | None = None,
    volts: float | None = None,
    estimator: str | None = None,
) -> StateSample:
    return StateSample(
        t_s,
        "real",
        True,
        mode,
        mode.name,
        battery_fraction=None if percent is None else percent / 100.0,
        battery_v=volts,
        estimator_fault=estimator,
    )


def stage_sample(t_s: float) -> StageSample:
    return StageSample(t_s, "landed")


def twin(t_s: float, at: Vec3, velocity: Vec3 = (0, 0, 0)) -> PoseSample:
    return PoseSample(t_s, "twin", Pose(at), velocity)


@pytest.mark.parametrize(
    ("axis", "fastest"), [("total", 5.0), ("horizontal", 3.0), ("vertical", 4.0)]
)
def test_speed_is_judged_along_its_axis(axis: str, fastest: float) -> None:
    judge = build("speed", max_m_s=2.0, axis=axis)
    assert judge.on_pose(moving(0.5, 9.0, 0.0, 0.0)) == ()
    stage(judge, takeoff=1.0)
    assert judge.on_pose(moving(2.0, 0.0, 1.0, 0.5)) == ()
    (flag,) = judge.on_pose(moving(3.0, 0.0, 3.0, 4.0))
    assert flag.text == f"real flew {fastest:.2f} m/s; the limit is 2 m/s"
    result = judge.result(9.0)
    assert (result.verdict, result.actual, result.limit) == ("FAIL", fastest, 2.0)
    assert (result.margin, result.at_s, result.unit) == (2.0 - fastest, 3.0, "m/s")


def test_a_least_speed_holds_in_the_air_only() -> None:
    judge = build("speed", min_m_s=1.0)
    stage(judge, takeoff=1.0)
    assert judge.on_pose(moving(2.0, 0.0, 0.0, 0.0)) == ()
    stage(judge, at_height=3.0)
    assert judge.on_pose(moving(4.0, 1.5, 0.0, 0.0)) == ()
    assert judge.result(4.0).margin == pytest.approx(0.5)
    assert judge.on_pose(moving(5.0, 0.5, 0.0, 0.0))
    stage(judge, land=6.0)
    assert judge.on_pose(moving(7.0, 0.0, 0.0, 0.0)) == ()
    assert judge.result(9.0).actual == 0.5


def test_attitude_tells_the_angle_that_is_nearest_to_its_limit() -> None:
    judge = build("attitude", max_roll_deg=20.0, max_pitch_deg=30.0)
    stage(judge, takeoff=1.0)
    assert judge.on_pose(leaning(2.0, roll_deg=-15.0)) == ()
    assert judge.result(3.0).margin == pytest.approx(5.0)
    (flag,) = judge.on_pose(leaning(3.0, pitch_deg=-31.0))
    assert flag.text == "real had a pitch of 31.0 deg; the limit is 30 deg"
    result = judge.result(9.0)
    assert (result.verdict, result.limit) == ("FAIL", 30.0)
    assert result.actual == pytest.approx(31.0)


def test_tilt_is_the_angle_to_the_vertical() -> None:
    judge = build("attitude", max_tilt_deg=35.0)
    stage(judge, takeoff=1.0)
    judge.on_pose(leaning(2.0, roll_deg=30.0))
    assert judge.result(3.0).actual == pytest.approx(30.0)
    assert judge.on_pose(leaning(3.0, roll_deg=30.0, pitch_deg=30.0))
    assert judge.result(3.0).actual == pytest.approx(math.degrees(math.acos(0.75)))


def test_an_estimator_that_lacks_something_once_fails() -> None:
    judge = build("estimator")
    judge.on_state(state_of(0.5, estimator="before"))
    stage(judge, takeoff=1.0)
    assert judge.on_state(state_of(2.0)) == ()
    assert judge.result(2.0).verdict == "PASS"
    (flag,) = judge.on_state(state_of(3.0, estimator="no height"))
    assert flag.text == "real: no height"
    assert judge.on_state(state_of(3.5, estimator="no height")) == ()
    judge.on_state(state_of(4.0))
    result = judge.result(9.0)
    assert (result.verdict, result.actual, result.at_s) == ("FAIL", 1.0, 3.0)
    assert result.detail == "no height"


def test_an_estimator_may_be_unsound_for_a_while() -> None:
    judge = build("estimator", max_unsound_s=1.0)
    stage(judge, takeoff=1.0)
    for t_s, fault in ((2.0, "no height"), (3.0, None), (4.0, "no velocity")):
        assert judge.on_state(state_of(t_s, estimator=fault)) == ()
    result = judge.result(4.5)
    assert (result.verdict, result.margin) == ("PASS", 0.0)
    # Nothing more is heard: the window's end shows how long it lasted.
    assert [f.text for f in judge.on_stage(stage_sample(5.5))] == ["real: no velocity"]
    assert judge.result(9.0).actual == 1.5
    # What comes behind the window adds nothing.
    stage(judge, landed=8.0, end=9.0)
    assert judge.result(9.0).actual == 1.5


def test_battery_by_charge_and_by_voltage() -> None:
    charge, voltage = build("battery", min_percent=20.0), build("battery", min_v=10.5)
    for judge in (charge, voltage):
        stage(judge, takeoff=1.0)
        assert judge.on_state(state_of(2.0)) == ()
        assert judge.result(2.0).detail == "it never reported its battery"
    assert charge.on_state(state_of(3.0, percent=20.0, volts=9.0)) == ()
    assert voltage.on_state(state_of(3.0, percent=5.0, volts=10.6)) == ()
    (low,) = charge.on_state(state_of(4.0, percent=19.0, volts=9.0))
    assert low.text == "real: battery at 19.0 %; the limit is 20 %"
    (low,) = voltage.on_state(state_of(4.0, volts=10.0))
    assert low.text == "real: battery at 10.0 V; the limit is 10.5 V"
    assert charge.result(5.0).margin == pytest.approx(-1.0)
    assert (voltage.result(5.0).margin, voltage.result(5.0).unit) == (-0.5, "V")


@pytest.mark.parametrize("percent", range(1, 101))
def test_a_charge_of_exactly_the_least_percent_passes(percent: int) -> None:
    judge = build("battery", min_percent=percent)
    bound = build("stl", stl=f"always ({percent} <= battery_percent <= {percent})")
    for one in (judge, bound):
        stage(one, takeoff=1.0, goal=1.5)
        one.on_state(state_of(2.0, percent=percent))
        assert one.result(3.0).verdict == "PASS"


def test_a_charge_that_is_unknown_after_it_was_known_passes_nothing() -> None:
    judge = build("battery", min_percent=20.0)
    stage(judge, takeoff=1.0)
    judge.on_state(state_of(2.0, percent=90.0))
    assert judge.result(2.0).verdict == "PASS"
    judge.on_state(state_of(3.0, volts=11.0))
    found = judge.result(4.0)
    assert found.verdict == "INVALID"
    assert (
        found.detail
        == "its battery's charge is reported as unknown 2.00 s after the takeoff command"
    )
    judge.on_state(state_of(5.0, percent=10.0))
    assert judge.result(6.0).verdict == "FAIL"


def test_modes_that_are_not_allowed_are_flagged_each_time() -> None:
    judge = build("modes")
    judge.on_state(state_of(0.0, mode=FlightMode.HOLD))
    stage(judge, takeoff=0.5, goal=1.0)
    texts = [
        flag.text
        for t_s, mode in enumerate(
            (
                FlightMode.GUIDED,
                FlightMode.HOLD,
                FlightMode.HOLD,
                FlightMode.GUIDED,
                FlightMode.PILOT,
            )
        )
        for flag in judge.on_state(state_of(2.0 + t_s, mode=mode))
    ]
    assert texts == ["real was in HOLD (hold)", "real was in PILOT (pilot)"]
    stage(judge, land=8.0)
    assert judge.on_state(state_of(9.0, mode=FlightMode.LAND)) == ()
    result = judge.result(9.0)
    assert (result.verdict, result.actual, result.at_s) == ("FAIL", 3.0, 3.0)


def test_modes_may_change_so_often() -> None:
    judge = build("modes", allowed=("guided", "hold"), max_changes=1)
    stage(judge, goal=1.0)
    for t_s, mode in ((2.0, FlightMode.GUIDED), (3.0, FlightMode.HOLD)):
        assert judge.on_state(state_of(t_s, mode=mode)) == ()
    assert judge.result(4.0).margin == 0.0
    assert judge.on_state(state_of(4.0, mode=FlightMode.GUIDED))
    assert (judge.result(5.0).verdict, judge.result(5.0).margin) == ("FAIL", -1.0)


def test_a_mode_that_is_not_allowed_has_no_margin_to_the_most_changes() -> None:
    judge = build("modes", allowed=("guided", "hold"), max_changes=2)
    stage(judge, goal=1.0)
    for t_s, mode in ((2.0, FlightMode.GUIDED), (3.0, FlightMode.LAND)):
        judge.on_state(state_of(t_s, mode=mode))
    result = judge.result(4.0)
    assert (result.verdict, result.actual, result.limit, result.margin) == ("FAIL", 1.0, None, None)


def test_divergence_carries_the_older_pose_on() -> None:
    judge = build("twin_divergence")
    assert judge.watches == ("real", "twin")
    stage(judge, takeoff=0.0)
    judge.on_pose(pose(1.0, (0, 0, -1), (1, 0, 0)))
    judge.on_pose(twin(1.5, (0.5, 0.3, -1)))
    result = judge.result(2.0)
    assert (result.verdict, result.required, result.margin) == ("PASS", False, None)
    assert result.actual == pytest.approx(0.3)


def test_divergence_with_a_limit() -> None:
    judge = build("twin_divergence", max_m=0.5)
    stage(judge, takeoff=0.0)
    judge.on_pose(twin(1.0, (0, 0, -1)))
    assert [f.text for f in judge.on_pose(pose(1.0, (0, 1, -1)))] == [
        "real and twin are 1.00 m apart; the limit is 0.5 m"
    ]
    stage(judge, land=2.0)
    judge.on_pose(pose(3.0, (0, 9, -1)))
    assert numbers(judge.result(4.0)) == ("FAIL", 1.0, 0.5, -0.5, 1.0)


def test_divergence_exactly_at_its_limit_is_within_it() -> None:
    judge = build("twin_divergence", max_m=0.5)
    stage(judge, takeoff=0.0)
    judge.on_pose(twin(1.0, (0, 0, -1)))
    assert judge.on_pose(pose(1.0, (0, 0.5, -1))) == ()
    assert numbers(judge.result(4.0)) == ("PASS", 0.5, 0.5, 0.0, 1.0)
