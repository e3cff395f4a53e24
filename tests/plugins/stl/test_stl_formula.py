"""STL formulas: what text means, and where a mistake in it is."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.plugins.stl.arithmetic import written_atom
from wil_campaign.plugins.stl.formula import (
    BooleanAtom,
    CalculationTerm,
    ConstantTerm,
    Formula,
    JunctorFormula,
    NegatedFormula,
    Node,
    SignalTerm,
    StlComparison,
    StlError,
    StlInterval,
    TemporalFormula,
    UntilFormula,
    formula_children,
    signal_names_of,
)
from wil_campaign.plugins.stl.parser import DEEPEST, parse_stl
from wil_campaign.plugins.stl.units import SignalKind, require_sound

KINDS = {
    "clearance_m": SignalKind("m", ""),
    "up_m": SignalKind("m", ""),
    "speed_m_s": SignalKind("m/s", ""),
    "silence_s": SignalKind("s", ""),
    "armed": SignalKind("", ""),
    "on_ground": SignalKind("", ""),
}


def shape(node: Node) -> str:  # noqa: PLR0911  # one for each kind of node
    """Return a formula with all of its parentheses."""
    inner = [shape(child) for child in formula_children(node)]
    match node:
        case ConstantTerm(value):
            return f"{value:g}"
        case SignalTerm(name):
            return name
        case BooleanAtom():
            return inner[0]
        case CalculationTerm(operator) | StlComparison(_, operator):
            return f"({inner[0]} {operator} {inner[1]})"
        case JunctorFormula(word):
            return f"({inner[0]} {word} {inner[1]})"
        case NegatedFormula():
            return f"(not {inner[0]})"
        case UntilFormula(interval):
            return f"({inner[0]} until{span(interval)} {inner[1]})"
        case TemporalFormula(word, interval):
            return f"({word}{span(interval)} {inner[0]})"
    return f"abs({inner[0]})"


def span(interval: StlInterval) -> str:
    if interval.until_s is None:
        return ""
    return f"[{interval.from_s:g},{interval.until_s:g}]"


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("always[0,30] (clearance_m >= 0.1)", "(always[0,30] (clearance_m >= 0.1))"),
        ("always[0:30] clearance_m>=.1", "(always[0,30] (clearance_m >= 0.1))"),
        ("G a > 1 & F[0, 2.5] b < 2", "((always (a > 1)) and (eventually[0,2.5] (b < 2)))"),
        ("a > 1 or b > 1 and c > 1", "((a > 1) or ((b > 1) and (c > 1)))"),
        ("a -> b -> c", "(a implies (b implies c))"),
        ("a <-> b or c", "(a iff (b or c))"),
        ("a and b or c", "((a and b) or c)"),
        ("a or b -> c", "((a or b) implies c)"),
        ("a -> b or c", "(a implies (b or c))"),
        ("a -> b <-> c", "((a implies b) iff c)"),
        ("a and b and c", "((a and b) and c)"),
        ("a <-> b <-> c", "((a iff b) iff c)"),
        ("not a and b", "((not a) and b)"),
        ("!a || !(b)", "((not a) or (not b))"),
        ("a until[0,5] b and c", "((a until[0,5] b) and c)"),
        ("always a U b", "((always a) until b)"),
        ("once[0,1] a and historically b", "((once[0,1] a) and (historically b))"),
        ("0.5 <= up_m <= 2", "((0.5 <= up_m) and (up_m <= 2))"),
        ("a - b - 1 > -2 * c / 4", "(((a - b) - 1) > ((-2 * c) / 4))"),
        ("-a >= abs(b - 1)", "((0 - a) >= abs((b - 1)))"),
        ("(a + 1) * 2 > 1e-3", "(((a + 1) * 2) > 0.001)"),
        ("((a > 1))", "(a > 1)"),
    ],
)
def test_a_formula_may_be_written_in_several_ways(text: str, meant: str) -> None:
    formula = parse_stl(text)
    assert shape(formula) == meant
    assert shape(parse_stl(meant)) == meant


def test_names_stand_in_the_order_of_the_text() -> None:
    text = "always[0,30] (a > 1 -> eventually[1,2] (b > 1 until[0,3] c > 1)) and once[0,99] a > 1"
    assert [name.name for name in signal_names_of(parse_stl(text))] == ["a", "b", "c", "a"]


WRONG = [
    # "@" marks the place of the mistake
    ("@", "ends too soon"),
    ("always[0,30]@", "ends too soon"),
    ("always[0,30] (clearance_m >= 0.1@", "ends too soon: ')' is missing"),
    ("clearance_m >= 0.1@)", "')' is not expected here"),
    ("clearance_m >= @>= 0.1", "a signal, a number or '(' is missing"),
    ("@alway[0,30] (clearance_m >= 0.1)", "'alway' is not a word of the language"),
    ("always[30@] (a > 1)", "an interval is [from,to] in seconds"),
    ("always[0,@] (a > 1)", "a number of seconds is missing"),
    ("always[30,@10] (a > 1)", "the interval ends before it begins: [30,10]"),
    ("always[0,@1e9] (a > 1)", "more than a day"),
    ("always[0,@-1] (a > 1)", "a number of seconds is missing"),
    ("clearance_m @== 0.1", "two measured values are never equal"),
    ("clearance_m >= 0.1 @m", "a number has no unit"),
    ("@clearance_m + 1", "is a value, not a statement"),
    ("always (@clearance_m - 1)", "is a value, not a statement"),
    ("a + (@b > 1) > 2", "is a statement; a value is needed here"),
    ("a > 1 @# b", "'#' is not part of the language"),
    ("a > @1e999", "1e999 is not finite"),
    ("@speed_m_s", "is a value"),
    ("always (@clearance >= 0.1)", "unknown signal 'clearance'"),
    ("clearance_m @>= speed_m_s", "m cannot be compared with m/s"),
    ("clearance_m @+ speed_m_s > 1", "m cannot be added to m/s"),
    ("clearance_m / speed_m_s @>= up_m", "s cannot be compared with m"),
    ("2 @> 1", "compares two numbers: name a signal"),
    ("up_m * 0 @>= -1", "compares two numbers: name a signal"),
    ("up_m @/ 0 >= 1", "divides by 0, so it has no value"),
    ("always not (up_m @/ (2 - 2) <= 1)", "divides by 0"),
    ("up_m @/ abs(0 * speed_m_s) >= 1", "divides by 0"),
    ("0 @/ 0 <= up_m", "divides by 0"),
    ("up_m <= 1e300 @* 1e300", "is not finite"),
    ("@armed > 0.5", "'armed' is true or false: write it by itself"),
    ("@up_m", "is a value, not a statement"),
]


def checked(text: str) -> Formula:
    formula = parse_stl(text)
    require_sound(formula, KINDS)
    return formula


@pytest.mark.parametrize(("marked", "said"), WRONG)
def test_a_mistake_is_reported_with_its_place(marked: str, said: str) -> None:
    at = marked.index("@")
    with pytest.raises(StlError) as caught:
        checked(marked.replace("@", ""))
    assert said in str(caught.value)
    assert caught.value.offset == at


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("always (clearence_m >= 0.1)", "clearance_m"),
        ("always (clearance >= 0.1)", "clearance_m"),
        ("always (speed_kmh < 3)", "speed_m_s"),
        ("alwas (speed_m_s < 3)", "always"),
    ],
)
def test_a_misspelt_formula_gets_a_suggestion(text: str, meant: str) -> None:
    with pytest.raises(StlError) as caught:
        checked(text)
    assert caught.value.suggestion == meant


@pytest.mark.parametrize(
    "text",
    [
        "clearance_m / speed_m_s >= silence_s",
        "speed_m_s * silence_s + 1 < clearance_m - 2 * up_m",
        "abs(clearance_m) / up_m <= 2",
        "armed implies not on_ground",
    ],
)
def test_a_formula_with_units_that_fit_is_accepted(text: str) -> None:
    checked(text)


@pytest.mark.parametrize(
    "text",
    ["(" * 200 + "a", "-" * 200 + "a > 1", "not " * 200 + "a", "a+" * 400 + "a > 1", "a" * 2000],
)
def test_an_oversized_formula_is_refused(text: str) -> None:
    with pytest.raises(StlError, match=r"deep|more than|longer"):
        parse_stl(text)


def test_a_formula_of_the_greatest_depth_is_accepted() -> None:
    inner = "(" * DEEPEST + "a" + ")" * DEEPEST
    assert shape(parse_stl(inner)) == "a"
    with pytest.raises(StlError, match=f"nested more than {DEEPEST} deep"):
        parse_stl(f"({inner})")


@pytest.mark.parametrize(
    "text",
    [
        "up_m - (up_m + clearance_m) >= 1",
        "up_m - (up_m - clearance_m) >= 1",
        "up_m + (up_m + clearance_m) >= 1",
        "(up_m + clearance_m) * 2 >= 1",
        "2 * (up_m + clearance_m) >= 1",
        "up_m / (speed_m_s / silence_s) >= 1",
        "abs(up_m - clearance_m) >= 1",
    ],
)
def test_a_comparison_is_written_as_it_is_read(text: str) -> None:
    parsed = parse_stl(text)
    assert isinstance(parsed, StlComparison)
    assert worth(parse_stl(written_atom(parsed))) == worth(parsed)


def worth(node: Node) -> float:
    """Return what is compared, with another number for each name."""
    assert isinstance(node, StlComparison)
    numbers = {"up_m": 2.0, "clearance_m": 3.0, "speed_m_s": 5.0, "silence_s": 7.0}
    return float(eval(shape(node.left), {"__builtins__": {"abs": abs}}, numbers))  # noqa: S307


words = st.sampled_from(
    [
        "always",
        "eventually",
        "until",
        "not",
        "and",
        "or",
        "implies",
        "abs",
        "(",
        ")",
        "[",
        "]",
        ",",
        "+",
        "-",
        "*",
        "/",
        ">=",
        "<=",
        ">",
        "<",
        "->",
        "a",
        "b",
        "0",
        "1",
        "2.5",
        "armed",
    ]
)


@settings(max_examples=500)
@given(st.one_of(st.text(max_size=30), st.lists(words, max_size=15).map(" ".join)))
def test_any_text_is_a_formula_or_refused(text: str) -> None:
    offset, formula = 0, None
    try:
        formula = parse_stl(text)
    except StlError as error:
        offset = error.offset
    assert 0 <= offset <= len(text)
    if formula is not None:
        assert shape(parse_stl(shape(formula))) == shape(formula)
