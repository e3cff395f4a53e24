"""Texts of measured values beside their limits."""

_MOST_DIGITS = 9


def distinct_value_text(value: float, limit: float, *, digits: int = 2) -> str:
    """Return a value as text, with as many digits as tell it from its limit.

    digits: after the decimal point at least; a value that equals its limit has no more. The text
    is on the same side of the limit as the value: 0.5998 beside 0.6, not 0.60.
    """
    for count in range(digits, _MOST_DIGITS):
        text = f"{value:.{count}f}"
        shown = float(text)
        if value == limit or (shown != limit and (shown < limit) == (value < limit)):
            return text
    return f"{value!r}"
