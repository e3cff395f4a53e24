"""Delays from takeoff command to liftoff, learned over the runs of a campaign; pure."""

import statistics
from collections import deque
from collections.abc import Iterable, Mapping

_KEPT = 5
"""The median of so many is used, so that one delayed takeoff has no effect."""
_LONGEST_S = 5.0
"""Autopilots disarm a vehicle that stands armed for 10 s (COM_DISARM_PRFLT, DISARM_DELAY)."""


class LiftoffDelays:
    """The measured delays of a campaign's vehicles, by key."""

    def __init__(self) -> None:
        self._measured: dict[str, deque[float]] = {}

    def record(self, key: str, delay_s: float) -> None:
        """Add a delay that a run measured."""
        self._measured.setdefault(key, deque(maxlen=_KEPT)).append(delay_s)

    def of(self, key: str) -> float | None:
        """Return the delay of a vehicle; None before it has flown."""
        measured = self._measured.get(key)
        return statistics.median(measured) if measured else None


def takeoff_staggers_s(delays_s: Mapping[str, float], names: Iterable[str]) -> dict[str, float]:
    """Return how long to delay each vehicle's takeoff command: the slowest one's not at all.

    delays_s: from command to liftoff, by name.
    """
    taking_off = tuple(names)
    longest_s = max((delays_s.get(name, 0.0) for name in taking_off), default=0.0)
    return {
        name: min(longest_s - delays_s.get(name, 0.0), _LONGEST_S) if name in delays_s else 0.0
        for name in taking_off
    }
