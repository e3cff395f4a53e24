"""Texts of p values beside the level of their tests; pure."""

_MOST_DIGITS = 12


def p_text(p: float, level: float = 0.05) -> str:
    """Return a p value in two digits, or in as many as tell it from the level of its test."""
    for digits in range(2, _MOST_DIGITS):
        shown = float(text := f"{p:.{digits}g}")
        if shown != level and (shown < level) == (p < level):
            return text
    return f"{p:.2g}"
