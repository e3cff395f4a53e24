"""SVG elements with every attribute and text escaped; pure."""

import unicodedata
from collections.abc import Iterable, Mapping

from markupsafe import Markup, escape

_CONTROL_BLOCK = 0x2400
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode categories of invisible characters, and of those that change text direction."""


def visible_text(text: str) -> str:
    """Return a text with control characters replaced by visible ones."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(map(_visible_letter, text))


def _visible_letter(letter: str) -> str:
    if letter in "\n\t" or unicodedata.category(letter) not in _HIDDEN:
        return letter
    code = ord(letter)
    if code < 0x20:
        return chr(_CONTROL_BLOCK + code)
    return f"<U+{code:04X}>"


def shown_value(value: object) -> object:
    """Return a value as a template prints it; markup stays unchanged."""
    return visible_text(value) if type(value) is str else value


def svg_element(
    name: str, attributes: Mapping[str, object], children: Iterable[Markup | str] = ()
) -> Markup:
    """Return an element. attributes: None leaves one out; values are escaped, names are not."""
    pairs = [
        f' {key}="{escape(_attribute(value))}"'
        for key, value in attributes.items()
        if value is not None
    ]
    inner = "".join([escape(shown_value(child)) for child in children])
    # The names are literals of this package; everything else is escaped just above.
    return Markup(f"<{name}{''.join(pairs)}>{inner}</{name}>")  # noqa: S704


def _attribute(value: object) -> str:
    return number_attribute(value) if isinstance(value, float) else visible_text(str(value))


def number_attribute(value: float) -> str:
    """Return a number for an attribute: at most two decimals."""
    return f"{value:.2f}".rstrip("0").rstrip(".") if value else "0"


def points_text(points: Iterable[tuple[float, float]], places: int = 1) -> str:
    """Return the points of a polyline."""
    return " ".join([f"{x:.{places}f},{y:.{places}f}" for x, y in points])
