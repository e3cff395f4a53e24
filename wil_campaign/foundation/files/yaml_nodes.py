"""Parses YAML text into nodes with places; the core schema of YAML 1.2, not PyYAML's 1.1.

Only true and false are booleans (`on`, `yes` and `no` are words), `12:30:00` and dates are text,
`1e-3` is a number, and keys are always text. Values that are not finite (`.nan`, `.inf`, `1e999`)
stay text, so that they are refused as numbers. Depth, size and aliases are limited.
"""

import math
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import yaml

from wil_campaign.foundation.files.problems import BadInput, Problem

Scalar = str | int | float | bool | None
Data = Scalar | dict[str, "Data"] | list["Data"]
"""The value of a node, as plain values."""

MAX_DEPTH = 40
MAX_NODES = 100_000
_C_LOADER: Any = getattr(yaml, "CSafeLoader", None)
"""The parser of libyaml, seven times as fast as PyYAML's own; None where PyYAML lacks it."""
_PARSED_DIFFERENTLY = re.compile(r"[^\n -~\u00a1-\ud7ff]|[?\u2028\u2029]|[|>][-+0-9]*#")
"""What libyaml parses differently from PyYAML: tabs, `?`, BOMs, other line breaks, and a comment
directly behind the header of a block scalar."""
_CACHED_TEXTS = 64
_LARGEST_CACHED = 50_000
"""The cache of parsed texts: how many, and the most characters of each."""

_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INT = re.compile(r"[-+]?[0-9]{1,40}")
_BASED = re.compile(r"0x[0-9a-fA-F]{1,32}|0o[0-7]{1,40}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


@dataclass(frozen=True, slots=True)
class YamlSource:
    """The source of YAML text: its name in messages, and its lines."""

    name: str
    lines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class YamlPlace:
    """A place in YAML text; line and column count from 1, line 0 is the source as a whole."""

    source: YamlSource
    line: int = 0
    column: int = 0

    def problem(self, message: str, suggestion: str = "") -> Problem:
        """Return a problem at this place; a source without lines is an option, not a file."""
        lines = self.source.lines
        if not lines:
            return Problem(self.source.name, 0, 0, message, suggestion=suggestion)
        text = lines[self.line - 1] if 0 < self.line <= len(lines) else ""
        return Problem(self.source.name, self.line, self.column, message, text, suggestion)


@dataclass(frozen=True, slots=True)
class YamlNode:
    """A YAML value and its place; `size` counts nodes beneath with aliases expanded."""

    value: "Scalar | dict[str, YamlEntry] | tuple[YamlNode, ...]"
    place: YamlPlace
    size: int = 1
    height: int = 1


@dataclass(frozen=True, slots=True)
class YamlEntry:
    """A YAML mapping's entry: the place of the key, and the value's node."""

    key: YamlPlace
    node: YamlNode


def mapping_node(entries: dict[str, YamlEntry], place: YamlPlace) -> YamlNode:
    """Return the YAML node of a mapping."""
    return _check_size(entries, [entry.node for entry in entries.values()], place)


def sequence_node(items: tuple[YamlNode, ...], place: YamlPlace) -> YamlNode:
    """Return the YAML node of a sequence."""
    return _check_size(items, list(items), place)


def _check_size(
    value: dict[str, YamlEntry] | tuple[YamlNode, ...], children: list[YamlNode], place: YamlPlace
) -> YamlNode:
    size = 1 + sum(child.size for child in children)
    return YamlNode(value, place, size, 1 + max((child.height for child in children), default=0))


def plain_value_of_node(node: YamlNode) -> Data:
    """Return a YAML node's value as new dicts, lists and scalars."""
    if isinstance(node.value, dict):
        return {key: plain_value_of_node(entry.node) for key, entry in node.value.items()}
    if isinstance(node.value, tuple):
        return [plain_value_of_node(item) for item in node.value]
    return node.value


def parse_nodes(text: str, source: YamlSource) -> YamlNode | None:
    """Return the root node of the YAML text's one document; None when there is none.

    Raises BadInput with every problem found: syntax, duplicate keys, tags, several documents,
    aliases of themselves or too many of them, nesting deeper than MAX_DEPTH.
    """
    return (_parse_cached if len(text) <= _LARGEST_CACHED else _parse)(text, source)


def _parse(text: str, source: YamlSource) -> YamlNode | None:
    """Return the root node by libyaml; by PyYAML where libyaml refuses, for its messages."""
    if _C_LOADER is not None and not _PARSED_DIFFERENTLY.search(text):
        fast = _Builder(text, source, _C_LOADER)
        with suppress(yaml.YAMLError, ValueError, OverflowError, BadInput):
            root = fast.document()
            if not fast.problems and not fast.has_doubtful_place:
                return root
    return _parse_with_messages(text, source)


def _parse_with_messages(text: str, source: YamlSource) -> YamlNode | None:
    builder = _Builder(text, source, yaml.SafeLoader)
    try:
        root = builder.document()
    except yaml.MarkedYAMLError as error:
        builder.problems.append(_syntax_problem(error, source, text))
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        column = error.position - (before.rfind("\n") + 1) + 1
        place = YamlPlace(source, before.count("\n") + 1, column)
        builder.problems.append(place.problem("a character that YAML does not allow"))
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        builder.problems.append(YamlPlace(source).problem(f"not YAML: {error}"))
    if builder.problems:
        raise BadInput(builder.problems)
    return root


_parse_cached = lru_cache(maxsize=_CACHED_TEXTS)(_parse)
"""A campaign names the same world and the same profiles in every case."""


def _syntax_problem(error: yaml.MarkedYAMLError, source: YamlSource, text: str) -> Problem:
    begun = error.context_mark
    if begun is not None and error.problem == _NO_COLON:
        # The scanner notices it at the next key: the place is where this one begins.
        line = text[text.rfind("\n", 0, begun.index) + 1 :].partition("\n")[0].strip()
        return YamlPlace(source, begun.line + 1, begun.column + 1).problem(f"'{line}' needs a ':'")
    mark = error.problem_mark or error.context_mark
    place = YamlPlace(source, mark.line + 1, mark.column + 1) if mark else YamlPlace(source)
    parts = [part for part in (error.context, error.problem) if part]
    return place.problem("not YAML: " + ", ".join(parts))


_NO_COLON = "could not find expected ':'"


class _Builder:
    """Builds YAML nodes from the parser's events, one document, noting problems."""

    def __init__(self, text: str, source: YamlSource, loader: Any) -> None:
        self.problems: list[Problem] = []
        self.has_doubtful_place = False
        """Whether an empty value may have another place in libyaml than in PyYAML."""
        self._flows = 0
        self._source = source
        self._events: Iterator[Any] = yaml.parse(text, Loader=loader)
        self._anchors: dict[str, YamlNode | None] = {}
        self._total = 0

    def document(self) -> YamlNode | None:
        """Return the root node of the one YAML document; None when there is none."""
        next(self._events)
        if isinstance(next(self._events), yaml.StreamEndEvent):
            return None
        root = self._node(next(self._events), 1)
        next(self._events)
        after = next(self._events)
        if not isinstance(after, yaml.StreamEndEvent):
            self._note(after, "a second YAML document begins here; a file holds one")
        return root

    def _note(self, event: Any, message: str, suggestion: str = "") -> None:
        self.problems.append(self._place(event).problem(message, suggestion))

    def _place(self, event: Any) -> YamlPlace:
        mark = event.start_mark
        return YamlPlace(self._source, mark.line + 1, mark.column + 1)

    def _fatal(self, event: Any, message: str) -> BadInput:
        """Return the BadInput of a YAML event after which reading must stop."""
        return BadInput([*self.problems, self._place(event).problem(message)])

    def _node(self, event: Any, depth: int) -> YamlNode:
        if depth > MAX_DEPTH:
            raise self._fatal(event, f"nested more than {MAX_DEPTH} deep")
        if isinstance(event, yaml.AliasEvent):
            node = self._alias(event)
        else:
            node = self._check_anchor(event, depth)
        self._total += node.size if isinstance(event, yaml.AliasEvent) else 1
        if self._total > MAX_NODES or node.height + depth > MAX_DEPTH + 1:
            limits = f"{MAX_NODES} values or {MAX_DEPTH} levels"
            raise self._fatal(event, f"more than {limits} once aliases are written out")
        return node

    def _check_anchor(self, event: Any, depth: int) -> YamlNode:
        """Note a YAML tag, and remember an anchor; refuse too deep nesting."""
        if event.tag not in (None, "!"):
            self._note(event, f"tag '{event.tag}': tags are not used in these files")
        if event.anchor:
            self._anchors[event.anchor] = None
        if isinstance(event, yaml.MappingStartEvent):
            node = self._mapping(event, depth)
        elif isinstance(event, yaml.SequenceStartEvent):
            node = self._sequence(event, depth)
        else:
            node = self._scalar(event)
        if event.anchor:
            self._anchors[event.anchor] = node
        return node

    def _alias(self, event: Any) -> YamlNode:
        """Return the node that a YAML alias refers to; a bad one is noted."""
        node = self._anchors.get(event.anchor)
        if node is not None:
            return node
        if event.anchor in self._anchors:
            self._note(event, f"'*{event.anchor}' is inside the value that it refers to")
        else:
            self._note(event, f"'*{event.anchor}' refers to no '&{event.anchor}' above")
        return YamlNode(None, self._place(event))

    def _sequence(self, start: Any, depth: int) -> YamlNode:
        items: list[YamlNode] = []
        self._flows += bool(start.flow_style)
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._node(event, depth + 1))
        self._flows -= bool(start.flow_style)
        return sequence_node(tuple(items), self._place(start))

    def _mapping(self, start: Any, depth: int) -> YamlNode:
        """Return the node of a YAML mapping; repeated keys are noted."""
        own: dict[str, YamlEntry] = {}
        merged: dict[str, YamlEntry] = {}
        self._flows += bool(start.flow_style)
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key = self._key(event, depth)
            node = self._node(next(self._events), depth + 1)
            if key == "<<" and not event.style:
                merged = {**self._merge_keys(event, node), **merged}
            elif key is not None and key in own:
                first = own[key].key.line
                self._note(event, f"key '{key}' is declared twice, first in line {first}")
            elif key is not None:
                own[key] = YamlEntry(self._place(event), node)
        self._flows -= bool(start.flow_style)
        return mapping_node({**merged, **own}, self._place(start))

    def _merge_keys(self, event: Any, node: YamlNode) -> dict[str, YamlEntry]:
        """Return the entries that YAML's `<<` brings; of several mappings the first wins."""
        merged: dict[str, YamlEntry] = {}
        for part in node.value if isinstance(node.value, tuple) else (node,):
            if isinstance(part.value, dict):
                merged = {**part.value, **merged}
            else:
                self._note(event, "'<<' takes a mapping, or a list of mappings")
        return merged

    def _key(self, event: Any, depth: int) -> str | None:
        """Return the key of a YAML mapping's entry; one that is no scalar is noted."""
        if isinstance(event, yaml.ScalarEvent):
            self._check_anchor(event, depth)
            return str(event.value)
        self._note(event, "a key must be a word; quote text that begins with '{', '[' or '*'")
        self._node(event, depth + 1)
        return None

    def _scalar(self, event: Any) -> YamlNode:
        place = self._place(event)
        text = str(event.value)
        # In braces, brackets, and where it is the whole document.
        if not text and (self._flows or event.start_mark.column == 0):
            self.has_doubtful_place = True
        if any("\ud800" <= letter <= "\udfff" for letter in text):
            self._note(event, "an unpaired surrogate is not a character")
            return YamlNode(None, place)
        return YamlNode(text if event.style or event.tag else _resolve(text), place)


def yaml_of_word(word: str) -> str:
    """Return how a word of letters, digits, dots, dashes and underscores is written as text."""
    return word if isinstance(_resolve(word), str) else f"'{word}'"


def _resolve(text: str) -> Scalar:
    """Return a plain YAML scalar's value by the core schema of YAML 1.2 (section 10.3.2)."""
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        return int(text)
    if _BASED.fullmatch(text):
        return int(text, 0)
    if _FLOAT.fullmatch(text) and math.isfinite(number := float(text)):
        return number
    return text


def place_within(node: YamlNode, offset: int) -> YamlPlace:
    """Return the place of a character of a YAML text value, by its offset in the text.

    A text is followed through the source: quotes, doubled quotes, and line breaks that became
    spaces are taken into account. Where that fails (escapes), it is the beginning of the text.
    """
    place, text = node.place, node.value
    if not isinstance(text, str) or not place.source.lines or not 0 <= offset <= len(text):
        return place
    raw = "\n".join(place.source.lines[place.line - 1 :])
    at = place.column - 1
    quote = raw[at] if raw[at : at + 1] in {"'", '"'} else ""
    at += len(quote)
    if raw[at : at + 1] in {"|", ">"} and not quote:
        at = raw.index("\n", at) + 1
    for letter in text[:offset]:
        at = _after_letter(raw, at, letter, quote)
        if at < 0:
            return place
    while at < len(raw) and offset < len(text) and raw[at].isspace() and not text[offset].isspace():
        at += 1
    before = raw[:at]
    line = before.count("\n")
    return YamlPlace(place.source, place.line + line, at - (before.rfind("\n") + 1) + 1)


def _after_letter(raw: str, at: int, letter: str, quote: str) -> int:
    """Return the index after one letter in the YAML source; -1 when it is not there."""
    if letter.isspace():
        while at < len(raw) and raw[at].isspace():
            at += 1
        return at if raw[at - 1].isspace() else -1
    while at < len(raw) and raw[at].isspace():
        at += 1
    if at >= len(raw) or raw[at] != letter:
        return -1
    return at + (2 if letter == quote == "'" else 1)
