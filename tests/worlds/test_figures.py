"""A value is told from its limit by its text."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.worlds.figures import distinct_value_text


@pytest.mark.parametrize(
    ("value", "limit", "text"),
    [
        (0.5998, 0.6, "0.5998"),
        (0.6, 0.6, "0.60"),
        (0.6000001, 0.6, "0.6000001"),
        (0.213, 0.6, "0.21"),
        (2.013, 2.0, "2.01"),
        (-0.001, 0.0, "-0.001"),
        (math.nan, 1.0, "nan"),
    ],
)
def test_a_value_has_the_digits_that_tell_it_from_its_limit(
    value: float, limit: float, text: str
) -> None:
    assert distinct_value_text(value, limit) == text


numbers = st.floats(-1e6, 1e6)


@given(numbers, numbers)
def test_a_text_is_on_the_same_side_of_the_limit_as_its_value(value: float, limit: float) -> None:
    shown = float(distinct_value_text(value, limit))
    if value != limit:
        assert (shown < limit, shown > limit) == (value < limit, value > limit)
