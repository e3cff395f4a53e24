"""Copies of readings: their arrays, and numbers that came from NumPy."""

import dataclasses
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from tests.vehicles.readings.test_readings import ALL, CAMERA
from wil_campaign.vehicles.readings import Reading, sensor_type_of
from wil_campaign.vehicles.readings.copies import copied_reading, with_python_numbers


def with_numpy_numbers(value: Any) -> Any:
    """Return a reading as a step that calculates with NumPy makes it."""
    if isinstance(value, tuple):
        return np.array(value)
    if isinstance(value, bool | int | float):
        return np.array(value)[()]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = {
            field.name: with_numpy_numbers(getattr(value, field.name)) for field in fields(value)
        }
        return replace(value, **parts)
    return value


def assert_plain(found: Any, wanted: Any) -> None:
    if isinstance(wanted, np.ndarray):
        assert found is wanted
        return
    assert type(found) is type(wanted)
    if dataclasses.is_dataclass(wanted):
        for field in fields(wanted):
            assert_plain(getattr(found, field.name), getattr(wanted, field.name))
    elif isinstance(wanted, tuple):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            assert_plain(one, other)
    else:
        assert found == wanted


@pytest.mark.parametrize("reading", ALL, ids=sensor_type_of)
def test_numbers_of_numpy_become_python_s_and_arrays_stay(reading: Reading) -> None:
    assert_plain(with_python_numbers(with_numpy_numbers(reading)), reading)
    assert_plain(with_python_numbers(reading), reading)


def test_a_copy_shares_no_array() -> None:
    copy: Any = copied_reading(CAMERA)
    for name in ("image_bgr", "depth_m", "object_ids"):
        array = getattr(copy, name)
        assert array.flags.writeable
        assert not np.shares_memory(array, getattr(CAMERA, name))
        assert np.array_equal(array, getattr(CAMERA, name))
