"""Correction of p values for multiple tests; pure."""

from collections.abc import Sequence


def holm_corrected(p_values: Sequence[float]) -> list[float]:
    """Return p values corrected for their number: Holm, Scandinavian J. of Statistics 6 (1979)."""
    order = sorted(range(len(p_values)), key=lambda index: p_values[index])
    found, largest = [1.0] * len(p_values), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, (len(p_values) - rank) * p_values[index])
        found[index] = min(1.0, largest)
    return found
