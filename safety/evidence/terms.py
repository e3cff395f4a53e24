"""What is expected of a signal: from where it comes, how often, and for how long."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from safety.evidence.agreement import Accuracy
from safety.oracles.oracle_terms import FLIGHT, Window

MOST_GAP_S = 0.5
"""The longest gap that is accepted of a position while the vehicle is armed, unless declared."""
GAP_PERIODS = 3.0
"""Two samples may be lost in a row; a third means that the source is not what it says."""
STAMP_S = 0.002
"""Stamps are whole milliseconds (time_boot_ms), at either end of a gap."""

SILENCE_S = 1.5
"""After how long without a byte a driver takes a vehicle for silent; its reports are no quicker."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalTerms:
    """The evidence terms of one signal of one vehicle: rates, gaps, whether required.

    signal, source: as results name them ("pose", "mocap"). limit_s: the longest gap that is
    accepted. required: whether a required oracle rests on it: else its INVALID is only reported.
    over_link: it arrives over the vehicle's link, and is silent when that is. on_grid: its places
    and velocities are rounded, so that a hovering vehicle's may repeat; its attitudes are not.
    accuracy: of a pose, references: other sources of the same, by their names; with both they are
    compared.
    """

    signal: str
    vehicle: str
    source: str
    limit_s: float
    required: bool
    over_link: bool = False
    on_grid: bool = False
    window: Window = FLIGHT
    accuracy: Accuracy | None = None
    references: Mapping[str, Accuracy] = field(default_factory=dict)


def position_limit_s(rate_hz: float, *, judged_every_s: float = 0.0) -> float:
    """Return the evidence terms' longest accepted gap between positions of a source.

    judged_every_s: the least time between two that are judged: a source that is quicker is
    thinned to its first sample after that time.
    """
    period_s = 1.0 / rate_hz
    judged_s = period_s * max(1.0, math.ceil(judged_every_s / period_s))
    return min(GAP_PERIODS * judged_s + STAMP_S, MOST_GAP_S)


def status_limit_s(rate_hz: float) -> float:
    """Return the evidence terms' longest accepted gap between a vehicle's status reports."""
    return max(GAP_PERIODS / rate_hz, SILENCE_S)
