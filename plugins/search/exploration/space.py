"""The space of a search: parameters, their constraints, and points of the space; pure."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from wil_campaign.plugins.search.exploration.constraints import SpaceConstraint
from wil_campaign.plugins.search.search_part import ParameterValue

Values = Mapping[str, ParameterValue]
"""Values by parameter; one that is missing keeps the campaign's own value."""

_FINE = 3
"""Values are rounded to 10**-3 of the range, so that people can read and type them."""
_MOST_POINTS = 100_000
"""Largest number of points of a finite space that is listed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpaceParameter:
    """A parameter of the search. choices: its values; empty for a number between low and high.

    keys: the dotted keys that it changes. unit: of these, "" for none. steps: number of values that
    a strategy of fixed values uses. own: the campaign's own value; None where it has none.
    """

    name: str
    keys: tuple[str, ...]
    low: float = 0.0
    high: float = 1.0
    is_integer: bool = False
    choices: tuple[ParameterValue, ...] = ()
    steps: int = 5
    unit: str = ""
    own: ParameterValue | None = None

    @property
    def is_number(self) -> bool:
        """Return whether the parameter is a number between limits."""
        return not self.choices

    @property
    def count(self) -> int | None:
        """Return how many values the parameter has; None for a continuous one."""
        if self.choices:
            return len(self.choices)
        return int(self.high) - int(self.low) + 1 if self.is_integer else None

    def at(self, share: float) -> ParameterValue:
        """Return the parameter's value at a share (0 to 1) of its range or of its choices."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.is_integer:
            wide = int(self.high) - int(self.low) + 1
            return int(self.low) + min(int(share * wide), wide - 1)
        return self.rounded(self.low + share * (self.high - self.low))

    def rounded(self, value: float) -> ParameterValue:
        """Return a number rounded to the parameter's resolution, within its limits."""
        if self.is_integer:
            return int(min(max(round(value), self.low), self.high))
        digits = _FINE - math.floor(math.log10(self.high - self.low))
        return min(max(round(value, digits), self.low), self.high)

    def share(self, value: ParameterValue) -> float | None:
        """Return where a value lies, 0 to 1; choices in the middle of a cell.

        None where the parameter has no such value: none of its choices, or outside of its limits.
        """
        if self.choices:
            index = self.choice_index(value)
            return None if index is None else (index + 0.5) / len(self.choices)
        if isinstance(value, str | bool) or not self.low <= value <= self.high:
            return None
        return (float(value) - self.low) / (self.high - self.low)

    def choice_index(self, value: ParameterValue) -> int | None:
        """Return the index of a choice, of which true is not 1; None for another value."""
        for index, choice in enumerate(self.choices):
            if choice == value and isinstance(choice, bool) == isinstance(value, bool):
                return index
        return None

    @property
    def levels(self) -> tuple[ParameterValue, ...]:
        """Return the values of the parameter that a strategy of fixed values uses."""
        if self.choices:
            return self.choices
        count = self.count
        if count is not None and count <= self.steps:
            return tuple(range(int(self.low), int(self.high) + 1))
        shares = [index / (self.steps - 1) for index in range(self.steps)]
        width = self.high - self.low
        return tuple(dict.fromkeys(self.rounded(self.low + share * width) for share in shares))


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchSpace:
    """The space of a search: parameters, and the constraints between them."""

    parameters: tuple[SpaceParameter, ...]
    constraints: tuple[SpaceConstraint, ...] = ()

    def whole(self, values: Values) -> dict[str, ParameterValue | None]:
        """Return the value of each parameter, the campaign's own where none is given."""
        return {
            parameter.name: values.get(parameter.name, parameter.own)
            for parameter in self.parameters
        }

    def text(self, values: Values) -> str:
        """Return values with their units, as text; without one the campaign is as it is."""
        units = {parameter.name: parameter.unit for parameter in self.parameters}
        texts = (f"{name} {value} {units[name]}".rstrip() for name, value in values.items())
        return ", ".join(texts) or "nothing: the case fails as it is"

    def admits(self, values: Values) -> bool:
        """Return whether values keep every constraint."""
        return self.broken_constraint(values) is None

    def broken_constraint(self, values: Values) -> SpaceConstraint | None:
        """Return the first constraint that values break; None where they keep all."""
        whole = self.whole(values)
        return next(
            (constraint for constraint in self.constraints if not constraint.holds(whole)), None
        )

    def at(self, shares: Sequence[float]) -> dict[str, ParameterValue]:
        """Return the values at a point of the unit cube."""
        pairs = zip(self.parameters, shares, strict=True)
        return {parameter.name: parameter.at(share) for parameter, share in pairs}

    def shares(self, values: Values) -> tuple[float, ...] | None:
        """Return the point of the unit cube of values; None where one is unknown or outside."""
        whole = self.whole(values)
        found: list[float] = []
        for parameter in self.parameters:
            value = whole[parameter.name]
            share = None if value is None else parameter.share(value)
            if share is None:
                return None
            found.append(share)
        return tuple(found)

    @property
    def size(self) -> int | None:
        """Return how many points the space has, constraints aside; None for infinitely many."""
        counts = [parameter.count for parameter in self.parameters]
        if any(count is None for count in counts):
            return None
        return math.prod(count for count in counts if count is not None)

    def listed(self) -> list[dict[str, ParameterValue]] | None:
        """Return all admissible points of a small finite space; None for any other space."""
        if self.size is None or self.size > _MOST_POINTS:
            return None
        every = [
            parameter.choices or tuple(range(int(parameter.low), int(parameter.high) + 1))
            for parameter in self.parameters
        ]
        return [point for point in self._points(every) if self.admits(point)]

    def grid(self) -> Iterator[dict[str, ParameterValue]]:
        """Yield the admissible points of the grid of all levels."""
        for point in self._points([parameter.levels for parameter in self.parameters]):
            if self.admits(point):
                yield point

    def _points(
        self, levels: Sequence[tuple[ParameterValue, ...]]
    ) -> Iterator[dict[str, ParameterValue]]:
        names = [parameter.name for parameter in self.parameters]
        for point in itertools.product(*levels):
            yield dict(zip(names, point, strict=True))
