"""Readings that consist of numbers alone: found by their type hints, and handled generically."""

import dataclasses
import typing

from wil_campaign.vehicles.readings.images import Source

_STAMPS = frozenset({"t_s", "arrived_s", "seq", "source", "sensor"})
"""The fields that every reading has."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class NumbersReading:
    """The base of the readings of a plugin's sensors, which are numbers: floats and integers.

    They are checked, mixed, recorded and read back by the names of their fields, which say the
    unit. Its stamps are those of every reading.
    """

    t_s: float
    arrived_s: float
    seq: int
    source: Source
    sensor: str = ""


def is_numbers_reading(kind: type) -> bool:
    """Return whether a class of readings has numbers beside its stamps, and nothing else."""
    hints = _hints(kind).values()
    return bool(hints) and all(hint in {float, int} for hint in hints)


def number_fields_of_reading(kind: type) -> dict[str, type[float] | type[int]]:
    """Return the numbers of a class of readings: names and types, in the order of its fields.

    Raises TypeError for a class that has other fields: it needs a check, a message and a decoder.
    """
    if not is_numbers_reading(kind):
        raise TypeError(f"{kind.__name__} has other fields than numbers, or none")
    return _hints(kind)


_HINTS: dict[type, dict[str, type]] = {}
"""By class: types are looked up once, readings come hundreds of times a second."""


def _hints(kind: type) -> dict[str, type]:
    if kind not in _HINTS:
        hints = typing.get_type_hints(kind)
        names = [field.name for field in dataclasses.fields(kind)]
        _HINTS[kind] = {name: hints[name] for name in names if name not in _STAMPS}
    return _HINTS[kind]
