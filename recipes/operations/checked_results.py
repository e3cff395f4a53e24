"""Checks of what steps of others return: those of users (`use`), and those of their plugins."""

from dataclasses import replace
from typing import Any

import numpy as np

from wil_campaign.recipes.operations.masks import KEPT
from wil_campaign.recipes.working import AnyMasked, Masked, element_shape
from wil_campaign.vehicles.readings import Mask, Reading, sensor_type_of
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.readings.copies import copied_reading, with_python_numbers


class BadResultError(TypeError):
    """A step of others returned no reading, or an invalid one."""


def checked_side(made: Any, work: AnyMasked, kind: str) -> AnyMasked:
    """Return what a step made of a side; a reading alone keeps the mask. Raises BadResultError.

    kind: the sensor type that it has to be.
    """
    if isinstance(made, Reading):
        made = Masked(made, work.mask)
    if not isinstance(made, Masked):
        raise BadResultError(f"returned {type(made).__name__}, not a reading or a Masked")
    reading = _checked_result(made.reading, kind)
    return Masked(reading, None if made.mask is None else _checked_mask(made.mask, reading))


def checked_merge(made: Any, kind: str) -> Reading:
    """Return what a merge made. kind: the sensor type that it has to be. Raises BadResultError."""
    if not isinstance(made, Reading):
        raise BadResultError(f"returned {type(made).__name__}, not a reading")
    return _checked_result(made, kind)


def copied_side(work: AnyMasked) -> AnyMasked:
    """Return a copy of a side: a step of others may write into what the recording waits for."""
    return Masked(copied_reading(work.reading), None if work.mask is None else work.mask.copy())


def _checked_mask(made: Any, reading: Reading) -> Mask:
    """Return the mask of a step of others as ours: its own bytes, 255 kept and 0 not.

    OpenCV reads numbers of another type as other pixels, and ends the process at a bool. Raises
    BadResultError.
    """
    if not isinstance(made, np.ndarray) or made.dtype not in (np.bool_, np.uint8):
        kind = f"{made.dtype}" if isinstance(made, np.ndarray) else f"{type(made).__name__}"
        raise BadResultError(f"returned a mask of {kind}, not of bool, or uint8 with 255 for kept")
    if made.shape != element_shape(reading):
        raise BadResultError(f"returned a mask of {made.shape}, not {element_shape(reading)}")
    return np.where(made, KEPT, 0).astype(np.uint8) if made.dtype == np.bool_ else made.copy()


def _checked_result(made: Any, kind: str) -> Reading:
    """Return the result of a step of others as a reading that shares no buffer with the step.

    Raises BadResultError for one that is no valid reading of this sensor type.
    """
    if sensor_type_of(made) != kind:
        raise BadResultError(f"returned a {sensor_type_of(made)} reading of a {kind} one")
    reading = copied_reading(with_python_numbers(made))
    # The mixer sets the time of delivery.
    fault = reading_fault(replace(reading, arrived_s=reading.t_s))
    if fault is not None:
        raise BadResultError(f"returned a bad reading: {fault.detail}")
    return reading
