"""Compares an estimator's heading with gyroscopes, magnetometer and GPS receiver; pure."""

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from wil_campaign.worlds.frames import (
    Quat,
    Vec3,
    add,
    heading_of,
    quat_conjugate,
    quat_multiply,
    rotate,
    scale,
    wrap_pi,
)

_REPORT_EVERY_S = 0.098
"""Ten comparisons a second of the gyroscopes are reported, despite rounding."""
_DRIFT_RAD_S = math.radians(0.1)
"""How fast an estimator corrects its heading for what its gyroscopes drift: the bias that is left
of a MEMS gyroscope once an estimator knows it."""
_TURNS_UP_RAD_S2 = 3.0
"""How fast a multicopter's rotation changes at most."""
_GAP_S = 0.15
"""Samples further apart do not show how fast the vehicle turned in between."""
_STAMPS_S = 0.1
"""By how much heading and gyroscopes may differ in time."""
_RECENT_S = 1.0
_LATE_S = 0.6
"""By how much a receiver's heading or course may be late: its filter, its rate, and a radio."""
_MAGNETOMETER_RAD = math.radians(6.0)
"""Accuracy of a magnetometer in flight, one standard deviation: motors draw currents."""
_FIELDS_OVER_S = 1.6
_LEAST_FIELDS = 3
"""A magnetometer's heading is the mean of so many fields at least, within so long."""
_LEAST_HORIZONTAL = 0.2
"""The least horizontal part of a field that tells a heading: a dip of 78 degrees."""
_GPS_YAW_RAD = math.radians(2.0)
"""Accuracy of a heading by two antennas that states none."""
_GPS_SPEED_M_S = 0.1
"""Accuracy of a receiver's speed on each axis where it states none."""
_COURSE_WITHIN_RAD = 0.15
"""A course is compared from the speed on at which it is known so well (one standard deviation)."""


class HeadingDifference(NamedTuple):
    """By how much an estimated heading differs from another source of it.

    t_s: when it arrived (run clock). source: "gyroscopes" and "magnetometer" tell by how much it
    has turned beside them since the vehicle was anchored; "gps yaw" and "course over ground" are
    headings themselves. turned_rad: clockwise is positive. accuracy_rad: of the source, one
    standard deviation.
    """

    t_s: float
    source: str
    turned_rad: float
    accuracy_rad: float


class HeadingComparison:
    """Compares one estimator's heading with its other sources; times of arrival on the run clock.

    A heading that is corrected, at once or over seconds, turns while the gyroscopes say that the
    vehicle does not. What they drift is left out: 0.1 degrees a second.
    """

    def __init__(self) -> None:
        self._last: tuple[float, Quat, Vec3] | None = None
        self._turned_rad = 0.0
        self._report_due_s = -math.inf
        self._headings: deque[tuple[float, float, float]] = deque()
        """Arrival, heading and rate of rotation of the last second."""
        self._courses: deque[tuple[float, float, float]] = deque()
        """Arrival, speed and direction of the estimated velocity."""
        self._fields: deque[tuple[float, float]] = deque()
        """Arrival and direction of the magnetic field by the estimated attitude."""
        self._field_then_rad: float | None = None

    def anchor(self) -> None:
        """Compare from now on with the present heading: the vehicle's frame is anchored by it."""
        self._turned_rad = 0.0
        self._field_then_rad = self._mean_field(1)

    def attitude(
        self, boot_s: float, q_wxyz: Quat, rates_rad_s: Vec3, t_s: float
    ) -> HeadingDifference | None:
        """Take an estimated attitude with its body rates; return a comparison when one is due.

        boot_s: its time since boot; t_s: when it arrived.
        """
        last = self._last
        if last is not None and boot_s <= last[0]:
            return None
        self._last = (boot_s, q_wxyz, rates_rad_s)
        self._headings.append((t_s, heading_of(q_wxyz), abs(rotate(q_wxyz, rates_rad_s)[2])))
        while self._headings[0][0] < t_s - _RECENT_S:
            self._headings.popleft()
        if last is None:
            return None
        self._take_turn(last, boot_s - last[0], q_wxyz, rates_rad_s)
        if t_s < self._report_due_s:
            return None
        self._report_due_s = t_s + _REPORT_EVERY_S
        slack_rad = _STAMPS_S * max(rate for _, _, rate in self._headings)
        return HeadingDifference(t_s, "gyroscopes", _less(self._turned_rad, slack_rad), 0.0)

    def velocity(self, velocity_ned_m_s: Vec3, t_s: float) -> None:
        """Take an estimated velocity in the autopilot's local frame."""
        north, east, _ = velocity_ned_m_s
        self._courses.append((t_s, math.hypot(north, east), math.atan2(east, north)))
        while self._courses[0][0] < t_s - _LATE_S:
            self._courses.popleft()

    def magnetic_field(self, field_frd: Vec3, t_s: float) -> HeadingDifference | None:
        """Take a magnetometer's field in body axes, in any unit; return a comparison."""
        if self._last is None:
            return None
        north, east, _ = field_ned = rotate(self._last[1], field_frd)
        if math.hypot(north, east) < _LEAST_HORIZONTAL * math.hypot(*field_ned) or not any(
            field_ned
        ):
            return None
        self._fields.append((t_s, math.atan2(east, north)))
        while self._fields[0][0] < t_s - _FIELDS_OVER_S:
            self._fields.popleft()
        now_rad = self._mean_field(_LEAST_FIELDS)
        if now_rad is None:
            return None
        if self._field_then_rad is None:
            self._field_then_rad = now_rad
        turned_rad = wrap_pi(now_rad - self._field_then_rad)
        return HeadingDifference(t_s, "magnetometer", turned_rad, _MAGNETOMETER_RAD)

    def gps_yaw(
        self, heading_rad: float, accuracy_rad: float | None, t_s: float
    ) -> HeadingDifference | None:
        """Take a heading by a receiver with two antennas; return a comparison."""
        turned_rad = _nearest(heading_rad, (one for _, one, _ in self._recent(t_s)))
        if turned_rad is None:
            return None
        return HeadingDifference(t_s, "gps yaw", turned_rad, accuracy_rad or _GPS_YAW_RAD)

    def course(
        self, course_rad: float, speed_m_s: float, accuracy_m_s: float | None, t_s: float
    ) -> HeadingDifference | None:
        """Take a receiver's course over ground; return a comparison where it is fast enough."""
        slowest_m_s = min((speed for _, speed, _ in self._courses), default=0.0)
        known_rad = (accuracy_m_s or _GPS_SPEED_M_S) / max(min(speed_m_s, slowest_m_s), 1e-3)
        if known_rad > _COURSE_WITHIN_RAD:
            return None
        turned_rad = _nearest(course_rad, (one for _, _, one in self._courses))
        if turned_rad is None:
            return None
        return HeadingDifference(t_s, "course over ground", turned_rad, known_rad)

    def _take_turn(
        self, last: tuple[float, Quat, Vec3], span_s: float, q_wxyz: Quat, rates_rad_s: Vec3
    ) -> None:
        """Add by how much the heading turned beside the gyroscopes between two attitudes."""
        _, before, rates_before = last
        gyro_rad = scale(add(rates_before, rates_rad_s), span_s / 2.0)
        predicted = quat_multiply(before, _rotation(gyro_rad))
        w, _, _, z = quat_multiply(q_wxyz, quat_conjugate(predicted))
        turned_rad = wrap_pi(2.0 * math.atan2(z, w))
        if span_s > _GAP_S:
            turned_rad = _less(turned_rad, _TURNS_UP_RAD_S2 * span_s**2 / 8.0)
        self._turned_rad = _less(self._turned_rad + turned_rad, _DRIFT_RAD_S * span_s)

    def _mean_field(self, least: int) -> float | None:
        """Return the mean direction of the last magnetic fields; None with fewer than `least`."""
        if len(self._fields) < least:
            return None
        angles_rad = [angle_rad for _, angle_rad in self._fields]
        north = math.fsum(math.cos(one) for one in angles_rad)
        return math.atan2(math.fsum(math.sin(one) for one in angles_rad), north)

    def _recent(self, t_s: float) -> list[tuple[float, float, float]]:
        return [heading for heading in self._headings if heading[0] >= t_s - _LATE_S]


def _less(value: float, by: float) -> float:
    """Return a value nearer to 0 by so much, or 0."""
    return math.copysign(max(0.0, abs(value) - by), value)


def _rotation(turned_rad: Vec3) -> Quat:
    angle_rad = math.hypot(*turned_rad)
    if angle_rad < 1e-12:
        return (1.0, 0.0, 0.0, 0.0)
    x, y, z = scale(turned_rad, math.sin(angle_rad / 2.0) / angle_rad)
    return (math.cos(angle_rad / 2.0), x, y, z)


def _nearest(angle_rad: float, others_rad: Iterable[float]) -> float | None:
    """Return by how much the nearest of other angles is turned from an angle; None for none."""
    return min((wrap_pi(one - angle_rad) for one in others_rad), key=abs, default=None)
