"""Copies of readings for those who may write into them."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from vehicles.readings.kinds import Reading


def copied(reading: Reading) -> Reading:
    """Return the reading with arrays of its own: who writes into them changes no one else's."""
    arrays: dict[str, Any] = {
        field.name: value.copy()
        for field in fields(reading)
        if isinstance(value := getattr(reading, field.name), np.ndarray)
    }
    return replace(reading, **arrays) if arrays else reading
