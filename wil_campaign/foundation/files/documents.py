"""YAML documents with the line and column of every value, so that each fault shows its place.

World, recipe and campaign files share this: `load` a file, `check` it against a model, and
report what else is wrong with `Document.problem`.
"""

import codecs
import json
import re
import stat
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from wil_campaign.foundation.files.model_keys import LaterType, Path
from wil_campaign.foundation.files.paths import require_utf8
from wil_campaign.foundation.files.problems import BadInput, Problem, closest_file, closest_word
from wil_campaign.foundation.files.validation import (
    KeyFaultError,
    Part,
    describe_value,
    validation_faults,
)
from wil_campaign.foundation.files.yaml_nodes import (
    MAX_DEPTH,
    Data,
    Scalar,
    YamlEntry,
    YamlNode,
    YamlPlace,
    YamlSource,
    mapping_node,
    parse_nodes,
    place_within,
    plain_value_of_node,
    sequence_node,
)

__all__ = [
    "BadInput",
    "Data",
    "Document",
    "KeyFaultError",
    "LaterType",
    "Part",
    "Path",
    "Problem",
    "YamlEntry",
    "check_document",
    "closest_file",
    "closest_word",
    "load_document",
    "parse_document",
    "parse_option_value",
    "read_document_bytes",
    "rows_document",
]

MAX_BYTES = 1_000_000

Model = TypeVar("Model", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Document:
    """A YAML document's data with its places. path: the file, for what is relative to it."""

    path: FilePath
    root: YamlNode

    @property
    def data(self) -> Data:
        """Return the document's whole content as new plain values."""
        return plain_value_of_node(self.root)

    @property
    def name(self) -> str:
        """Return the document's file name as the user gave it."""
        return self.root.place.source.name

    def get(self, path: Path, default: Data = None) -> Data:
        """Return the plain value at a path of the document; the default when there is none."""
        entry, rest = self._reach(path)
        return default if rest else plain_value_of_node(entry.node)

    def entry(self, path: Path) -> YamlEntry:
        """Return the document's key and value at a path. Raises KeyError when there is none."""
        entry, rest = self._reach(path)
        if rest:
            raise KeyError(path)
        return entry

    def place(self, path: Path, *, key: bool = False) -> tuple[int, int]:
        """Return line and column (from 1) of a value in the document, or of its key.

        For a path that does not exist: the place of the key of its last part that does.
        """
        spot = self._spot(path, key=key)
        return spot.line, spot.column

    def problem(
        self, path: Path, message: str, suggestion: str = "", *, key: bool = False
    ) -> Problem:
        """Return a problem with the document's value at a path, or with its key."""
        return self._spot(path, key=key).problem(message, suggestion)

    def problem_within(
        self, path: Path, offset: int, message: str, suggestion: str = ""
    ) -> Problem:
        """Return a problem with one character of the document's text at a path."""
        return place_within(self.entry(path).node, offset).problem(message, suggestion)

    def override(self, dotted_key: str, entry: YamlEntry) -> "Document":
        """Return the document with the value at a dotted key replaced by an entry.

        Places beneath are those of the entry, in its own file or option. Raises
        BadInput when the path leads through a value that is neither mapping nor list, or through a
        missing key that resembles an existing one, has an empty part, or more than MAX_DEPTH parts.
        """
        steps = tuple(dotted_key.split("."))
        if not all(steps):
            raise _override_error(entry, dotted_key, "a part between its dots is empty")
        if len(steps) > MAX_DEPTH:
            reason = f"has {len(steps)} parts, at most {MAX_DEPTH} are possible"
            raise _override_error(entry, dotted_key, reason)
        return Document(self.path, _replace_value(self.root, steps, entry, dotted_key))

    def without(self, keys: Collection[str]) -> "Document":
        """Return the document without some keys of its top level."""
        left = self.root.value
        if not isinstance(left, dict):
            return self
        left = {key: entry for key, entry in left.items() if key not in keys}
        return Document(self.path, mapping_node(left, self.root.place))

    def with_entries(self, keys: Collection[str], names: Collection[str]) -> "Document":
        """Return the document with no other than the named entries in mappings of its top level."""
        entries = self.root.value
        if not isinstance(entries, dict):
            return self
        kept = dict(entries)
        for key, entry in entries.items():
            if key in keys and isinstance(entry.node.value, dict):
                own = {name: one for name, one in entry.node.value.items() if name in names}
                kept[key] = replace(entry, node=mapping_node(own, entry.node.place))
        return Document(self.path, mapping_node(kept, self.root.place))

    def _spot(self, path: Path, *, key: bool) -> YamlPlace:
        entry, rest = self._reach(path)
        return entry.key if key or rest else entry.node.place

    def _reach(self, path: Path) -> tuple[YamlEntry, Path]:
        entry = YamlEntry(self.root.place, self.root)
        for index, step in enumerate(path):
            value = entry.node.value
            if isinstance(value, dict) and step in value:
                entry = value[str(step)]
            elif isinstance(value, tuple) and isinstance(step, int) and 0 <= step < len(value):
                entry = YamlEntry(value[step].place, value[step])
            else:
                return entry, path[index:]
        return entry, ()


def _replace_value(
    node: YamlNode, steps: tuple[str, ...], entry: YamlEntry, dotted_key: str
) -> YamlNode:
    step, rest = steps[0], steps[1:]
    value = {} if node.value is None else node.value
    if isinstance(value, tuple):
        if not (step.isascii() and step.isdigit() and int(step) < len(value)):
            count = f"a list of {len(value)}, indices begin at 0"
            raise _override_error(entry, dotted_key, f"'{step}' is not an index of {count}")
        items = list(value)
        inner = items[int(step)]
        items[int(step)] = _replace_value(inner, rest, entry, dotted_key) if rest else entry.node
        return sequence_node(tuple(items), node.place)
    if not isinstance(value, dict):
        raise _override_error(
            entry, dotted_key, f"'{step}' would be inside {describe_value(value)}"
        )
    if not rest:
        return mapping_node({**value, step: entry}, node.place)
    if step not in value and (meant := closest_word(step, value)):
        raise _override_error(entry, dotted_key, f"there is no '{step}'", meant)
    old = value.get(step, YamlEntry(entry.key, mapping_node({}, entry.key)))
    inside = _replace_value(old.node, rest, entry, dotted_key)
    return mapping_node({**value, step: YamlEntry(old.key, inside)}, node.place)


def _override_error(
    entry: YamlEntry, dotted_key: str, message: str, suggestion: str = ""
) -> BadInput:
    """Return the BadInput that a document cannot be overridden at a dotted key."""
    return BadInput([entry.key.problem(f"override '{dotted_key}': {message}", suggestion)])


def load_document(path: FilePath, name: str | None = None, *, json: bool = False) -> Document:
    """Return the YAML document in a file. name: what to call it in messages; None: the path.

    json: the file is JSON, which allows tabs between its tokens; the rest of JSON is YAML.

    Raises BadInput, with every problem found, for a file that is missing, unreadable, too big,
    not UTF-8 (its path, too) or not YAML, and for what `parse` refuses.
    """
    source = YamlSource(name if name is not None else str(path))
    content = read_document_bytes(path, source.name)
    if json:
        content = content.replace(b"\t", b" ")
    return parse_document(content, name=source.name, path=path)


def read_document_bytes(path: FilePath, name: str) -> bytes:
    """Return the bytes of a document's file. name: what to call it in messages.

    Raises BadInput for a file that is missing, unreadable or too big.
    """
    source = YamlSource(name)
    try:
        require_utf8(path)
        if not stat.S_ISREG(path.stat().st_mode):
            raise BadInput([YamlPlace(source).problem("is not a file")])
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else None
        raise BadInput([YamlPlace(source).problem(f"cannot be read: {reason or error}")]) from error
    if len(content) > MAX_BYTES:
        raise BadInput([YamlPlace(source).problem(f"is larger than {MAX_BYTES} bytes")])
    return content


def parse_document(content: bytes, *, name: str, path: FilePath | None = None) -> Document:
    """Return the YAML document in a file's bytes; its top level is a mapping.

    Raises BadInput for what is not UTF-8, not YAML, empty, several documents, duplicate keys,
    tags, and nesting or aliases beyond the limits of `foundation.files.yaml_nodes`.
    """
    text = _decode(content, YamlSource(name))
    source = YamlSource(name, tuple(text.splitlines()))
    root = parse_nodes(text, source)
    if root is None or root.value is None:
        raise BadInput([YamlPlace(source).problem("is empty")])
    if not isinstance(root.value, dict):
        message = f"the top level must be a mapping, is {describe_value(plain_value_of_node(root))}"
        raise BadInput([root.place.problem(message)])
    return Document(path if path is not None else FilePath(name), root)


def rows_document(
    content: bytes, *, name: str, key: str, value: Callable[[str], Scalar]
) -> Document:
    """Return a document of the rows of a text after its first line: lists of their words, at a key.

    value: of a word. Raises BadInput for what is not UTF-8.
    """
    text = _decode(content, YamlSource(name))
    source = YamlSource(name, tuple(text.splitlines()))
    rows = []
    for number, line in enumerate(source.lines[1:], start=2):
        words = tuple(
            YamlNode(value(found[0]), YamlPlace(source, number, found.start() + 1))
            for found in re.finditer(r"\S+", line)
        )
        if words:
            rows.append(sequence_node(words, YamlPlace(source, number, 1)))
    top = YamlPlace(source, 1, 1)
    return Document(
        FilePath(name), mapping_node({key: YamlEntry(top, sequence_node(tuple(rows), top))}, top)
    )


def parse_option_value(text: str, *, name: str) -> YamlEntry:
    """Return the value of an option such as --set KEY=VALUE; `name` is the whole option.

    Raises BadInput when the text is not YAML. An empty text is an empty value.
    """
    source = YamlSource(name)
    root = parse_nodes(text, source)
    return YamlEntry(
        YamlPlace(source), root if root is not None else YamlNode(None, YamlPlace(source))
    )


def _decode(content: bytes, source: YamlSource) -> str:
    """Return a document's bytes as text. Raises BadInput when they are no UTF-8 text."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise BadInput([YamlPlace(source).problem("is UTF-16 text; save it as UTF-8")])
    if b"\0" in content:
        raise BadInput([YamlPlace(source).problem("is not text (it has NUL bytes)")])
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start]
        column = error.start - (before.rfind(b"\n") + 1) + 1
        shown = YamlSource(source.name, tuple(content.decode(errors="replace").splitlines()))
        place = YamlPlace(shown, before.count(b"\n") + 1, column)
        raise BadInput([place.problem("is not UTF-8 text")]) from error


def check_document(document: Document, model: type[Model], at: Path = ()) -> Model:
    """Return a document's value at a path as a pydantic model. Raises BadInput.

    Raises BadInput with every fault at once, in order of their places.
    """
    value = document.get(at)
    try:
        return model.model_validate_json(json.dumps(value), strict=True)
    except ValidationError as error:
        problems = [
            document.problem((*at, *fault.path), fault.message, fault.suggestion, key=fault.on_key)
            for fault in validation_faults(error, value, model)
        ]
    raise BadInput(sorted(problems, key=lambda problem: (problem.line, problem.column)))
