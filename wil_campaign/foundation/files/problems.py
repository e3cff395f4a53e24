"""Problems of input files with their places, and the error that carries all of them."""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

_WIDEST_LINE = 100
_LIKE_ENOUGH = 0.6

_PASSWORDS = (
    re.compile(
        r"""(://[^/:@\s"']*:)
        (?:(?:\\.|[^/\s"\\])*  # may have the '@' and the apostrophe, and the quote of JSON
        |(?!\d+/)(?:\\.|(?!://)[^\s"\\])*)  # a slash too: then it is no port
        (@)""",
        re.VERBOSE,
    ),
    re.compile(
        r"""([?&](?:pass|passwd|password|pwd|token|key)=)(?:\\.|[^&\s"\\])*[^&\s"':;,.)\]}\\]()""",
        re.IGNORECASE,
    ),
)
"""What a password in an address looks like: the groups before and after it stay."""

# fmt: off
_UNITS = (
    "deg_s", "rad_s", "m_s2", "m_s", "km_h", "kmh", "kph", "mph", "knots", "kn", "fps", "px",
    "deg", "rad", "ms", "us", "ns", "min", "hz", "khz", "mm", "cm", "km", "ft", "feet", "inch",
    "kbit_s", "percent", "kg", "lb", "mah", "wh", "m", "s", "g", "v", "a", "w",
)
# fmt: on


@dataclass(frozen=True, slots=True)
class Problem:
    """A problem in an input file: place, message, suggestion.

    line and column count from 1; line 0 means the file as a whole (it is missing, or binary).
    suggestion is what the user probably meant, as it would be written; empty when unknown.
    """

    file: str
    line: int
    column: int
    message: str
    source_line: str = ""
    suggestion: str = ""

    @property
    def text(self) -> str:
        """Return what is wrong, and what was meant, without the place."""
        meant = f"; did you mean '{printable_problem(self.suggestion)}'?" if self.suggestion else ""
        return f"{printable_problem(self.message)}{meant}"

    @property
    def headline(self) -> str:
        """Return the first line of the problem's message: place, what is wrong, what was meant."""
        place = f"{self.file}:{self.line}:{self.column}" if self.line else self.file
        return f"{printable_problem(place)}: {self.text}"

    def __str__(self) -> str:
        if not self.line or not self.source_line.strip():
            return self.headline
        first = max(0, min(self.column - 1, len(self.source_line)) - _WIDEST_LINE * 3 // 4)
        shown = printable_problem(self.source_line[first : first + _WIDEST_LINE])
        caret = " " * (self.column - 1 - first) + "^"
        return f"{self.headline}\n    {shown}\n    {caret}"


class BadInput(Exception):  # noqa: N818 - it is the input, not an error of this program
    """Input files that a user must correct, with every problem found in them.

    warnings: contents that are legal and probably unintended.
    """

    def __init__(self, problems: Iterable[Problem], warnings: Iterable[Problem] = ()) -> None:
        self.problems = tuple(problems)
        self.warnings = tuple(warnings)
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


def printable_problem(text: str) -> str:
    """Return a problem's text on one line, without passwords, control characters as '?'."""
    printable = "".join(letter if letter.isprintable() else "?" for letter in text)
    return without_passwords(printable)


def without_passwords(text: str) -> str:
    """Return a text, of JSON too, with '***' for each password in an address: results are shared.

    The user of "rtsp://user:password@host/main" stays.
    """
    for pattern in _PASSWORDS:
        # No template: re imports what reads one, and errors are told of while Python shuts down.
        text = pattern.sub(lambda found: f"{found[1]}***{found[2]}", text)
    return text


def unit_of_key(key: str) -> str:
    """Return the unit suffix of a key ('m_s'), for problems about units; "" without one."""
    return next((unit for unit in _UNITS if key.endswith("_" + unit)), "")


def stem_of_key(key: str) -> str:
    """Return a key without its unit: 'speed_m_s' and 'speed_kmh' are both 'speed'."""
    return key.removesuffix("_" + unit_of_key(key)) if unit_of_key(key) else key


def closest_file(name: str, known: Iterable[str]) -> str:
    """Return the file name most like a misspelt one, or "": suffixes do not count."""
    names = sorted(set(known))
    suffix = Path(name).suffix.lower()
    # Of the same name with several suffixes, that with the one that was written.
    names.sort(key=lambda one: Path(one).suffix.lower() == suffix)
    by_stem = {Path(one).stem: one for one in names}
    return by_stem.get(closest_word(Path(name).stem, by_stem), "")


def closest_word(word: str, known: Iterable[str]) -> str:
    """Return the known word most like a misspelt one, or "" when none is like it.

    A key that differs in its unit only comes first, then the most similar one (difflib).
    """
    words = sorted(set(known))
    stem = stem_of_key(word.lower())
    for candidate in words:
        if stem and stem_of_key(candidate) == stem:
            return candidate
    lower = {candidate.lower(): candidate for candidate in words}
    found = difflib.get_close_matches(word.lower(), lower, n=1, cutoff=_LIKE_ENOUGH)
    return lower[found[0]] if found else ""


def is_encodable(text: str) -> bool:
    """Return whether UTF-8 has a form for a text: JSON may hold half a surrogate pair."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True
