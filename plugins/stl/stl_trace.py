"""Records the values of a formula's signals over its window."""

import math
from array import array

import numpy as np

from wil_campaign.plugins.stl.steps import Values

FIRST_WITHIN_S = 0.5
"""A first value that comes this soon after the window opened counts from its opening on."""
_LATE_S = 1e-6
"""How long after the last row a sample counts that is older than that row."""


class StlTrace:
    """The recorded STL signals over time: a row whenever one of them has a new value.

    A signal is NaN in the rows before its first value, and while it is reported as unknown.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.times_s = array("d")
        self._rows = {name: array("d") for name in names}
        self._latest = dict.fromkeys(names, math.nan)

    def note(self, name: str, value: float | None) -> None:
        """Set a signal's value, None while unknown; it is in the trace from the next row on."""
        self._latest[name] = math.nan if value is None else value

    def add_row(self, t_s: float) -> None:
        """Add a row of the latest values to the trace.

        A sample that is older than the last row gets its own row just after that: states have the
        time of their arrival, so that poses which a link delays come after them. A sample of the
        same time replaces the row.
        """
        if self.times_s and t_s == self.times_s[-1]:
            for name, row in self._rows.items():
                row[-1] = self._latest[name]
            return
        if self.times_s and t_s < self.times_s[-1]:
            t_s = self.times_s[-1] + _LATE_S
        self.times_s.append(t_s)
        for name, row in self._rows.items():
            row.append(self._latest[name])

    def values(self, first: int = 0) -> dict[str, Values]:
        """Return the trace's values of each signal, one per row from the first asked for on."""
        return {
            name: self._fill_gaps(np.array(row[first:]), first) for name, row in self._rows.items()
        }

    def _fill_gaps(self, row: Values, first: int) -> Values:
        known = np.flatnonzero(~np.isnan(row))
        if known.size and self.times_s[first + known[0]] - self.times_s[0] <= FIRST_WITHIN_S:
            row[: known[0]] = row[known[0]]
        return row
