"""Curves of plots: broken where there is no value, and shortened to what a plot can show; pure."""

import itertools
import math
from collections.abc import Iterable, Sequence
from operator import itemgetter
from statistics import median

from wil_campaign.orchestrator.report.model import PlotCurve, Point

_MOST_POINTS = 500
_GAP_S = 0.2
_GAP_STEPS = 5.0

Stretch = Sequence[Point]


def longest_step_s(times: Sequence[float]) -> float:
    """Return the longest step of times that is no gap: five usual ones, at least 0.2 s."""
    steps = [later - earlier for earlier, later in itertools.pairwise(times)]
    return max(_GAP_S, _GAP_STEPS * median(steps)) if steps else _GAP_S


def curve_of(
    subject: str, values: Sequence[tuple[float, float | None]], *, keep_s: float | None = None
) -> PlotCurve:
    """Return the curve of values with their times in order; None: there is no value.

    It is broken where there is none, and at gaps. Of many points the least and largest of each part
    are kept. keep_s: the last point up to this time stays too.
    """
    stretches = _stretches(values)
    kept = None
    if keep_s is not None:
        times = (t_s for stretch in stretches for t_s, _ in stretch if t_s <= keep_s)
        kept = max(times, default=None)
    return PlotCurve(subject, tuple(tuple(one) for one in _shortened(stretches, kept)))


def _stretches(values: Sequence[tuple[float, float | None]]) -> list[list[Point]]:
    """Return the unbroken parts of a curve; a gap that is too narrow to be seen breaks none."""
    if not values:
        return []
    longest_s = longest_step_s([t_s for t_s, _ in values])
    unseen_s = (values[-1][0] - values[0][0]) / _MOST_POINTS
    found: list[list[Point]] = []
    is_missing = False
    for t_s, value in values:
        if value is None or not math.isfinite(value):
            is_missing = True
            continue
        step_s = t_s - found[-1][-1][0] if found else math.inf
        if step_s > unseen_s and (is_missing or step_s > longest_s):
            found.append([])
        found[-1].append((t_s, value))
        is_missing = False
    return found


def _shortened(stretches: Sequence[Stretch], keep_s: float | None) -> Iterable[Stretch]:
    count = sum(map(len, stretches))
    if count <= _MOST_POINTS:
        return stretches
    size = math.ceil(2 * count / _MOST_POINTS)
    return [_least_and_largest(stretch, size, keep_s) for stretch in stretches]


def _least_and_largest(points: Stretch, size: int, keep_s: float | None) -> Stretch:
    """Return the least and largest point of each `size` points; that of keep_s stays too."""
    parts = [points[i : i + size] for i in range(0, len(points), size)]
    kept = {pick(part, key=itemgetter(1)) for part in parts for pick in (min, max)}
    kept |= {point for point in points if point[0] == keep_s}
    return sorted(kept)
