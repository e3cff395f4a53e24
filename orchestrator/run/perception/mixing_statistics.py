"""Statistics of one mixing loop: rate, skew, latency, registration error."""

from array import array

from wil_campaign.orchestrator.run_results.run_result import Percentiles, percentiles


class FigureSamples:
    """Samples of a mixing figure for percentiles; grows by eight bytes each."""

    def __init__(self) -> None:
        self._values = array("d")

    def add(self, value: float) -> None:
        """Add a value to the mixing statistics' samples."""
        self._values.append(value)

    @property
    def last(self) -> float | None:
        """Return the newest sample."""
        return self._values[-1] if self._values else None

    def percentiles(self) -> Percentiles:
        """Return the percentiles of all samples so far."""
        return percentiles(self._values)


class MixingStatistics:
    """Statistics of mixed readings: rate, skew, latency, registration error.

    replaced: readings that newer ones replaced before they were mixed. missed: readings that were
    not mixed because the twin's source returned no image in time; last_miss: the reason of the
    newest. unbounded: why the registration error of some mixtures has no bound; empty if all have
    one. The mixer counts what it drops itself.
    """

    def __init__(self) -> None:
        self.frames = 0
        self.replaced = 0
        self.missed = 0
        self.last_miss = ""
        self.unbounded = ""
        self.skew_ms = FigureSamples()
        self.latency_ms = FigureSamples()
        self.registration_error_px = FigureSamples()
        self.registration_bound_px = FigureSamples()
        self._first_s: float | None = None
        self._last_s: float | None = None

    def delivered(self, t_s: float) -> None:
        """Count a mixed reading delivered at t_s."""
        self.frames += 1
        if self._first_s is None:
            self._first_s = t_s
        self._last_s = t_s

    def miss(self, reason: str) -> None:
        """Count a reading that was not mixed."""
        self.missed += 1
        self.last_miss = reason

    @property
    def last_delivery_s(self) -> float | None:
        """Return when the newest mixed reading was delivered."""
        return self._last_s

    @property
    def rate_hz(self) -> float | None:
        """Return the mean rate of mixed deliveries; None below two readings."""
        if self._first_s is None or self._last_s is None or self._last_s <= self._first_s:
            return None
        return (self.frames - 1) / (self._last_s - self._first_s)
