"""An estimated heading beside gyroscopes, magnetometer and GPS receiver, with values alone."""

import math

import pytest

from wil_campaign.vehicles.poses.headings import HeadingComparison, HeadingDifference
from wil_campaign.worlds.frames import Vec3, quat_conjugate, quat_from_euler, rotate, wrap_pi

FIELD_NED: Vec3 = (0.21, 0.01, 0.43)
HZ = 50


def flown(
    comparison: HeadingComparison,
    seconds: float,
    *,
    from_s: float = 0.0,
    rate_rad_s: float = 0.0,
    corrected_rad_s: float = 0.0,
    heading_rad: float = 0.0,
) -> tuple[float, list[HeadingDifference]]:
    """Turn by gyroscopes and by corrections; return the last heading, and what was found."""
    found = []
    for step in range(round(seconds * HZ)):
        heading_rad = wrap_pi(heading_rad + (rate_rad_s + corrected_rad_s) / HZ)
        t_s = from_s + (step + 1) / HZ
        q_wxyz = quat_from_euler(0.05, -0.1, heading_rad)
        rates = rotate(quat_conjugate(q_wxyz), (0.0, 0.0, rate_rad_s))
        one = comparison.attitude(t_s, q_wxyz, rates, t_s)
        found += [one] if one is not None else []
    return heading_rad, found


def gyroscopes_deg(found: list[HeadingDifference]) -> float:
    assert {one.source for one in found} == {"gyroscopes"}
    return math.degrees(found[-1].turned_rad)


def test_turning_by_the_gyroscopes_is_no_correction() -> None:
    comparison = HeadingComparison()
    _, found = flown(comparison, 20.0, rate_rad_s=1.0)
    assert gyroscopes_deg(found) == pytest.approx(0.0, abs=0.1)
    assert len(found) == pytest.approx(200, abs=2)


@pytest.mark.parametrize("over_s", [0.02, 0.5, 5.0, 20.0])
def test_correction_is_found_at_once_and_over_seconds(over_s: float) -> None:
    comparison = HeadingComparison()
    flown(comparison, 3.0)
    comparison.anchor()
    wrong_rad = math.radians(-40.0)
    _, found = flown(comparison, over_s, from_s=3.0, corrected_rad_s=wrong_rad / over_s)
    _, more = flown(comparison, 0.2, from_s=3.0 + over_s, heading_rad=wrong_rad)
    assert gyroscopes_deg([*found, *more]) == pytest.approx(-40.0, abs=0.1 + 0.11 * over_s)


def test_drift_of_a_gyroscope_is_no_correction() -> None:
    comparison = HeadingComparison()
    _, found = flown(comparison, 120.0, corrected_rad_s=math.radians(0.09))
    assert gyroscopes_deg(found) == pytest.approx(0.0, abs=0.1)


def test_step_within_a_gap_is_found_and_a_turn_within_it_is_none() -> None:
    comparison = HeadingComparison()
    flown(comparison, 2.0)
    _, found = flown(comparison, 0.2, from_s=2.4, heading_rad=math.radians(40.0))
    assert gyroscopes_deg(found) == pytest.approx(36.2, abs=0.3)
    # Within 0.4 s it turned by 3 degrees, faster than before and after.
    comparison = HeadingComparison()
    flown(comparison, 2.0)
    assert comparison.attitude(2.4, quat_from_euler(0, 0, 0.05), (0.0, 0.0, 0.0), 2.4) is not None
    _, found = flown(comparison, 0.2, from_s=2.4, heading_rad=0.05)
    assert gyroscopes_deg(found) == pytest.approx(0.0, abs=0.2)


def test_anchor_begins_anew_and_older_attitudes_count_for_nothing() -> None:
    comparison = HeadingComparison()
    flown(comparison, 1.0)
    flown(comparison, 1.0, from_s=1.0, heading_rad=1.0)
    comparison.anchor()
    assert comparison.attitude(1.5, quat_from_euler(0, 0, 0), (0, 0, 0), 2.01) is None
    _, found = flown(comparison, 1.0, from_s=2.0, heading_rad=1.0)
    assert gyroscopes_deg(found) == 0.0


def test_magnetometer_shows_a_ground_that_was_magnetic() -> None:
    """Its heading turns in the climb while the estimator keeps to its own."""
    comparison = HeadingComparison()
    comparison.attitude(0.9, quat_from_euler(0, 0, 0), (0, 0, 0), 0.9)
    steel = rotate(quat_from_euler(0, 0, math.radians(40.0)), FIELD_NED)
    for count in range(4):
        comparison.magnetic_field(steel, 1.0 + count / 2)
    comparison.anchor()
    found = [comparison.magnetic_field(FIELD_NED, 3.0 + count / 2) for count in range(4)]
    assert found[-1] is not None
    assert (found[-1].source, found[-1].t_s) == ("magnetometer", 4.5)
    assert math.degrees(found[-1].turned_rad) == pytest.approx(-40.0, abs=0.5)


def test_the_magnetometer_is_compared_at_any_attitude_but_in_no_vertical_field() -> None:
    comparison = HeadingComparison()
    flown(comparison, 1.0)
    comparison.anchor()
    for count in range(20):
        q_wxyz = quat_from_euler(0.3, -0.4, count * 0.3)
        comparison.attitude(1.1 + count / 2, q_wxyz, (0, 0, 0), 1.1 + count / 2)
        field = rotate(quat_conjugate(q_wxyz), FIELD_NED)
        found = comparison.magnetic_field(field, 1.1 + count / 2)
        assert found is None or found.turned_rad == pytest.approx(0.0, abs=1e-6)
    assert found is not None
    assert comparison.magnetic_field((0.0, 0.0, 0.5), 12.0) is None
    assert comparison.magnetic_field((0.0, 0.0, 0.0), 12.0) is None


def test_receivers_heading_and_course_may_be_late() -> None:
    comparison = HeadingComparison()
    for step in range(100):
        t_s = step / HZ
        comparison.attitude(t_s, quat_from_euler(0, 0, t_s), (0, 0, 1.0), t_s)
        comparison.velocity((2.0 * math.cos(t_s), 2.0 * math.sin(t_s), 0.1), t_s)
    late = comparison.gps_yaw(1.5, None, 1.98)
    assert late is not None
    assert abs(late.turned_rad) < 0.02
    wrong = comparison.gps_yaw(1.5 - math.pi / 2.0, 0.01, 1.98)
    assert wrong is not None
    assert (wrong.source, wrong.accuracy_rad) == ("gps yaw", 0.01)
    assert math.degrees(wrong.turned_rad) == pytest.approx(84.0, abs=2.0)
    course = comparison.course(1.5 - 1.0, 2.0, None, 1.98)
    assert course is not None
    assert course.source == "course over ground"
    assert course.turned_rad == pytest.approx(0.9, abs=0.04)
    assert comparison.course(0.5, 0.3, None, 1.98) is None  # too slow to have one
    assert comparison.course(0.5, 2.0, 0.4, 1.98) is None  # too coarse


def test_nothing_to_compare_with_is_no_comparison() -> None:
    comparison = HeadingComparison()
    assert comparison.gps_yaw(1.0, None, 0.0) is None
    assert comparison.course(1.0, 3.0, None, 0.0) is None
    assert comparison.magnetic_field(FIELD_NED, 0.0) is None
