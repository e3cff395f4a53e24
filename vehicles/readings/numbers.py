"""Readings that are numbers alone: checked, recorded and compared without code of their own."""

import dataclasses
import typing

_STAMPS = frozenset({"t_s", "arrived_s", "seq", "source", "sensor"})
"""What every reading has."""


def is_numbers(kind: type) -> bool:
    """Return whether a class of readings has numbers beside its stamps, and nothing else."""
    return bool(_hints(kind)) and all(hint in {float, int} for hint in _hints(kind).values())


def number_fields(kind: type) -> dict[str, type[float] | type[int]]:
    """Return the numbers of a class of readings: names and types, in the order of its fields.

    Raises TypeError for a class that has more: it needs a check, a message and a decoder.
    """
    if not is_numbers(kind):
        raise TypeError(f"{kind.__name__} has more than numbers, or none")
    return _hints(kind)


_HINTS: dict[type, dict[str, type]] = {}
"""By class: types are looked up once, readings come hundreds of times a second."""


def _hints(kind: type) -> dict[str, type]:
    if kind not in _HINTS:
        hints = typing.get_type_hints(kind)
        names = [field.name for field in dataclasses.fields(kind)]
        _HINTS[kind] = {name: hints[name] for name in names if name not in _STAMPS}
    return _HINTS[kind]
