"""Turns and steps of judged poses as evidence: other sources explain them; pure."""

import math
from collections import deque
from collections.abc import Mapping

from wil_campaign.safety.evidence.agreement import (
    MOST_APART_M,
    SIGMAS,
    Disagreement,
    SourceAccuracy,
)
from wil_campaign.safety.model.samples import PoseSample, ReferenceSample
from wil_campaign.worlds.frames import Quat, angle_between, norm, subtract

_SPAN_S = 0.6
"""Over at least this time turns are compared: a wrong attitude for two thirds of it is noticed."""
_LONGEST_S = 1.0
_EVERY_S = 0.1
"""Turns are compared so often: it takes a scan of the kept poses."""
_KEPT_S = 3.0
_STAMPS_S = 0.2
"""By how much the times of two sources may differ: an estimate's attitude may come at 5 Hz."""
_LEAST_RAD = math.radians(20.0)
"""A smaller turn is none of a tracker that takes a body's markers for one another."""

_FRESH_S = 0.5
"""The velocity of another source explains a step for so long, also across a gap of the poses."""
_CHANGED_M_S = 5.0
"""By how much a speed may have changed since, by an impact too."""

_At = tuple[float, Quat]


class TurnAgreement:
    """Checks that poses turn no farther than another source says within the same time.

    A tracker that confuses the markers of a symmetrical body, or its axes, has it in its place and
    turned: what is drawn from its pose is elsewhere, and no position shows it. Only the turn is
    compared, as a compass may be wrong; and only where the judged poses turned farther, as the
    heading of an estimate may be corrected in flight.

    accuracy: of the judged poses; references: of other sources of the vehicle's pose.
    """

    def __init__(self, accuracy: SourceAccuracy, references: Mapping[str, SourceAccuracy]) -> None:
        self._accuracy = accuracy
        self._references = references
        self._judged: deque[_At] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self._before: dict[str, deque[_At]] = {}
        self._due_s: dict[str, float] = {}

    def restart(self) -> None:
        """Reset the comparison: its window starts now."""
        self._judged.clear()
        self._waiting.clear()
        self._before.clear()
        self._due_s.clear()

    def pose(self, sample: PoseSample) -> Disagreement | None:
        """Add a judged pose; return a disagreement with a reference of its time, or None."""
        self._judged.append((sample.t_s, sample.pose.q_wxyz))
        while self._judged[0][0] < sample.t_s - _KEPT_S:
            self._judged.popleft()
        found: Disagreement | None = None
        while self._waiting and self._waiting[0].t_s + _STAMPS_S <= sample.t_s:
            found = self._compare(self._waiting.popleft()) or found
        return found

    def reference(self, sample: ReferenceSample) -> None:
        """Add another source's pose of the vehicle."""
        if sample.q_wxyz is None or sample.source not in self._references:
            return
        if sample.t_s >= self._due_s.get(sample.source, -math.inf):
            self._due_s[sample.source] = sample.t_s + _EVERY_S
            self._waiting.append(sample)

    def _compare(self, reference: ReferenceSample) -> Disagreement | None:
        source, t_s, q_wxyz = reference.source, reference.t_s, reference.q_wxyz
        if q_wxyz is None:
            return None
        kept = self._before.setdefault(source, deque())
        kept.append((t_s, q_wxyz))
        while kept[0][0] < t_s - _LONGEST_S:
            kept.popleft()
        before = next((one for one in reversed(kept) if one[0] <= t_s - _SPAN_S), None)
        if before is None:
            return None
        accuracy = self._accuracy.attitude_rad, self._references[source].attitude_rad
        limit_rad = max(_LEAST_RAD, SIGMAS * math.sqrt(2.0) * math.hypot(*accuracy))
        other_rad = angle_between(before[1], q_wxyz)
        turned_rad = self._turned_rad(before[0], t_s, enough_rad=limit_rad + other_rad)
        if turned_rad is None:
            return None
        turned_deg, other_deg, limit_deg = map(math.degrees, (turned_rad, other_rad, limit_rad))
        message = f"by it the vehicle turned by {turned_deg:.0f} deg within {t_s - before[0]:.2f} s"
        message += f", by {source} by {other_deg:.0f} deg; the limit is {limit_deg:.0f} deg"
        return Disagreement(t_s, message)

    def _turned_rad(self, begin_s: float, end_s: float, *, enough_rad: float) -> float | None:
        """Return the least turn between judged poses near two times; None for one not farther."""
        first, last = (
            [q for at_s, q in self._judged if abs(at_s - t_s) <= _STAMPS_S]
            for t_s in (begin_s, end_s)
        )
        least_rad = math.inf
        for turned_rad in (angle_between(one, other) for one in first for other in last):
            if turned_rad <= enough_rad:
                return None
            least_rad = min(least_rad, turned_rad)
        return None if math.isinf(least_rad) else least_rad


class StepAgreement:
    """Checks that no judged position steps by MOST_APART_M beyond what another source's speed says.

    For poses without a velocity of their own: a tracker that takes another body, or a reflection,
    for the vehicle. It is found with the step itself, before an oracle judges the way there.
    """

    def __init__(self) -> None:
        self._last: PoseSample | None = None
        self._other: ReferenceSample | None = None

    def restart(self) -> None:
        """Reset the check: its window starts now."""
        self._last = None

    def reference(self, sample: ReferenceSample) -> None:
        """Add another source's pose of the vehicle."""
        self._other = sample

    def pose(self, sample: PoseSample) -> Disagreement | None:
        """Add a judged pose; return a step beyond another source's speed, or None."""
        last, other, t_s = self._last, self._other, sample.t_s
        self._last = sample
        if last is None or other is None or not 0.0 < t_s - last.t_s <= _FRESH_S:
            return None
        if abs(t_s - other.t_s) > _FRESH_S:
            return None
        moved_m = norm(subtract(sample.pose.position_ned_m, last.pose.position_ned_m))
        speed_m_s = norm(other.velocity_ned_m_s)
        limit_m = MOST_APART_M + (speed_m_s + _CHANGED_M_S) * (t_s - last.t_s)
        if moved_m <= limit_m:
            return None
        message = f"it moved {moved_m:.2f} m within {t_s - last.t_s:.2f} s, and {other.source} has"
        message += f" the vehicle at {speed_m_s:.1f} m/s; the limit is {limit_m:.2f} m"
        # What the way there seems to touch is later.
        return Disagreement(last.t_s, message)
