"""Files with places: what loads, what each fault says and where."""

import contextlib
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, Self

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pydantic import Field, model_validator

from wil_campaign.foundation.files import yaml_nodes
from wil_campaign.foundation.files.documents import (
    MAX_BYTES,
    BadInput,
    Document,
    KeyFaultError,
    Part,
    check_document,
    load_document,
    parse_document,
    parse_option_value,
)
from wil_campaign.foundation.files.yaml_nodes import MAX_DEPTH, YamlNode, YamlSource


def doc(text: str) -> Document:
    return parse_document(text.encode(), name="x.yaml")


def faults(text: str) -> list[str]:
    with pytest.raises(BadInput) as caught:
        doc(text)
    return [problem.headline for problem in caught.value.problems]


class Camera(Part):
    type: Literal["camera"]
    rate_hz: Annotated[float, Field(gt=0)]
    width_px: int


class Lidar(Part):
    type: Literal["lidar"]
    beams: int


Sensor = Annotated[Camera | Lidar, Field(discriminator="type")]


class Box(Part):
    north_m: tuple[float, float]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.north_m[0] >= self.north_m[1]:
            raise KeyFaultError("north_m", "the low end is not below the high end")
        return self


class Vehicle(Part):
    link: Literal["embedded"] | dict[str, str]
    speed_m_s: float
    sensors: dict[str, Annotated[Camera | Lidar, Field(discriminator="type")]] = Field(
        default_factory=dict
    )
    box: Box | None = None
    names: list[str] = Field(default_factory=list)
    armed: bool = False


class Top(Part):
    vehicle: Vehicle


def problems(text: str) -> list[str]:
    with pytest.raises(BadInput) as caught:
        check_document(doc(text), Top)
    return [problem.headline for problem in caught.value.problems]


GOOD = "vehicle: {link: embedded, speed_m_s: 1, "


@pytest.mark.parametrize(
    ("plain", "value"),
    [
        ("on", "on"),
        ("yes", "yes"),
        ("No", "No"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("12:30:00", "12:30:00"),
        ("2024-01-31", "2024-01-31"),
        ("1e-3", 0.001),
        ("1.", 1.0),
        (".5", 0.5),
        ("-7", -7),
        ("010", 10),
        ("0x1F", 31),
        ("0o17", 15),
        ("1_000", "1_000"),
        ("'5'", "5"),
        ("! 5", "5"),
        (".inf", ".inf"),
        (".nan", ".nan"),
        ("1e999", "1e999"),
        ("-2.5E+3", -2500.0),
    ],
)
def test_plain_scalars_follow_the_core_schema(plain: str, value: object) -> None:
    found = doc(f"key: {plain}").get(("key",))
    assert found == value
    assert type(found) is type(value)


def test_keys_are_text() -> None:
    assert doc("on: 1\n5: 2\ntrue: 3\n1.50: 4").data == {"on": 1, "5": 2, "true": 3, "1.50": 4}


def test_places_count_from_one_and_fall_back_to_the_last_key_that_exists() -> None:
    document = doc("a:\n  b: [1, {c: 2}]\n")
    assert document.place(()) == (1, 1)
    assert document.place(("a",), key=True) == (1, 1)
    assert document.place(("a", "b", 1, "c")) == (2, 14)
    assert document.place(("a", "b", 1, "c"), key=True) == (2, 11)
    assert document.place(("a", "x")) == (1, 1)
    assert document.place(("a", "b", 9)) == (2, 3)


def test_aliases_and_merge_keys_are_written_out() -> None:
    document = doc("a: &x {p: 1, q: 2}\nb: *x\nc: {<<: *x, q: 3}\nd: {q: 3, <<: [*x, {r: 4}]}")
    assert document.data == {
        "a": {"p": 1, "q": 2},
        "b": {"p": 1, "q": 2},
        "c": {"p": 1, "q": 3},
        "d": {"p": 1, "q": 3, "r": 4},
    }
    assert document.place(("b", "p")) == (1, 11)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2", "x.yaml:2:1: key 'a' is declared twice, first in line 1"),
        ("a: {b: 1, b: 2}", "x.yaml:1:11: key 'b' is declared twice, first in line 1"),
        ("a: 1\n---\nb: 2", "x.yaml:2:1: a second YAML document begins here; a file holds one"),
        ("a: *b", "x.yaml:1:4: '*b' refers to no '&b' above"),
        ("a: &b [*b]", "x.yaml:1:8: '*b' is inside the value that it refers to"),
        ("a: !!python/none x", "x.yaml:1:4: tag 'tag:yaml.org,2002:python/none': tags are not"),
        ("[1]: 2", "x.yaml:1:1: a key must be a word"),
        ("a: {<<: 5}", "x.yaml:1:5: '<<' takes a mapping"),
        ("- 1\n- 2", "x.yaml:1:1: the top level must be a mapping, is a list of 2"),
        ("just words", "x.yaml:1:1: the top level must be a mapping, is the text 'just words'"),
        ("a: [1, 2", "x.yaml:1:9: not YAML: while parsing a flow sequence, expected ',' or ']'"),
        ("a: 1\n\tb: 2", "x.yaml:2:1: not YAML: while scanning for the next token, found char"),
        ("a:\n  b: 1\n  pillar_b\n    x: 2\n", "x.yaml:3:3: 'pillar_b' needs a ':'"),
        ("a: b: c", "x.yaml:1:5: not YAML: mapping values are not allowed here"),
        ("a: '\x07'", "x.yaml:1:5: a character that YAML does not allow"),
        ('a: "\\ud800"', "x.yaml:1:4: an unpaired surrogate is not a character"),
        ("", "x.yaml: is empty"),
        ("# nothing\n", "x.yaml: is empty"),
    ],
)
def test_a_broken_document_is_reported_with_its_place(text: str, said: str) -> None:
    found = faults(text)
    assert len(found) == 1
    assert found[0].startswith(said)


def test_duplicate_keys_are_reported_all_at_once() -> None:
    assert len(faults("a: 1\na: 2\nb: {c: 1, c: 1}\nb: 3")) == 3


def test_nesting_is_bounded() -> None:
    assert doc("a: " + "[" * (MAX_DEPTH - 2) + "]" * (MAX_DEPTH - 2)).data
    assert f"nested more than {MAX_DEPTH} deep" in faults("a: " + "[" * 5000)[0]


def test_an_alias_bomb_does_not_go_off() -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12)]
    assert "once aliases are written out" in faults("\n".join(lines))[0]


def test_aliases_do_not_get_round_the_depth() -> None:
    half = MAX_DEPTH - 10
    text = f"a: &a {'[' * half}{']' * half}\nb: {'[' * half}*a{']' * half}"
    assert "once aliases are written out" in faults(text)[0]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"a: 1\nb: \xff", "x.yaml:2:4: is not UTF-8 text"),
        (b"\x7fELF\x00\x00", "x.yaml: is not text (it has NUL bytes)"),
        ("a: 1".encode("utf-16"), "x.yaml: is UTF-16 text; save it as UTF-8"),
    ],
)
def test_a_file_that_is_no_text_is_reported(content: bytes, said: str) -> None:
    with pytest.raises(BadInput) as caught:
        parse_document(content, name="x.yaml")
    assert [p.headline for p in caught.value.problems] == [said]


def test_a_byte_order_mark_is_no_matter() -> None:
    assert parse_document(b"\xef\xbb\xbfa: 1", name="x.yaml").data == {"a": 1}


def test_files_that_cannot_be_read_are_reported(tmp_path: Path) -> None:
    big = tmp_path / "big.yaml"
    big.write_bytes(b"#" * (MAX_BYTES + 1))
    for path, said in [
        (tmp_path / "none.yaml", "No such file or directory"),
        (tmp_path, "is not a file"),
        (Path("a\0b"), "null"),
        (tmp_path / ("n" * 300), "File name too long"),
        (big, "is larger than"),
        (Path("/dev/zero"), "is not a file"),
    ]:
        with pytest.raises(BadInput, match=said):
            load_document(path)


def test_a_file_may_be_called_by_another_name(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: [")
    with pytest.raises(BadInput) as caught:
        load_document(path, name="../worlds/a.yaml")
    assert str(caught.value).startswith("../worlds/a.yaml:1:5: not YAML")


def test_a_problem_shows_its_line_and_points_at_the_place() -> None:
    document = doc("a: 1\nvehicels: {}\n")
    problem = document.problem(("vehicels",), "unknown key 'vehicels'", "vehicles", key=True)
    assert str(problem).splitlines() == [
        "x.yaml:2:1: unknown key 'vehicels'; did you mean 'vehicles'?",
        "    vehicels: {}",
        "    ^",
    ]


def test_a_problem_far_out_in_a_long_line_shows_the_part_around_it() -> None:
    document = doc(f"a: {{b: '{'x' * 500}', c: 1}}")
    first, line, caret = str(document.problem(("a", "c"), "wrong")).splitlines()
    assert first.startswith("x.yaml:1:")
    assert len(line) <= 104
    assert line[caret.index("^")] == "1"


def test_terminal_sequences_of_a_file_do_not_reach_the_terminal() -> None:
    document = doc('a: "\\e[31mred"')
    assert "\x1b" not in str(document.problem(("a",), f"is {document.get(('a',))}"))


@pytest.mark.parametrize(
    ("marked", "said"),
    [
        ("@colour: 1}", "unknown key 'colour' (known here: link, speed_m_s, sensors, box,"),
        ("@arned: true}", "unknown key 'arned'; did you mean 'armed'?"),
        ("armed: @yes}", "must be true or false, is the text 'yes'"),
        ("armed: @1}", "must be true or false, is 1"),
        ("names: @x}", "must be a list, is the text 'x'"),
        ("names: [a, @5]}", "must be text, is 5"),
        ("names:@ }", "must be a list, is empty"),
        ("box: @5}", "must be a mapping, is 5"),
        ("box: {north_m: @[1]}}", "has too few entries (1)"),
        ("box: {north_m: @[1, 2, 3]}}", "must have at most 2 entries, has 3"),
        ("box: {north_m: @[2, 1]}}", "the low end is not below the high end"),
        ("box: {north_m: [@.nan, 1]}}", "must be a number, is the text '.nan' (it must be finite)"),
        ("box: {north_m: [1, @.inf]}}", "must be a number, is the text '.inf' (it must be finite)"),
        (
            "box: {north_m: [1, @1e400]}}",
            "must be a number, is the text '1e400' (it must be finite)",
        ),
        ("sensors: {c: {type: @camra}}}", "must be camera or lidar, is 'camra'; did you mean"),
        ("sensors: {@c: {beams: 5}}}", "missing key 'type'"),
        ("sensors: {c: {type: lidar, beams: @1.5}}}", "must be a whole number, is 1.5"),
        ("sensors: {c: {type: lidar, @baems: 5}}}", "unknown key 'baems'; did you mean 'beams'?"),
        (
            "sensors: {c: {type: camera, rate_hz: @-1, width_px: 2}}}",
            "must be greater than 0, is -1",
        ),
        (
            "sensors: {c: {type: camera, rate_hz: @'30', width_px: 2}}}",
            "must be a number, is the text '30' (leave out the quotes)",
        ),
        (
            "sensors: {c: {type: camera, rate_hz: @30 Hz, width_px: 2}}}",
            "must be a number, is the text '30 Hz' (a plain number; the key has its unit)",
        ),
    ],
)
def test_one_mistake_is_one_problem_at_its_place(marked: str, said: str) -> None:
    found = problems(GOOD + marked.replace("@", ""))
    assert len(found) == 1, found
    column = len(GOOD) + marked.index("@") + 1
    assert found[0].startswith(f"x.yaml:1:{column}: {said}")


def test_a_unit_in_a_key_is_put_right_without_an_echo() -> None:
    assert problems("vehicle: {link: embedded, speed_kmh: 3}") == [
        "x.yaml:1:27: unknown key 'speed_kmh'; did you mean 'speed_m_s'?"
    ]


def test_a_union_names_all_that_would_do() -> None:
    assert problems("vehicle: {link: 5, speed_m_s: 1}") == [
        "x.yaml:1:17: must be embedded or a mapping, is 5"
    ]
    assert problems("vehicle: {link: embeded, speed_m_s: 1}") == [
        "x.yaml:1:17: must be embedded or a mapping, is 'embeded'; did you mean 'embedded'?"
    ]


def test_all_faults_come_at_once_in_the_order_of_the_file() -> None:
    text = """\
vehicle:
  speed_m_s: fast
  link: 7
  sensors:
    camera: {type: camera, rate_hz: 0, width_px: 1.5}
extra: 1
"""
    assert [line.split(": ")[0] for line in problems(text)] == [
        "x.yaml:2:14",
        "x.yaml:3:9",
        "x.yaml:5:37",
        "x.yaml:5:50",
        "x.yaml:6:1",
    ]


def test_numbers_that_are_not_text_and_text_that_is_no_number() -> None:
    vehicle = check_document(doc("vehicle: {link: embedded, speed_m_s: 1}"), Top).vehicle
    assert vehicle.speed_m_s == 1.0
    assert isinstance(vehicle.speed_m_s, float)
    assert problems("vehicle: {link: embedded, speed_m_s: 1e999}") == [
        "x.yaml:1:38: must be a number, is the text '1e999' (it must be finite)"
    ]


def test_check_reaches_into_a_document() -> None:
    document = doc("outer: {vehicle: {link: embedded, speed_m_s: x}}")
    with pytest.raises(BadInput, match=r"x\.yaml:1:46: must be a number"):
        check_document(document, Top, ("outer",))


def test_no_word_of_pydantic_reaches_people() -> None:
    for text in ["vehicle: 5", "vehicle: [1]", "vehicle: {}", "{}", "vehicle: {link: {a: 1}}"]:
        said = " ".join(problems(text)) if text != "{}" else " ".join(problems("vehicle:"))
        for word in ("Input", "pydantic", "dictionary", "instance", "Extra", "validation"):
            assert word not in said


def overridden(text: str, key: str, value: str) -> Document:
    return doc(text).override(key, parse_option_value(value, name=f"--set {key}={value}"))


def test_an_override_replaces_the_whole_value() -> None:
    assert overridden("a: {b: {c: 1, d: 2}}", "a.b", "{e: 5}").data == {"a": {"b": {"e": 5}}}
    assert overridden("a: [1, 2]", "a.1", "7").data == {"a": [1, 7]}
    assert overridden("a:", "a.b.c", "7").data == {"a": {"b": {"c": 7}}}
    assert overridden("x: 1", "a.b", "on").data == {"x": 1, "a": {"b": "on"}}


def test_an_override_leaves_aliases_of_the_value_alone() -> None:
    text = "a: &a {b: 1}\nc: *a"
    assert overridden(text, "a.b", "2").data == {"a": {"b": 2}, "c": {"b": 1}}


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("objects.gaet.size", "there is no 'gaet'; did you mean 'gate'?"),
        ("objects.gate.size.x", "'x' would be inside 5"),
        ("list.2", "'2' is not an index of a list of 2, indices begin at 0"),
        ("objects..size", "a part between its dots is empty"),
        ("a." * 40 + "b", "has 41 parts, at most 40 are possible"),
        ("list.-1", "'-1' is not an index of a list of 2, indices begin at 0"),
    ],
)
def test_an_override_that_leads_nowhere_is_reported(key: str, said: str) -> None:
    with pytest.raises(BadInput) as caught:
        overridden("objects: {gate: {size: 5}}\nlist: [1, 2]", key, "1")
    (problem,) = caught.value.problems
    assert problem.headline == f"--set {key}=1: override '{key}': {said}"


def test_a_fault_of_an_overridden_value_stands_where_the_override_does() -> None:
    cases = parse_document(b"cases:\n  fast: {vehicle.speed_m_s: quick}\n", name="campaign.yaml")
    entry = cases.entry(("cases", "fast", "vehicle.speed_m_s"))
    document = doc("vehicle: {link: embedded, speed_m_s: 1}").override("vehicle.speed_m_s", entry)
    with pytest.raises(BadInput) as caught:
        check_document(document, Top)
    assert caught.value.problems[0].headline.startswith("campaign.yaml:2:29: must be a number")


def test_documents_go_to_worker_processes() -> None:
    document = doc("a: {b: [1, 2]}")
    again = pickle.loads(pickle.dumps(document))  # noqa: S301 - our own bytes
    assert again == document
    assert again.place(("a", "b", 1)) == (1, 12)


def outcome(content: bytes) -> Document | BadInput:
    try:
        return parse_document(content, name="fuzz.yaml")
    except BadInput as error:
        return error


def judge(found: Document | BadInput) -> None:
    if isinstance(found, BadInput):
        assert found.problems
        assert str(found).startswith("fuzz.yaml")
    else:
        assert isinstance(found.data, dict)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=200))
@example(b'"\\UFFFFFFFF": 1')
@example(b"%YAML 9.9\n---\na: 1")
@example(b"a: " + b"9" * 6000)
@example(b"? a\n? b")
@example(b"&a *a : 1")
def test_bytes_load_or_are_bad_input(content: bytes) -> None:
    judge(outcome(content))


@settings(max_examples=500, deadline=None)
@given(st.text(alphabet="ab: -[]{}&*!|>'\"#%@,?\n\\x0123~.eu<", max_size=60))
def test_text_that_looks_like_yaml_loads_or_is_bad_input(text: str) -> None:
    judge(outcome(text.encode()))


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="ab: -[]{}&*!|>'\"#%@,?\n\t\\x0123~.eu<\ufeff", max_size=60))
@example("a: {b: }")
@example("a: [{b: , c: 1}]")
@example("---")
@example("a:\t1")
@example("a\ufeff:")
@example("? a")
@example("a: {b: 1? }")
@example("a: &b\nc: *b\nd: {<<: {e: 'f'}}")
@example(" |#")
@example("a: >-#\n b")
def test_libyaml_reads_values_and_places_as_pyyaml_does(text: str) -> None:
    assert yaml_nodes._C_LOADER is not None

    def read(parser: Callable[[str, YamlSource], YamlNode | None]) -> YamlNode | str | None:
        try:
            return parser(text, YamlSource("x.yaml", tuple(text.splitlines())))
        except BadInput as error:
            return str(error)

    assert read(yaml_nodes.parse_nodes) == read(yaml_nodes._parse_with_messages)


scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
values = st.recursive(
    scalars,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["vehicle", "link", "sensors", "camera", "type", "box", "north_m", "x"]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


@settings(max_examples=300, deadline=None)
@given(values)
def test_any_value_is_checked_or_is_bad_input(value: object) -> None:
    text = json.dumps({"vehicle": value}).replace("NaN", ".nan").replace("Infinity", ".inf")
    found = outcome(text.encode())
    if isinstance(found, BadInput):
        return
    with contextlib.suppress(BadInput):
        assert isinstance(check_document(found, Top), Top)


@pytest.mark.parametrize(
    "text",
    [
        "a: {f: one @two}",
        "a: {f: 'one @two'}",
        'a: {f: "one @two"}',
        "a: {f: 'it''s one, @two'}",
        "a:\n  f: >\n    one\n    three  four\n    @two",
        "a:\n  f: |\n    one\n\n    @two\n    three",
        "a:\n  f: one\n    three\n    @two",
        'a:\n  f: "one\n    @two"',
        "a: {f: @two}",
    ],
)
def test_a_place_within_a_text(text: str) -> None:
    document = doc(text.replace("@", ""))
    value = document.get(("a", "f"))
    assert isinstance(value, str)
    problem = document.problem_within(("a", "f"), value.index("two"), "here")
    before = text[: text.index("@")]
    assert (problem.line, problem.column) == (
        before.count("\n") + 1,
        len(before) - (before.rfind("\n") + 1) + 1,
    )


@pytest.mark.parametrize("text", [r'a: {f: "one \t two"}', "a: {f: 5}"])
def test_a_place_within_an_escaped_value_is_its_beginning(text: str) -> None:
    assert doc(text).problem_within(("a", "f"), 7, "here").column == 8


@given(st.text("ab '\"\n\t\\|>é", max_size=20), st.integers(-1, 25))
def test_any_place_within_any_text_is_a_place(value: str, offset: int) -> None:
    document = doc(f"a: {json.dumps(value, ensure_ascii=False)}")
    problem = document.problem_within(("a",), offset, "here")
    assert problem.line >= 1
    assert problem.column >= 1
