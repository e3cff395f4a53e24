"""Two sources that know where a vehicle is: whether they agree within what they state; pure."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from safety.model.samples import PoseSample, ReferenceSample
from worlds.frames import Vec3, add, norm, scale, subtract

SIGMAS = 5.0
"""By how many standard deviations two honest sources do not differ: once in two million samples."""
SPAN_S = 1.0
"""Over which time displacements are compared."""
_KEPT_S = 3.0
_MOST_GAP_S = 0.3
"""Over a longer silence of the other source its velocity is not integrated."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The accuracy of a position source, one standard deviation on each axis.

    position_m: of where it says that the vehicle is; velocity_m_s: of its velocity, None where
    that is made of its positions.
    """

    position_m: float
    velocity_m_s: float | None = None

    def displacement_m(self, span_s: float) -> float:
        """Return the accuracy of a displacement within a time, metres."""
        by_places_m = math.sqrt(2.0) * self.position_m
        if self.velocity_m_s is None:
            return by_places_m
        return min(by_places_m, self.velocity_m_s * span_s)


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A disagreement of two position sources. at_s: since when; text: how, for people."""

    at_s: float
    text: str


class Agreement:
    """Checks the judged positions for agreement with another source, at the other's times.

    Places are compared, and what both moved within a second: over so short a time an estimate's
    velocity is far more exact than its position. Each difference is held to SIGMAS times what both
    state. Which of the two is wrong nobody knows.
    """

    def __init__(self, *, judged: Accuracy, other: Accuracy, source: str) -> None:
        self._judged = judged
        self._other = other
        self._source = source
        self.count = 0
        """How often the two were compared."""
        self._poses: deque[PoseSample] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self._pairs: deque[tuple[ReferenceSample, Vec3, Vec3]] = deque()

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
        exact_m = SIGMAS * math.hypot(self._judged.position_m, self._other.position_m)
        t_s, source = reference.t_s, self._source
        if _on_an_axis(apart_m) > exact_m:
            said = f"it is {norm(apart_m):.2f} m from where {source} has the vehicle at {t_s:.2f} s"
            yield Disagreement(t_s, f"{said}; both are exact to {exact_m:.2f} m on each axis")
        if self._pairs and t_s - self._pairs[-1][0].t_s > _MOST_GAP_S:
            self._pairs.clear()  # What it did in between, the other does not say.
        integrated_m = self._integrate_velocity(reference)
        self._pairs.append((reference, judged_m, integrated_m))
        while len(self._pairs) > 1 and self._pairs[1][0].t_s <= t_s - SPAN_S + 1e-9:
            self._pairs.popleft()
        first, from_m, integral_m = self._pairs[0]
        span_s = t_s - first.t_s
        if span_s < SPAN_S - 1e-9:
            return
        moved_m = subtract(judged_m, from_m)
        other_m = subtract(integrated_m, integral_m)
        if not self._by_velocity(span_s):
            other_m = subtract(reference.position_ned_m, first.position_ned_m)
        exact_m = SIGMAS * math.hypot(
            math.sqrt(2.0) * self._judged.position_m, self._other.displacement_m(span_s)
        )
        if _on_an_axis(subtract(moved_m, other_m)) > exact_m:
            said = f"it moved {norm(moved_m):.2f} m within {span_s:.2f} s to {t_s:.2f} s"
            said += f", by {source} the vehicle moved {norm(other_m):.2f} m"
            yield Disagreement(t_s, f"{said}; both are exact to {exact_m:.2f} m on each axis")

    def _by_velocity(self, span_s: float) -> bool:
        other = self._other
        return (
            other.velocity_m_s is not None
            and other.velocity_m_s * span_s < math.sqrt(2.0) * other.position_m
        )

    def _integrate_velocity(self, reference: ReferenceSample) -> Vec3:
        """Return the integral of the other's velocity until now, trapezoidal."""
        if not self._pairs:
            return (0.0, 0.0, 0.0)
        last, _, before_m = self._pairs[-1]
        both_m_s = add(last.velocity_ned_m_s, reference.velocity_ned_m_s)
        return add(before_m, scale(both_m_s, (reference.t_s - last.t_s) / 2.0))

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


def _on_an_axis(apart_m: Vec3) -> float:
    """Return the largest disagreement on any axis, metres."""
    return max(map(abs, apart_m))
