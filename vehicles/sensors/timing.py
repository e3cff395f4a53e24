"""A sensor's timing: when it samples, and when its readings arrive; pure."""

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Timing:
    """A sensor's timing: samples at start_s + k / rate_hz, late by latency_s +- jitter_s.

    jitter_s is a standard deviation; nothing is delivered before it was sampled. Raises
    ValueError for a rate that is not positive or a negative latency or jitter.
    """

    rate_hz: float
    latency_s: float = 0.0
    jitter_s: float = 0.0
    start_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz < math.inf:
            raise ValueError(
                f"rate_hz is {self.rate_hz}: a sensor's rate must be positive and finite"
            )
        if not (0.0 <= self.latency_s < math.inf and 0.0 <= self.jitter_s < math.inf):
            raise ValueError(
                f"latency_s is {self.latency_s} and jitter_s {self.jitter_s}: give 0 or more"
            )

    def time_of(self, index: int) -> float:
        """Return the run-clock time of sample `index`."""
        return self.start_s + index / self.rate_hz

    def index_after(self, t_s: float) -> int:
        """Return the index of the first sample later than t_s; 0 or more."""
        index = max(0, math.floor((t_s - self.start_s) * self.rate_hz))
        while self.time_of(index) <= t_s:
            index += 1
        while index > 0 and self.time_of(index - 1) > t_s:
            index -= 1
        return index

    def between(self, after_s: float, until_s: float) -> range:
        """Return the sample indices later than after_s, up to and including until_s."""
        return range(self.index_after(after_s), self.index_after(until_s))

    def arrival_s(self, t_s: float, rng: np.random.Generator) -> float:
        """Return when the sample of t_s is delivered; draws only where there is jitter."""
        if self.jitter_s == 0.0:
            return t_s + self.latency_s
        return t_s + max(0.0, self.latency_s + self.jitter_s * float(rng.standard_normal()))
