"""Readings of one sensor as arrays: a column for each field, a row for each reading."""

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import Reading
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

Arrays = dict[str, NDArray[Any]]


def arrays_of(readings: Iterable[Reading]) -> Arrays:
    """Return readings of one sensor by their fields, with the units and axes that these have.

    A number is (n,), a vector (n, 3), an image (n, height, width, ...). A pose of name `pose` is
    `pose_position_m` (n, 3) and `pose_q_wxyz` (n, 4), in its parent frame. A field that differs in
    shape from reading to reading, as points do, or that some lack, is (n,) of arrays or None. What
    no reading has is left out, and so are `source`, `sensor` and the intrinsics of images.
    """
    rows = [dict(_values(reading)) for reading in readings]
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: _stacked([row.get(name) for row in rows]) for name in names}


def _values(reading: Reading) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a reading that are numbers, vectors or arrays."""
    for field in dataclasses.fields(reading):
        value = getattr(reading, field.name)
        if isinstance(value, Pose):
            yield f"{field.name}_position_m", value.position_ned_m
            yield f"{field.name}_q_wxyz", value.q_wxyz
        elif value is not None and not isinstance(value, str | Intrinsics):
            yield field.name, value


def _stacked(values: list[Any]) -> NDArray[Any]:
    arrays = [None if value is None else np.asarray(value) for value in values]
    shapes = {None if array is None else array.shape for array in arrays}
    if len(shapes) == 1:
        return np.stack([array for array in arrays if array is not None])
    found = np.empty(len(arrays), dtype=object)
    found[:] = arrays
    return found
