"""Range and size of a gate, from how its image grows while the vehicle flies towards it."""

from dataclasses import dataclass

ASSUMED_WIDTH_M = 0.75
"""Between the gates of the paper (0.5 and 1.0 m); used until the growth gives the size."""

MIN_TRAVEL_M = 0.5
MIN_SAMPLES = 5
WIDTHS_M = (0.2, 4.0)
"""Least and greatest plausible width."""


@dataclass(frozen=True, slots=True)
class GateRange:
    """The range of the gate ahead and the width of its opening; metres."""

    along_m: float
    width_m: float


class Looming:
    """The gate's range from its growth: a line fit of 1 / width = (gate - vehicle) / size.

    Least squares over (way ahead, inverse of the width as a slope). The nearer the gate, the finer
    a pixel: the weight of a sample is the fourth power of the width.
    """

    def __init__(self) -> None:
        self._sums = (0.0, 0.0, 0.0, 0.0, 0.0)
        self._count = 0
        self._first_m = self._last_m = 0.0

    def add(self, along_m: float, width: float) -> None:
        """Add a measured width of the gate's opening (a slope) from a place along the way."""
        inverse, weight = 1.0 / width, width**4
        one, s, ss, y, sy = self._sums
        self._sums = (
            one + weight,
            s + weight * along_m,
            ss + weight * along_m * along_m,
            y + weight * inverse,
            sy + weight * along_m * inverse,
        )
        self._first_m = along_m if self._count == 0 else min(self._first_m, along_m)
        self._last_m = along_m if self._count == 0 else max(self._last_m, along_m)
        self._count += 1

    def fit(self) -> GateRange | None:
        """Return range and width of the gate; None with too few samples or an implausible fit."""
        if self._count < MIN_SAMPLES or self._last_m - self._first_m < MIN_TRAVEL_M:
            return None
        one, s, ss, y, sy = self._sums
        spread = one * ss - s * s
        if spread <= 0.0:
            return None
        per_m = (one * sy - s * y) / spread
        if not per_m < -1.0 / WIDTHS_M[1] or not per_m > -1.0 / WIDTHS_M[0]:
            return None
        at_start = (y - per_m * s) / one
        return GateRange(-at_start / per_m, -1.0 / per_m)
