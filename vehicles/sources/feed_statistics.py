"""Statistics of a motion capture feed: rate, latency, dropouts; pure, and bounded in memory."""

import math
from collections import deque
from dataclasses import dataclass

_WINDOW = 2000
"""Samples over which the statistics are taken: 10 s at 200 Hz."""
DROPOUT_PERIODS = 3.0
"""A gap of more than so many periods is a dropout: one lost sample is interpolated over."""


@dataclass(frozen=True, slots=True)
class FeedStatistics:
    """The statistics of a motion capture feed: rate, latency, gaps, counts.

    samples: poses handed on. rate_hz (None before there are two), latency_ms_p50, latency_ms_p99
    (sampling to arrival): over the last samples. missing: frames whose numbers never arrived.
    invalid: the body was not seen. out_of_order: arrived after a newer one, not handed on.
    dropouts: gaps of more than three periods. longest_gap_s: between two poses. restarts: how often
    the sender's clock or its numbers began anew.
    """

    samples: int
    rate_hz: float | None
    latency_ms_p50: float | None
    latency_ms_p99: float | None
    missing: int
    invalid: int
    out_of_order: int
    dropouts: int
    longest_gap_s: float
    restarts: int = 0


class FeedMeter:
    """Measures the statistics of one body's motion capture feed."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=_WINDOW)
        self._latencies: deque[float] = deque(maxlen=_WINDOW)
        self._samples = 0
        self._dropouts = 0
        self._longest_gap_s = 0.0
        self.missing = 0
        self.invalid = 0
        self.out_of_order = 0
        self.restarts = 0

    def add(self, *, t_s: float, arrived_s: float) -> None:
        """Add a delivered pose to the feed's statistics: when sampled, and when arrived."""
        if self._times:
            gap_s = t_s - self._times[-1]
            self._longest_gap_s = max(self._longest_gap_s, gap_s)
            rate_hz = self._rate_hz()
            if rate_hz is not None and gap_s * rate_hz > DROPOUT_PERIODS:
                self._dropouts += 1
        self._samples += 1
        self._times.append(t_s)
        self._latencies.append(arrived_s - t_s)

    def statistics(self) -> FeedStatistics:
        """Return the feed's statistics so far."""
        ordered = sorted(self._latencies)
        return FeedStatistics(
            samples=self._samples,
            rate_hz=self._rate_hz(),
            latency_ms_p50=_quantile_ms(ordered, 0.50),
            latency_ms_p99=_quantile_ms(ordered, 0.99),
            missing=self.missing,
            invalid=self.invalid,
            out_of_order=self.out_of_order,
            dropouts=self._dropouts,
            longest_gap_s=self._longest_gap_s,
            restarts=self.restarts,
        )

    def _rate_hz(self) -> float | None:
        if len(self._times) < 2 or self._times[-1] <= self._times[0]:
            return None
        return (len(self._times) - 1) / (self._times[-1] - self._times[0])


def _quantile_ms(ordered: list[float], fraction: float) -> float | None:
    """Return a quantile of the feed's times in milliseconds, by nearest rank; None without any."""
    if not ordered:
        return None
    return 1000.0 * ordered[math.ceil(fraction * len(ordered)) - 1]
