"""The expectations of a signal: its source, its longest gap, its window."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from wil_campaign.safety.evidence.agreement import SourceAccuracy
from wil_campaign.safety.oracles.oracle_terms import FLIGHT, StageWindow

MOST_GAP_S = 0.5
"""The longest accepted gap between positions in flight, unless the campaign declares another."""
GAP_PERIODS = 3.0
"""Two samples in a row may be lost; with a third the source has not its stated rate."""
STAMP_S = 0.002
"""Rounding of a gap: the stamps at both ends are whole milliseconds (time_boot_ms)."""

SILENCE_S = 1.5
"""After how long without a byte a driver reports a vehicle as silent; reports may be as slow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalTerms:
    """The evidence terms of one signal of one vehicle: rates, gaps, whether required.

    signal, source: as results name them ("pose", "mocap"). limit_s: the longest accepted gap.
    required: whether a required oracle depends on it; else its INVALID is only reported. over_link:
    it arrives over the vehicle's link, and is silent when the link is. on_grid: its positions and
    velocities are rounded, so that those of a hovering vehicle may repeat; attitudes are not.
    by_estimate: it is the autopilot's own estimate, so that its heading is evidence too, and what
    holds its position. permits_dead_reckoning: a position that nothing holds is a caveat only.
    accuracy: of the pose; references: accuracies of other sources by name, to compare with.
    """

    signal: str
    vehicle: str
    source: str
    limit_s: float
    required: bool
    over_link: bool = False
    on_grid: bool = False
    by_estimate: bool = False
    permits_dead_reckoning: bool = False
    window: StageWindow = FLIGHT
    accuracy: SourceAccuracy | None = None
    references: Mapping[str, SourceAccuracy] = field(default_factory=dict)


def position_limit_s(rate_hz: float, *, judged_every_s: float = 0.0) -> float:
    """Return the evidence terms' longest accepted gap between positions of a source.

    judged_every_s: the least time between two judged samples: of a faster source only the first
    sample after that time is judged.
    """
    period_s = 1.0 / rate_hz
    judged_s = period_s * max(1.0, math.ceil(judged_every_s / period_s))
    return min(GAP_PERIODS * judged_s + STAMP_S, MOST_GAP_S)


def status_limit_s(rate_hz: float) -> float:
    """Return the evidence terms' longest accepted gap between a vehicle's status reports.

    Their times are those of their arrival: by half a period the link may delay the one that ends a
    gap of two lost ones, and no gap of three is as short.
    """
    return max((GAP_PERIODS + 0.5) / rate_hz, SILENCE_S)
