"""Reduction of a failing variant towards the campaign's own values: the order of attempts; pure.

First keys are reset to their own values, many at a time and then one by one (delta debugging,
Zeller and Hildebrandt, IEEE TSE 28, 2002); then each remaining number is moved by bisection.
"""

from collections.abc import Generator, Mapping, Sequence
from typing import TypeGuard

from wil_campaign.plugins.search.exploration.space import SearchSpace, SpaceParameter, Values
from wil_campaign.plugins.search.search_part import ParameterValue

Attempts = Generator[Values, bool, Values]
"""Yields smaller values; receives whether they still fail; returns the smallest that do."""

_HALVINGS = 4


def reduced_variants(space: SearchSpace, values: Values) -> Attempts:
    """Yield smaller variants of failing values, and return the smallest that fails."""
    smallest = dict((yield from _fewer_keys(space, values_without_own(space, values))))
    for parameter in space.parameters:
        if parameter.name in smallest:
            smallest = yield from _nearer(space, parameter, smallest)
    return smallest


def values_without_own(space: SearchSpace, values: Values) -> dict[str, ParameterValue]:
    """Return values without those that are the campaign's own."""
    own = {parameter.name: parameter.own for parameter in space.parameters}
    return {name: value for name, value in values.items() if not _is_same(value, own[name])}


def _fewer_keys(
    space: SearchSpace, values: Mapping[str, ParameterValue]
) -> Generator[Values, bool, Mapping[str, ParameterValue]]:
    """Try to remove keys: first half of them at once, in the end one by one, the last too."""
    size = max(1, len(values) // 2)
    while True:
        is_smaller = False
        for chunk in _chunks(tuple(values), size):
            fewer = {name: value for name, value in values.items() if name not in chunk}
            if fewer != values and space.admits(fewer) and (yield fewer):
                values, is_smaller = fewer, True
        if size > 1:
            size //= 2
        elif not is_smaller:
            return values


def _nearer(
    space: SearchSpace, parameter: SpaceParameter, values: dict[str, ParameterValue]
) -> Generator[Values, bool, dict[str, ParameterValue]]:
    """Try to move a number towards the campaign's own by bisection, as long as it still fails."""
    near, far = parameter.own, values[parameter.name]
    if not (parameter.is_number and _is_number(near) and _is_number(far)):
        return values
    for _ in range(_HALVINGS):
        middle = parameter.rounded((float(near) + float(far)) / 2.0)
        if _is_same(middle, near) or _is_same(middle, far):
            break
        moved = {**values, parameter.name: middle}
        if space.admits(moved) and (yield moved):
            values, far = moved, middle
        else:
            near = middle
    return values


def _chunks(names: Sequence[str], size: int) -> list[frozenset[str]]:
    return [frozenset(names[at : at + size]) for at in range(0, len(names), size)]


def _is_number(value: ParameterValue | None) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_same(one: ParameterValue | None, other: ParameterValue | None) -> bool:
    """Return whether two values are the same in a file: true is not 1, 1 is 1.0."""
    return one == other and isinstance(one, bool) == isinstance(other, bool)
