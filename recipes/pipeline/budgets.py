"""Budgets of mixing: limits of skew, latency, rate and registration error. Pure.

The mixer itself leaves out, and counts, the overlay of a reading beyond its skew or latency. This
module checks one reading, and the rate over a window; the caller turns a breach into the verdict
INVALID.
"""

from collections import deque
from dataclasses import dataclass

from wil_campaign.recipes.model.recipe import MixingBudget
from wil_campaign.recipes.pipeline.mixture import Provenance
from wil_campaign.worlds.figures import distinct_value_text

_SLACK = 1e-6


@dataclass(frozen=True, slots=True)
class BudgetBreach:
    """An exceeded mixing budget. what: the budget's key in the recipe; limit in the same unit."""

    what: str
    actual: float
    limit: float

    def __str__(self) -> str:
        actual = distinct_value_text(self.actual, self.limit, digits=1).removesuffix(".0")
        return f"{self.what}: {actual}, the limit is {self.limit:g}"


def budget_breach(budget: MixingBudget, provenance: Provenance) -> BudgetBreach | None:
    """Return the first mixing budget that one mixed reading exceeds; None when it exceeds none.

    A missing figure exceeds nothing: the registration error is None by definition where there is
    neither a reference nor a bound.
    """
    error_px = provenance.registration_error_px
    limits = (
        ("max_skew_ms", provenance.skew_ms, budget.max_skew_s * 1000.0),
        ("max_latency_ms", provenance.latency_ms, _ms(budget.max_latency_s)),
        (
            "max_registration_error_px",
            provenance.registration_bound_px if error_px is None else error_px,
            budget.max_registration_error_px,
        ),
    )
    for what, actual, limit in limits:
        if actual is not None and limit is not None and not actual <= limit + _SLACK:
            return BudgetBreach(what, actual, limit)
    return None


class RateWatch:
    """Watches the mixing rate over a sliding window against the budget's least rate.

    window_s: at least five readings long, so that a single lost reading is no breach.
    """

    def __init__(self, budget: MixingBudget, *, window_s: float = 1.0) -> None:
        self._min_rate_hz = budget.min_rate_hz
        self._window_s = max(window_s, 5.0 / budget.min_rate_hz) if budget.min_rate_hz else window_s
        self._started_s: float | None = None
        self._times: deque[float] = deque()

    def start(self, now_s: float) -> None:
        """Start watching the mixing rate; earlier deliveries do not count."""
        self._started_s = now_s
        self._times.clear()

    def delivered(self, t_s: float) -> None:
        """Add the time of a delivered mixture."""
        self._times.append(t_s)

    def breach(self, now_s: float) -> BudgetBreach | None:
        """Return the rate budget's breach once a whole window is watched; None otherwise."""
        if self._min_rate_hz is None or self._started_s is None:
            return None
        begin_s = now_s - self._window_s
        while self._times and self._times[0] <= begin_s:
            self._times.popleft()
        # A window may begin just after a delivery and end just before the next: one may be missing.
        rate_hz = (len(self._times) + 1) / self._window_s
        if begin_s < self._started_s or rate_hz >= self._min_rate_hz - _SLACK:
            return None
        return BudgetBreach("min_rate_hz", len(self._times) / self._window_s, self._min_rate_hz)


def _ms(time_s: float | None) -> float | None:
    """Return a time of a budget in milliseconds; None for None."""
    return None if time_s is None else time_s * 1000.0
