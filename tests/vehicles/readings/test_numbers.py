"""Readings that are numbers alone: a sensor type needs no check of its own for them."""

import math
from typing import Any

import pytest

from tests.vehicles.readings.thermometer import ThermometerReading
from wil_campaign.vehicles.readings import CameraReading, DepthReading, ImuReading, reading_types
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.vehicles.readings.numbers import is_numbers_reading, number_fields_of_reading


def test_numbers_are_all_but_the_stamps() -> None:
    assert is_numbers_reading(ThermometerReading)
    assert number_fields_of_reading(ThermometerReading) == {
        "temperature_deg_c": float,
        "samples": int,
    }


@pytest.mark.parametrize("kind", reading_types().values())
def test_a_reading_with_more_than_numbers_has_code_of_its_own(kind: type) -> None:
    traits = traits_of(kind)
    has_code = None not in (traits.fault, traits.decode) and (
        traits.encode is not None or kind in (CameraReading, DepthReading)
    )
    assert is_numbers_reading(kind) != has_code


def test_a_reading_with_more_than_numbers_is_refused() -> None:
    with pytest.raises(TypeError, match="ImuReading"):
        number_fields_of_reading(ImuReading)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_a_fault(value: float) -> None:
    good: Any = ThermometerReading(1.0, 1.0, 0, "real", 21.5, 4)
    bad: Any = ThermometerReading(1.0, 1.0, 0, "real", value, 4)
    assert reading_fault(good) is None
    fault = reading_fault(bad)
    assert fault is not None
    assert (fault.kind, fault.detail) == ("not_finite", f"temperature_deg_c is {value}")
