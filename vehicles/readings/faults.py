"""Faults of readings: a kind to count by and a message; and checks that several types share."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

FaultKind = Literal[
    "time",
    "backwards",
    "shape",
    "type",
    "intrinsics",
    "not_finite",
    "negative",
    "out_of_range",
    "empty",
    "changed",
]
"""time: a stamp that is not finite, or delivery before sampling. backwards: not newer than the last
one. changed: size, intrinsics or kind differ from the last one."""


@dataclass(frozen=True, slots=True)
class ReadingFault:
    """A fault of a reading: a kind to count by, and a message."""

    kind: FaultKind
    detail: str


def array_fault(
    array: NDArray[Any], shape: tuple[int | None, ...], dtype: type, name: str
) -> ReadingFault | None:
    """Check type and shape of a reading's array; return its fault or None. None: any length."""
    if array.dtype != dtype:
        return ReadingFault("type", f"{name} is {array.dtype}, not {np.dtype(dtype)}")
    fits = len(array.shape) == len(shape) and all(
        wanted is None or wanted == found for wanted, found in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = tuple("any" if length is None else length for length in shape)
        return ReadingFault("shape", f"{name} is {array.shape}, not {wanted}")
    return None


def object_ids_fault(
    object_ids: NDArray[Any] | None, shape: tuple[int, ...]
) -> ReadingFault | None:
    """Check a reading's object ids, where it has them; return their fault or None."""
    return None if object_ids is None else array_fault(object_ids, shape, np.uint8, "object ids")


def distances_fault(values_m: NDArray[np.float32], name: str) -> ReadingFault | None:
    """Check a reading's distances: zero or more; infinity for no hit."""
    smallest = float(values_m.min())  # NaN wins over every number
    if math.isnan(smallest):
        bad = int(np.isnan(values_m).sum())
        return ReadingFault(
            "not_finite", f"{bad} of {values_m.size} {name} values are not a number"
        )
    if smallest < 0.0:
        return ReadingFault("negative", f"a {name} of {smallest} m")
    return None


def are_reading_numbers_finite(numbers: Iterable[float]) -> bool:
    """Return whether all of a reading's numbers are finite."""
    return all(math.isfinite(number) for number in numbers)
