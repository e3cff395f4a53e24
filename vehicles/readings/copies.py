"""Copies of readings: with arrays of their own, with Python's numbers, or with other times."""

from dataclasses import fields, is_dataclass, replace
from typing import Any, get_type_hints

import numpy as np

from wil_campaign.vehicles.readings.kinds import Reading
from wil_campaign.vehicles.readings.navigation import PoseReading


def copied_reading(reading: Reading) -> Reading:
    """Return the reading with arrays of its own, so that writes into them affect no other user."""
    arrays: dict[str, Any] = {
        field.name: value.copy()
        for field in fields(reading)
        if isinstance(value := getattr(reading, field.name), np.ndarray)
    }
    return replace(reading, **arrays) if arrays else reading


def with_python_numbers(reading: Reading) -> Reading:
    """Return the reading with Python's numbers and tuples where it has NumPy's or lists.

    Its arrays stay arrays. NumPy's float32 and integers are numbers for a step of the user's, but
    not for JSON.
    """
    plain: Reading = _plain_dataclass(reading)
    return plain


def _plain_dataclass(value: Any) -> Any:
    """Return a reading, pose or camera model with Python's numbers outside of its arrays."""
    changed: dict[str, Any] = {}
    for field in fields(value):
        before = getattr(value, field.name)
        if isinstance(before, np.ndarray) and field.name in _array_fields(type(value)):
            continue
        after = _plain(before)
        if after is not before:
            changed[field.name] = after
    return replace(value, **changed) if changed else value


def _plain(value: Any) -> Any:
    """Return a number, tuple, pose or camera model with Python's numbers."""
    if isinstance(value, np.floating):
        return float(value)
    if isinstance(value, np.generic | np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, tuple | list):
        return tuple(map(_plain, value))
    return _plain_dataclass(value) if is_dataclass(value) else value


_ARRAYS: dict[type, frozenset[str]] = {}
"""By class: types are looked up once."""


def _array_fields(kind: type) -> frozenset[str]:
    if kind not in _ARRAYS:
        hints = get_type_hints(kind).items()
        _ARRAYS[kind] = frozenset(name for name, hint in hints if "ndarray" in str(hint))
    return _ARRAYS[kind]


def restamp_reading(last: Reading, new: Reading) -> Reading:
    """Return a reading with the times and number of another of its sensor."""
    return replace(last, t_s=new.t_s, arrived_s=new.arrived_s, seq=new.seq)


def restamp_pose(last: PoseReading, new: PoseReading) -> PoseReading:
    """Return a pose with the times and number of another."""
    return replace(last, t_s=new.t_s, arrived_s=new.arrived_s, seq=new.seq)
