"""Checks the heading of an estimate by which a vehicle's frame was anchored; pure."""

import math
from collections import deque
from collections.abc import Mapping

from wil_campaign.safety.evidence.agreement import SIGMAS, Accuracy, Disagreement
from wil_campaign.safety.model.samples import HeadingSample, PoseSample, ReferenceSample
from wil_campaign.worlds.frames import heading_of, wrap_pi

_KEPT_S = 3.0
_STAMPS_S = 0.1
"""By how much the mapped times of two sources may differ."""


class HeadingAgreement:
    """Checks that an estimated heading agrees with other sources within SIGMAS of what all state.

    An estimate's frame is anchored by its heading on the ground. One that is wrong there, and
    corrected in flight, leaves the frame turned, and with it fence and judgement; one that becomes
    wrong in flight looks the same. Both headings, then and now, have the estimate's accuracy.

    accuracy: of the estimate. references: of other sources of its pose.
    """

    def __init__(self, accuracy: Accuracy, references: Mapping[str, Accuracy]) -> None:
        self._stated_rad = math.sqrt(2.0) * accuracy.attitude_rad
        self._references = references
        self._judged: deque[tuple[float, float]] = deque()
        self._waiting: deque[ReferenceSample] = deque()
        self.sources: dict[str, None] = {}
        """The sources with which the heading was compared."""

    def pose(self, sample: PoseSample) -> Disagreement | None:
        """Add a judged pose; return a disagreement with a reference of its time, or None."""
        self._judged.append((sample.t_s, sample.pose.yaw_rad))
        while self._judged[0][0] < sample.t_s - _KEPT_S:
            self._judged.popleft()
        found: Disagreement | None = None
        while self._waiting and self._waiting[0].t_s + _STAMPS_S <= sample.t_s:
            found = self._compare(self._waiting.popleft()) or found
        return found

    def reference(self, sample: ReferenceSample) -> None:
        """Add another source's pose of the vehicle."""
        if sample.q_wxyz is not None:
            self._waiting.append(sample)

    def heading(self, sample: HeadingSample) -> Disagreement | None:
        """Add a comparison with another source of headings; return a disagreement, or None."""
        self.sources[sample.source] = None
        return self._disagreement(sample.t_s, sample.turned_rad, sample.source, sample.accuracy_rad)

    def _compare(self, reference: ReferenceSample) -> Disagreement | None:
        other, t_s = self._references.get(reference.source), reference.t_s
        if other is None or reference.q_wxyz is None:
            return None
        heading_rad = heading_of(reference.q_wxyz)
        # Their stamps may go back: a source that steps in time is compared all the same.
        turned = [
            wrap_pi(one - heading_rad) for at_s, one in self._judged if abs(at_s - t_s) <= _STAMPS_S
        ]
        if not turned:
            return None
        nearest_rad = min(turned, key=abs)
        return self._disagreement(t_s, nearest_rad, reference.source, other.attitude_rad)

    def _disagreement(
        self, t_s: float, turned_rad: float, source: str, accuracy_rad: float
    ) -> Disagreement | None:
        limit_rad = SIGMAS * math.hypot(self._stated_rad, accuracy_rad)
        if abs(turned_rad) <= limit_rad:
            return None
        message = f"its heading is turned by {math.degrees(abs(turned_rad)):.1f} deg from where"
        message += f" {source} had it, and its frame was anchored by its heading"
        return Disagreement(t_s, f"{message}; the limit is {math.degrees(limit_rad):.1f} deg")
