"""The report's words for numbers, limits and times."""

import pytest

from wil_campaign.orchestrator.report.words import limit_text, number_text, short_time
from wil_campaign.safety.model.oracle_results import OracleResult


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (40.0, 0, "40"),
        (100.0, 3, "100"),
        (1234.56, 3, "1234.6"),
        (0.0004, 3, "0.0004"),
        (0.0, 3, "0"),
        (-0.25, 3, "-0.25"),
        (float("nan"), 3, "\N{EN DASH}"),
        (None, 3, "\N{EN DASH}"),
    ],
)
def test_numbers_are_short_and_lose_no_digit_that_counts(
    value: float | None, digits: int, text: str
) -> None:
    assert number_text(value, digits=digits) == text


@pytest.mark.parametrize(
    ("actual", "limit", "margin", "text"),
    [
        (1.2, 2.3, 1.1, "at most 2.3 m"),
        (2.5, 2.3, -0.2, "at most 2.3 m"),
        (0.8, 1.0, -0.2, "at least 1 m"),
        (1.4, 1.0, 0.4, "at least 1 m"),
        (1.4, (1.0, 2.0), 0.4, "1 to 2 m"),
        (1.4, (None, 2.0), 0.6, "at most 2 m"),
        (None, None, None, "\N{EN DASH}"),
    ],
)
def test_a_limit_says_which_way_it_goes(
    actual: float | None,
    limit: float | tuple[float | None, float | None] | None,
    margin: float | None,
    text: str,
) -> None:
    oracle = OracleResult("height", "real", True, "PASS", actual, limit, "m", margin, 1.0)
    assert limit_text(oracle) == text


def test_times_are_relative_to_the_goal_where_it_was_given() -> None:
    assert short_time(3.5, 2.0) == "+1.50 s"
    assert short_time(1.5, 2.0) == "-0.50 s"
    assert short_time(3.5, None) == "3.50 s"
