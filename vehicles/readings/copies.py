"""Copies of readings: with arrays of their own, or with other times."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from vehicles.readings.kinds import Reading
from vehicles.readings.navigation import PoseReading


def copied(reading: Reading) -> Reading:
    """Return the reading with arrays of its own, so that writes into them affect no other user."""
    arrays: dict[str, Any] = {
        field.name: value.copy()
        for field in fields(reading)
        if isinstance(value := getattr(reading, field.name), np.ndarray)
    }
    return replace(reading, **arrays) if arrays else reading


def restamp_reading(last: Reading, new: Reading) -> Reading:
    """Return a reading with the times and number of another of its sensor."""
    return replace(last, t_s=new.t_s, arrived_s=new.arrived_s, seq=new.seq)


def restamp_pose(last: PoseReading, new: PoseReading) -> PoseReading:
    """Return a pose with the times and number of another."""
    return replace(last, t_s=new.t_s, arrived_s=new.arrived_s, seq=new.seq)
