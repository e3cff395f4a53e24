"""Splits the text of an STL formula into tokens with their offsets."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from wil_campaign.plugins.stl.formula import StlError

LONGEST = 1000
MOST = 300
"""The most characters and tokens of a formula."""

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)"
    r"|(?P<sign><->|->|=>|>=|<=|==|!=|&&|\|\||[-+*/()\[\],:<>!&|=]))"
)
ALIASES = {
    "G": "always",
    "globally": "always",
    "F": "eventually",
    "finally": "eventually",
    "U": "until",
    "O": "once",
    "H": "historically",
    "!": "not",
    "&": "and",
    "&&": "and",
    "|": "or",
    "||": "or",
    "->": "implies",
    "=>": "implies",
    "<->": "iff",
}
MODALS = ("always", "eventually", "once", "historically")
WORDS = frozenset({*MODALS, "until", "not", "and", "or", "implies", "iff", "abs"})


@dataclass(frozen=True, slots=True)
class Token:
    """A token of an STL formula: number, name, word or sign; text is "" at the end."""

    kind: str
    text: str
    at: int


def tokens_of(text: str) -> Iterator[Token]:
    """Yield the tokens of a formula, the last one of kind "end". Raises StlError."""
    if len(text) > LONGEST:
        raise StlError(f"is longer than {LONGEST} characters", LONGEST)
    at, end, count = 0, len(text.rstrip()), 0
    while at < end:
        count += 1
        if count > MOST:
            raise StlError(f"has more than {MOST} words and signs", at)
        match = _TOKEN.match(text, at)
        if match is None or match.lastgroup is None:
            begin = at + len(text[at:]) - len(text[at:].lstrip())
            raise StlError(f"'{text[begin]}' is not part of the language", begin)
        kind, found = match.lastgroup, match[match.lastgroup]
        word = ALIASES.get(found, found)
        if (kind == "name" and word in WORDS) or (kind == "sign" and word in WORDS):
            kind = "word"
        yield Token(kind, word if kind == "word" else found, match.start(match.lastgroup))
        at = match.end()
    yield Token("end", "", end)
