"""Parses the text of an STL formula; errors have the offset of the mistake.

Precedence from weak to strong: iff; implies; or; and; until; not, always, eventually, once,
historically; comparisons; + and -; * and /; a leading minus. Times are seconds: always[0,30].

Splits the text of an STL formula into tokens with their offsets.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from wil_campaign.foundation.files.problems import closest_word
from wil_campaign.plugins.stl.formula import (
    FORMULAS,
    TERMS,
    AbsoluteTerm,
    BooleanAtom,
    CalculationTerm,
    Comparator,
    ConstantTerm,
    Formula,
    Junction,
    JunctorFormula,
    Modal,
    NegatedFormula,
    Node,
    SignalTerm,
    StlComparison,
    StlError,
    StlInterval,
    TemporalFormula,
    Term,
    UntilFormula,
)

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
class StlToken:
    """A token of an STL formula: number, name, word or sign; text is "" at the end."""

    kind: str
    text: str
    at: int


def stl_tokens_of(text: str) -> Iterator[StlToken]:
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
        yield StlToken(kind, word if kind == "word" else found, match.start(match.lastgroup))
        at = match.end()
    yield StlToken("end", "", end)


DEEPEST = 40
NO_STATEMENT = "is a value, not a statement: compare it with something, like clearance_m >= 0.1"
LONGEST_S = 86_400.0

_JUNCTIONS: tuple[Junction, ...] = ("iff", "implies", "or", "and")
_COMPARATORS: dict[str, Comparator] = {">=": ">=", "<=": "<=", ">": ">", "<": "<"}
_MODALS: dict[str, Modal] = {
    "always": "always",
    "eventually": "eventually",
    "once": "once",
    "historically": "historically",
}


def parse_stl(text: str) -> Formula:
    """Return the parsed STL formula of a text. Raises StlError with the offset of the mistake."""
    parser = _Parser(list(stl_tokens_of(text)))
    node = parser.junction(0)
    parser.expect_end()
    return _formula(node)


def _formula(node: Node) -> Formula:
    """Return the parsed node as a formula. Raises StlError for a bare value."""
    if isinstance(node, FORMULAS):
        return node
    if isinstance(node, SignalTerm):
        return BooleanAtom(node, node.at)
    raise StlError(NO_STATEMENT, _begin(node))


def _term(node: Node) -> Term:
    if isinstance(node, TERMS):
        return node
    raise StlError("is a statement; a value is needed here", _begin(node))


def _begin(node: Node) -> int:
    match node:
        case CalculationTerm(_, left, _) | StlComparison(left, _, _):
            return _begin(left)
        case JunctorFormula(_, left, _) | UntilFormula(_, left, _):
            return _begin(left)
        case _:
            return node.at


class _Parser:
    def __init__(self, tokens: list[StlToken]) -> None:
        self._tokens = tokens
        self._next = 0
        self._depth = 0

    @property
    def _token(self) -> StlToken:
        return self._tokens[self._next]

    def _take(self) -> StlToken:
        token = self._token
        self._next += 1
        return token

    def _take_if(self, *texts: str) -> StlToken | None:
        token = self._token
        return self._take() if token.kind in {"word", "sign"} and token.text in texts else None

    def _expect(self, text: str) -> StlToken:
        token = self._take_if(text)
        if token is None:
            raise self._unexpected(f"'{text}' is missing")
        return token

    def expect_end(self) -> None:
        """Raise StlError when there is more text to parse."""
        if self._token.kind != "end":
            raise self._unexpected(f"'{self._token.text}' is not expected here")

    def _unexpected(self, message: str) -> StlError:
        token = self._token
        before = self._tokens[self._next - 1] if self._next else None
        if token.kind == "end":
            return StlError(f"the formula ends too soon: {message}", token.at)
        if before is not None and before.kind == "number" and token.kind == "name":
            message = f"'{before.text} {token.text}': a number has no unit, "
            return StlError(
                message + "it takes the unit of the signal that it is compared with", token.at
            )
        if before is not None and before.kind == "name" and token.text in {"(", "["}:
            meant = closest_word(before.text, WORDS)
            return StlError(f"'{before.text}' is not a word of the language", before.at, meant)
        return StlError(message, token.at)

    def junction(self, level: int) -> Node:
        """Parse the formula at this position, with operators from a precedence level on."""
        if level == len(_JUNCTIONS):
            return self._until()
        word = _JUNCTIONS[level]
        left = self.junction(level + 1)
        while (token := self._take_if(word)) is not None:
            # Implication is right-associative, as in logic.
            right = self._parse_nested(level if word == "implies" else level + 1, token)
            left = JunctorFormula(word, _formula(left), _formula(right), token.at)
        return left

    @contextmanager
    def _deeper(self, token: StlToken) -> Iterator[None]:
        self._depth += 1
        if self._depth > DEEPEST:
            raise StlError(f"is nested more than {DEEPEST} deep", token.at)
        yield
        self._depth -= 1

    def _parse_nested(self, level: int, token: StlToken) -> Node:
        with self._deeper(token):
            return self.junction(level)

    def _until(self) -> Node:
        left = self._parse_prefixed()
        while (token := self._take_if("until")) is not None:
            interval = self._interval()
            right = self._parse_prefixed()
            left = UntilFormula(interval, _formula(left), _formula(right), token.at)
        return left

    def _parse_prefixed(self) -> Node:
        token = self._take_if("not", *MODALS)
        if token is None:
            return self._comparison()
        with self._deeper(token):
            if token.text == "not":
                return NegatedFormula(_formula(self._parse_prefixed()), token.at)
            interval = self._interval()
            inner = _formula(self._parse_prefixed())
            return TemporalFormula(_MODALS[token.text], interval, inner, token.at)

    def _interval(self) -> StlInterval:
        if self._take_if("[") is None:
            return StlInterval()
        begin = self._seconds()
        if self._take_if(",", ":") is None:
            raise self._unexpected("an interval is [from,to] in seconds, like [0,30]")
        at = self._token.at
        end = self._seconds()
        self._expect("]")
        if end < begin:
            raise StlError(f"the interval ends before it begins: [{begin:g},{end:g}]", at)
        return StlInterval(begin, end)

    def _seconds(self) -> float:
        token = self._token
        if token.kind != "number":
            raise self._unexpected("a number of seconds is missing")
        value = float(self._take().text)
        if value > LONGEST_S:
            raise StlError(f"{token.text} s is more than a day", token.at)
        return value

    def _comparison(self) -> Node:
        left = self._sum()
        found: list[StlComparison] = []
        while self._token.text in _COMPARATORS or self._token.text in {"=", "==", "!="}:
            token = self._take()
            if token.text not in _COMPARATORS:
                message = f"'{token.text}': two measured values are never equal; use <= and >="
                raise StlError(message, token.at)
            right = self._sum()
            found.append(
                StlComparison(_term(left), _COMPARATORS[token.text], _term(right), token.at)
            )
            left = right
        if not found:
            return left
        # A chain such as 0.5 <= up_m <= 2 is a conjunction.
        whole: Formula = found[0]
        for each in found[1:]:
            whole = JunctorFormula("and", whole, each, each.at)
        return whole

    def _sum(self) -> Node:
        left = self._product()
        while (token := self._take_if("+", "-")) is not None:
            operator: Literal["+", "-"] = "+" if token.text == "+" else "-"
            left = CalculationTerm(operator, _term(left), _term(self._product()), token.at)
        return left

    def _product(self) -> Node:
        left = self._factor()
        while (token := self._take_if("*", "/")) is not None:
            operator: Literal["*", "/"] = "*" if token.text == "*" else "/"
            left = CalculationTerm(operator, _term(left), _term(self._factor()), token.at)
        return left

    def _factor(self) -> Node:
        token = self._token
        if self._take_if("-"):
            with self._deeper(token):
                inner = _term(self._factor())
            if isinstance(inner, ConstantTerm):
                return ConstantTerm(-inner.value, token.at)
            return CalculationTerm("-", ConstantTerm(0.0, token.at), inner, token.at)
        if self._take_if("abs"):
            self._expect("(")
            inner = _term(self._parse_nested(0, token))
            self._expect(")")
            return AbsoluteTerm(inner, token.at)
        if self._take_if("("):
            node = self._parse_nested(0, token)
            self._expect(")")
            return node
        if token.kind == "number":
            return self._number(self._take())
        if token.kind == "name":
            return SignalTerm(self._take().text, token.at)
        raise self._unexpected("a signal, a number or '(' is missing")

    @staticmethod
    def _number(token: StlToken) -> ConstantTerm:
        value = float(token.text)
        if value in {float("inf"), float("-inf")}:
            raise StlError(f"{token.text} is not finite", token.at)
        return ConstantTerm(value, token.at)
