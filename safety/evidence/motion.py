"""Velocity and attitude as evidence, if an oracle judges them; pure."""

import math
from collections import deque
from dataclasses import dataclass

from wil_campaign.safety.evidence.agreement import SIGMAS, Disagreement, SourceAccuracy
from wil_campaign.safety.evidence.flown_coverage import FlownCoverage
from wil_campaign.safety.evidence.terms import SignalTerms
from wil_campaign.safety.model.samples import GroundSpeedSample, PoseSample, ReferenceSample
from wil_campaign.worlds.frames import Quat, Vec3, add, norm, rotate, scale, subtract

_SPAN_S = 1.0
_KEPT_S = 3.0
_MOST_GAP_S = 0.5
"""A velocity is not integrated over a longer gap."""
_STAMPS_S = 0.1
"""By how much the mapped times of two sources may differ."""
_STATED_M_S = 0.1
"""Accuracy of a velocity whose source states none, one standard deviation on each axis."""
_SPEED_LATE_S = 0.6
"""By how much another source's speed may be late: a receiver's filter, its rate, and a radio."""
_DOWN: Vec3 = (0.0, 0.0, 1.0)


class VelocityCoverage(FlownCoverage):
    """Coverage of the velocity: its integral has to agree with the positions.

    The integral over a second is compared with the displacement by the same source's positions, and
    by those of each other source: on no axis may it differ by more than SIGMAS of what both state.
    """

    def __init__(self, terms: SignalTerms) -> None:
        super().__init__(terms, what="velocity")
        self._accuracy = terms.accuracy or SourceAccuracy(0.0)
        self._way: deque[_Integrated] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self._samples: dict[str, deque[tuple[ReferenceSample, Vec3]]] = {}
        self._sources: dict[str, None] = {}
        self._speeds: deque[GroundSpeedSample] = deque()

    @property
    def compared_with(self) -> tuple[str, ...]:
        """Return the sources of positions and speeds with which the velocity was compared."""
        return tuple(self._sources)

    def pose(self, sample: PoseSample) -> None:
        """Take a pose of the judged source."""
        if self._way and sample.t_s <= self._way[-1].t_s:
            return
        self.observe(sample.t_s)
        self.hold_against_last(self.unrounded(sample.velocity_ned_m_s, sample), sample)
        self._integrate(sample)
        self._compare_own()
        while self._waiting and self._waiting[0].t_s <= sample.t_s:
            self._compare_with(self._waiting.popleft())
        while self._speeds and self._speeds[0].t_s + _STAMPS_S <= sample.t_s:
            self._compare_speed(self._speeds.popleft())

    def ground_speed(self, sample: GroundSpeedSample) -> None:
        """Take another source's horizontal speed of the vehicle."""
        self._speeds.append(sample)

    def reference(self, sample: ReferenceSample) -> None:
        """Take another source's position of the vehicle."""
        self._waiting.append(sample)

    def _integrate(self, sample: PoseSample) -> None:
        way, velocity = self._way, sample.velocity_ned_m_s
        if way and sample.t_s - way[-1].t_s > _MOST_GAP_S:
            way.clear()
            self._samples.clear()
        integral_m: Vec3 = (0.0, 0.0, 0.0)
        if way:
            # By the trapezoidal rule.
            both_m_s = add(way[-1].velocity_m_s, velocity)
            integral_m = add(way[-1].integral_m, scale(both_m_s, (sample.t_s - way[-1].t_s) / 2.0))
        way.append(_Integrated(sample.t_s, sample.pose.position_ned_m, velocity, integral_m))
        while way[0].t_s < sample.t_s - _KEPT_S:
            way.popleft()

    def _compare_own(self) -> None:
        now = self._way[-1]
        before = next(
            (
                integrated
                for integrated in reversed(self._way)
                if integrated.t_s <= now.t_s - _SPAN_S
            ),
            None,
        )
        if before is not None:
            moved_m = subtract(now.place_m, before.place_m)
            self._compare_integral(before, now, moved_m, self._accuracy, "its own positions")

    def _compare_with(self, reference: ReferenceSample) -> None:
        other = self.terms.references.get(reference.source)
        now = self._at(reference.t_s)
        if other is None or now is None:
            return
        recent = self._samples.setdefault(reference.source, deque())
        recent.append((reference, now.integral_m))
        while recent[0][0].t_s < reference.t_s - _SPAN_S - _MOST_GAP_S:
            recent.popleft()
        found = next(
            (one for one in reversed(recent) if one[0].t_s <= reference.t_s - _SPAN_S), None
        )
        if found is None:
            return
        self._sources[reference.source] = None
        past, integral_m = found
        before = _Integrated(past.t_s, past.position_ned_m, past.velocity_ned_m_s, integral_m)
        moved_m = subtract(reference.position_ned_m, past.position_ned_m)
        self._compare_integral(before, now, moved_m, other, reference.source)

    def _compare_speed(self, other: GroundSpeedSample) -> None:
        """Compare the velocity with a speed that arrived then and was measured before."""
        begin_s, end_s = other.t_s - _SPEED_LATE_S, other.t_s + _STAMPS_S
        if not self._way or self._way[0].t_s > begin_s:
            return
        near = [
            math.hypot(*integrated.velocity_m_s[:2])
            for integrated in self._way
            if begin_s <= integrated.t_s <= end_s
        ]
        if not near:
            return
        self._sources[other.source] = None
        stated_m_s = self._accuracy.velocity_m_s or _STATED_M_S
        limit_m_s = SIGMAS * math.hypot(stated_m_s, other.accuracy_m_s or _STATED_M_S)
        nearest_m_s = min(max(other.speed_m_s, min(near)), max(near))
        if abs(other.speed_m_s - nearest_m_s) <= limit_m_s or not self.stages.open:
            return
        message = f"by it the vehicle moved {nearest_m_s:.2f} m/s over ground"
        message += (
            f", by {other.source} {other.speed_m_s:.2f} m/s; the limit is {limit_m_s:.2f} m/s"
        )
        self.find(other.t_s, message)

    def _compare_integral(
        self,
        before: "_Integrated",
        now: "_Integrated",
        moved_m: Vec3,
        other: SourceAccuracy,
        source: str,
    ) -> None:
        """Compare the velocity's integral with a displacement within the same time."""
        span_s = now.t_s - before.t_s
        stated_m_s = self._accuracy.velocity_m_s or _STATED_M_S
        exact_m = math.hypot(stated_m_s * span_s, other.displacement_m(span_s))
        changed_m_s = norm(subtract(now.velocity_m_s, before.velocity_m_s))
        limit_m = SIGMAS * exact_m + _STAMPS_S * changed_m_s
        integral_m = subtract(now.integral_m, before.integral_m)
        apart_m = max(map(abs, subtract(integral_m, moved_m)))
        if apart_m <= limit_m or not self.stages.open:
            return
        message = f"by it the vehicle moved {norm(integral_m):.2f} m within {span_s:.2f} s"
        message += f", by {source} {norm(moved_m):.2f} m"
        self.find(now.t_s, f"{message}; the limit is {limit_m:.2f} m on each axis")

    def _at(self, t_s: float) -> "_Integrated | None":
        """Return the integral at a time between two poses; None outside of them."""
        after: _Integrated | None = None
        for integrated in reversed(self._way):
            if integrated.t_s <= t_s:
                if after is None:
                    return integrated if integrated.t_s == t_s else None
                share = (t_s - integrated.t_s) / (after.t_s - integrated.t_s)
                way_m = scale(subtract(after.integral_m, integrated.integral_m), share)
                return _Integrated(
                    t_s,
                    integrated.place_m,
                    integrated.velocity_m_s,
                    add(integrated.integral_m, way_m),
                )
            after = integrated
        return None


@dataclass(frozen=True, slots=True)
class _Integrated:
    """A judged velocity with its integral so far, and the judged position."""

    t_s: float
    place_m: Vec3
    velocity_m_s: Vec3
    integral_m: Vec3


class AttitudeCoverage(FlownCoverage):
    """Coverage of the attitude: it changes in the air, and agrees with other sources.

    The angle between the vehicle's vertical axes by the judged and by each other source is limited
    to SIGMAS of what both state. Headings are not compared: indoors a compass may be wrong.
    """

    def __init__(self, terms: SignalTerms) -> None:
        super().__init__(terms, what="attitude")
        self._accuracy = terms.accuracy or SourceAccuracy(0.0)
        self._judged: deque[tuple[float, Vec3]] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self._sources: dict[str, None] = {}

    @property
    def compared_with(self) -> tuple[str, ...]:
        """Return the sources with which the attitude was compared."""
        return tuple(self._sources)

    def pose(self, sample: PoseSample) -> None:
        """Take a pose of the judged source."""
        if self._judged and sample.t_s <= self._judged[-1][0]:
            return
        self.observe(sample.t_s)
        self.hold_against_last(sample.pose.q_wxyz, sample)
        self._judged.append((sample.t_s, _down_axis(sample.pose.q_wxyz)))
        while self._judged[0][0] < sample.t_s - _KEPT_S:
            self._judged.popleft()
        while self._waiting and self._waiting[0].t_s + _STAMPS_S <= sample.t_s:
            found = self._differs(self._waiting.popleft())
            if found is not None and self.stages.open:
                self.find(found.at_s, found.text)

    def reference(self, sample: ReferenceSample) -> None:
        """Take another source's attitude of the vehicle."""
        self._waiting.append(sample)

    def _differs(self, reference: ReferenceSample) -> Disagreement | None:
        other, t_s = self.terms.references.get(reference.source), reference.t_s
        if other is None or reference.q_wxyz is None:
            return None
        axis = _down_axis(reference.q_wxyz)
        near = [one for at_s, one in self._judged if abs(at_s - t_s) <= _STAMPS_S]
        if not near:
            return None
        self._sources[reference.source] = None
        apart_rad = min(_between(axis, one) for one in near)
        limit_rad = SIGMAS * math.hypot(self._accuracy.attitude_rad, other.attitude_rad)
        if apart_rad <= limit_rad:
            return None
        message = (
            f"it leans {math.degrees(apart_rad):.1f} deg from where {reference.source} has the"
            " vehicle's vertical axis"
        )
        return Disagreement(t_s, f"{message}; the limit is {math.degrees(limit_rad):.1f} deg")


def _down_axis(q_wxyz: Quat) -> Vec3:
    return rotate(q_wxyz, _DOWN)


def _between(one: Vec3, other: Vec3) -> float:
    """Return the angle between two unit vectors, radians."""
    cosine = sum(a * b for a, b in zip(one, other, strict=True))
    return math.acos(max(-1.0, min(1.0, cosine)))
