"""Checks whether two position sources of a vehicle agree within their stated accuracy; pure."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from wil_campaign.safety.model.samples import PoseSample, ReferenceSample
from wil_campaign.worlds.frames import Vec3, add, norm, scale, subtract

SIGMAS = 5.0
"""The limit in standard deviations: two correct sources exceed it once in two million samples."""
SPANS_S = (0.2, 1.0)
"""Over which times displacements are compared: the short one shows steps, the long one drifts."""
MOST_APART_M = 0.5
"""By how much, on an axis, a judged position may differ from that of a better source, whatever
accuracy it states: more would hide a contact that the better source shows."""
_STAMPS_S = 0.1
"""By how much the mapped times of two sources may differ: half of the round trip of a poor radio.
At constant velocity that changes no displacement; while braking it does."""
_KEPT_S = 3.0
_MOST_GAP_S = 0.3
"""Over a longer silence of the other source its velocity is not integrated."""


@dataclass(frozen=True, slots=True)
class SourceAccuracy:
    """The accuracy of a position source, one standard deviation on each axis.

    position_m: of its position; velocity_m_s: of its velocity, and of the change of its position,
    None where the velocity is derived from positions. attitude_rad: of its attitude.
    """

    position_m: float
    velocity_m_s: float | None = None
    attitude_rad: float = 0.0

    def displacement_m(self, span_s: float) -> float:
        """Return the accuracy of a displacement within a time, metres."""
        by_places_m = math.sqrt(2.0) * self.position_m
        if self.velocity_m_s is None:
            return by_places_m
        return min(by_places_m, self.velocity_m_s * span_s)


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A disagreement of two position sources. at_s: since when; text: how they differ."""

    at_s: float
    text: str


class PositionAgreement:
    """Checks the judged positions for agreement with another source, at the other's times.

    Positions are compared, and the displacements of both within each of SPANS_S. Each difference
    is limited to SIGMAS times what both state; that of positions to MOST_APART_M where the other
    source is the better one. Which of the two is wrong is unknown.

    A source with its own velocity gives two displacements, and disagrees with the judged source
    only if both do: the velocity of PX4 1.18 differed by 0.9 m/s from the change of its positions
    in a flight of the real firmware, and its positions step when the estimate is corrected.
    """

    def __init__(self, *, judged: SourceAccuracy, other: SourceAccuracy, source: str) -> None:
        self._judged = judged
        self._other = other
        self._source = source
        self.count = 0
        """How often the two were compared."""
        self._poses: deque[PoseSample] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self._pairs: deque[_Compared] = deque()

    def restart(self) -> None:
        """Reset the agreement check: its window starts now."""
        self._poses.clear()
        self._waiting.clear()
        self._pairs.clear()

    def pose(self, sample: PoseSample) -> Disagreement | None:
        """Add a judged pose to the agreement check."""
        if self._poses and sample.t_s <= self._poses[-1].t_s:
            return None
        self._poses.append(sample)
        while self._poses[0].t_s < sample.t_s - _KEPT_S:
            self._poses.popleft()
        return self._compare()

    def reference(self, sample: ReferenceSample) -> Disagreement | None:
        """Add a position of the other source; return a disagreement, or None."""
        self._waiting.append(sample)
        return self._compare()

    def _compare(self) -> Disagreement | None:
        while self._waiting and self._poses and self._waiting[0].t_s <= self._poses[-1].t_s:
            reference = self._waiting.popleft()
            judged_m = self._judged_at(reference.t_s)
            if judged_m is None:
                continue
            self.count += 1
            found = next(self._differences(reference, judged_m), None)
            if found is not None:
                return found
        return None

    def _differences(self, reference: ReferenceSample, judged_m: Vec3) -> Iterator[Disagreement]:
        apart_m = subtract(judged_m, reference.position_ned_m)
        limit_m, t_s = self._place_limit_m(reference), reference.t_s
        if _on_an_axis(apart_m) > limit_m:
            message = f"it is {norm(apart_m):.2f} m from the position by {self._source}"
            message += f"; the limit is {limit_m:.2f} m on each axis"
            yield Disagreement(t_s, message)
        now = self._remember(reference, judged_m)
        for span_s in SPANS_S:
            before = self._before(t_s - span_s)
            if before is not None:
                yield from self._moved_apart(before, now)

    def _place_limit_m(self, reference: ReferenceSample) -> float:
        judged_m, other_m = self._judged.position_m, self._other.position_m
        limit_m = SIGMAS * math.hypot(judged_m, other_m)
        if other_m >= judged_m:
            return limit_m
        most_m = MOST_APART_M + _STAMPS_S * norm(reference.velocity_ned_m_s)
        return min(limit_m, most_m)

    def _remember(self, reference: ReferenceSample, judged_m: Vec3) -> "_Compared":
        """Keep a comparison with the integral of the other's velocity; return it."""
        pairs, t_s = self._pairs, reference.t_s
        if pairs and t_s - pairs[-1].t_s > _MOST_GAP_S:
            pairs.clear()  # The movement in between is unknown.
        integral_m: Vec3 = (0.0, 0.0, 0.0)
        if pairs:
            # By the trapezoidal rule.
            both_m_s = add(pairs[-1].reference.velocity_ned_m_s, reference.velocity_ned_m_s)
            integral_m = add(pairs[-1].integral_m, scale(both_m_s, (t_s - pairs[-1].t_s) / 2.0))
        pairs.append(_Compared(reference, judged_m, integral_m))
        while len(pairs) > 1 and pairs[1].t_s <= t_s - max(SPANS_S) + 1e-9:
            pairs.popleft()
        return pairs[-1]

    def _before(self, t_s: float) -> "_Compared | None":
        """Return the last comparison not after a time; None when there is none."""
        return next((pair for pair in reversed(self._pairs) if pair.t_s <= t_s + 1e-9), None)

    def _moved_apart(self, before: "_Compared", now: "_Compared") -> Iterator[Disagreement]:
        t_s, span_s = now.t_s, now.t_s - before.t_s
        moved_m = subtract(now.judged_m, before.judged_m)
        others_m = [subtract(now.reference.position_ned_m, before.reference.position_ned_m)]
        if self._other.velocity_m_s is not None:
            others_m.append(subtract(now.integral_m, before.integral_m))
        exact_m = math.hypot(
            self._judged.displacement_m(span_s), self._other.displacement_m(span_s)
        )
        then_m_s = before.reference.velocity_ned_m_s
        changed_m_s = norm(subtract(now.reference.velocity_ned_m_s, then_m_s))
        limit_m = SIGMAS * exact_m + _STAMPS_S * changed_m_s
        apart_m, other_m = min((_on_an_axis(subtract(moved_m, one)), one) for one in others_m)
        if apart_m > limit_m:
            message = f"it moved {norm(moved_m):.2f} m within {span_s:.2f} s"
            message += f", by {self._source} the vehicle moved {norm(other_m):.2f} m"
            yield Disagreement(t_s, f"{message}; the limit is {limit_m:.2f} m on each axis")

    def _judged_at(self, t_s: float) -> Vec3 | None:
        """Return the judged position at a time for comparison; None before the first."""
        after: PoseSample | None = None
        for sample in reversed(self._poses):
            if sample.t_s <= t_s:
                place_m = sample.pose.position_ned_m
                if after is None or sample.t_s == t_s:
                    return place_m
                share = (t_s - sample.t_s) / (after.t_s - sample.t_s)
                return add(place_m, scale(subtract(after.pose.position_ned_m, place_m), share))
            after = sample
        return None


@dataclass(frozen=True, slots=True)
class _Compared:
    """One comparison of two position sources. integral_m: of the other's velocity so far."""

    reference: ReferenceSample
    judged_m: Vec3
    integral_m: Vec3

    @property
    def t_s(self) -> float:
        return self.reference.t_s


class VelocityAgreement:
    """Checks the positions of one source against its own velocity.

    Within a fifth of a second the velocity accounts for any movement: a position that steps by more
    than MOST_APART_M besides it was corrected, relayed wrongly, or belongs to another vehicle. No
    second source is needed.
    """

    def __init__(self) -> None:
        self._steps: deque[tuple[PoseSample, Vec3]] = deque()

    def restart(self) -> None:
        """Reset the comparison with the own velocity: its window starts now."""
        self._steps.clear()

    def pose(self, sample: PoseSample) -> Disagreement | None:
        """Add a pose of the source; return a step that its velocity does not explain, or None."""
        steps, t_s = self._steps, sample.t_s
        if steps and t_s <= steps[-1][0].t_s:
            return None
        if steps and t_s - steps[-1][0].t_s > _MOST_GAP_S:
            steps.clear()
        integral_m: Vec3 = (0.0, 0.0, 0.0)
        if steps:
            last, before_m = steps[-1]
            both_m_s = add(last.velocity_ned_m_s, sample.velocity_ned_m_s)
            integral_m = add(before_m, scale(both_m_s, (t_s - last.t_s) / 2.0))
        steps.append((sample, integral_m))
        while len(steps) > 1 and steps[1][0].t_s <= t_s - min(SPANS_S) + 1e-9:
            steps.popleft()
        first, from_m = steps[0]
        moved_m = subtract(sample.pose.position_ned_m, first.pose.position_ned_m)
        own_m = subtract(integral_m, from_m)
        if _on_an_axis(subtract(moved_m, own_m)) <= MOST_APART_M:
            return None
        message = f"it moved {norm(moved_m):.2f} m within {t_s - first.t_s:.2f} s"
        message += f", by its own velocity {norm(own_m):.2f} m"
        return Disagreement(t_s, f"{message}; the limit is {MOST_APART_M:.2f} m on each axis")


class StandingStill:
    """Checks that a vehicle does not move by another source while its rounded positions repeat.

    A hovering vehicle may have the same rounded position for seconds. If its estimate is
    MOST_APART_M away from where it was, the vehicle is flown back by it: the longest of SPANS_S
    later it is no longer there, even if only the estimate has stepped.
    """

    def __init__(self) -> None:
        self._place: PoseSample | None = None
        self._until_s = -math.inf
        self._then: dict[str, ReferenceSample] = {}
        self._away_s: dict[str, float] = {}

    def restart(self) -> None:
        """Reset the check: forget the repeated position."""
        self._place, self._until_s = None, -math.inf
        self._forget()

    def pose(self, sample: PoseSample, *, may_stand: bool = False) -> None:
        """Add a judged pose.

        may_stand: at the height of the ground, in takeoff or landing. There an attitude that
        changes is that of a vehicle which stands, in a source that is alive.
        """
        place = self._place
        if place is None or place.pose.position_ned_m != sample.pose.position_ned_m:
            is_new = True
        else:
            is_new = may_stand and place.pose.q_wxyz != sample.pose.q_wxyz
        if is_new:
            self._place = sample
            self._forget()
        self._until_s = max(self._until_s, sample.t_s)

    def reference(self, sample: ReferenceSample) -> Disagreement | None:
        """Add a position of another source; return its movement while the judged ones repeat."""
        place = self._place
        if place is None or sample.t_s < place.t_s:
            return None
        then = self._then.setdefault(sample.source, sample)
        moved_m = norm(subtract(sample.position_ned_m, then.position_ned_m))
        if moved_m <= MOST_APART_M:
            self._away_s.pop(sample.source, None)
            return None
        away_s = self._away_s.setdefault(sample.source, sample.t_s)
        if min(sample.t_s, self._until_s) - away_s < max(SPANS_S):
            return None
        message = f"it repeats one place for {sample.t_s - place.t_s:.2f} s, while {sample.source}"
        return Disagreement(sample.t_s, f"{message} moved {moved_m:.2f} m")

    def _forget(self) -> None:
        self._then.clear()
        self._away_s.clear()


def _on_an_axis(apart_m: Vec3) -> float:
    """Return the largest disagreement on any axis, metres."""
    return max(map(abs, apart_m))
