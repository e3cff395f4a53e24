"""What pydantic says about a value, in words for people and with the path of each fault.

Pure: an error, the value and its model in; faults (path, message, suggestion) out.
"""

import re
import types
import typing
from collections.abc import Iterable
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from worlds.problems import closest
from worlds.yaml_nodes import Data

Path = tuple[str | int, ...]


class Part(BaseModel):
    """What every part of a file is built on: no unknown keys, no NaN, nothing converted."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class KeyFaultError(ValueError):
    """A fault that a model's validator finds in one of its keys; `check` puts it there."""

    def __init__(self, key: str | int | Path, message: str, suggestion: str = "") -> None:
        super().__init__(message)
        self.path: Path = key if isinstance(key, tuple) else (key,)
        self.suggestion = suggestion


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing wrong at a path; on_key: with the key itself, not with its value."""

    path: Path
    message: str
    suggestion: str = ""
    on_key: bool = False


_WANTED = {
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "dict_type": "a mapping",
    "mapping_type": "a mapping",
    "dataclass_type": "a mapping",
    "list_type": "a list",
    "tuple_type": "a list",
    "set_type": "a list",
    "frozen_set_type": "a list",
    "string_type": "text",
    "path_type": "text (a path)",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "none_required": "empty",
}
_COMPARED = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
    "multiple_of": ("a multiple of", "multiple_of"),
}


def faults_of(error: ValidationError, value: Data, model: type[BaseModel]) -> list[Fault]:
    """Return what is wrong, one fault for one mistake; paths are relative to `value`."""
    details = [_located(detail, value) for detail in error.errors(include_url=False)]
    faults = [_fault(path, detail, model, value) for path, detail in _settle_unions(details)]
    return _without_echoes(faults)


@dataclass(frozen=True, slots=True)
class _Located:
    path: Path
    branches: tuple[tuple[Path, str], ...]
    """Where a union was tried on the way, and which member; from the outside in."""
    detail: ErrorDetails


def _located(detail: ErrorDetails, value: Data) -> _Located:
    """Split a location of pydantic into the path in the file and the members of unions."""
    path: list[str | int] = []
    branches: list[tuple[Path, str]] = []
    here: object = value
    location = detail["loc"]
    for index, step in enumerate(location):
        last = index == len(location) - 1
        if step == "[key]" and last:
            continue
        found, below = _descend(here, step)
        if found or (last and detail["type"] == "missing"):
            path.append(step)
            here = below
        else:
            branches.append((tuple(path), str(step)))
    return _Located(tuple(path), tuple(branches), detail)


def _descend(here: object, step: str | int) -> tuple[bool, object]:
    if isinstance(here, dict) and step in here:
        return True, here[step]
    if isinstance(here, list) and isinstance(step, int) and 0 <= step < len(here):
        return True, here[step]
    return False, None


def _settle_unions(located: list[_Located]) -> list[tuple[Path, ErrorDetails]]:
    """Keep, where several members of a union complained, the one that fits the value best."""
    kept = located
    depth = max((len(item.branches) for item in located), default=0)
    for level in range(depth):
        best = _best_members(kept, level)
        kept = [
            item
            for item in kept
            if len(item.branches) <= level or item.branches[level][1] == best[_union(item, level)]
        ]
    return [(item.path, _all_wanted(item, located)) for item in kept]


def _union(item: _Located, level: int) -> tuple[tuple[Path, str] | Path, ...]:
    return (*item.branches[:level], item.branches[level][0])


def _best_members(located: list[_Located], level: int) -> dict[tuple[object, ...], str]:
    """Return for each union the member of fewest complaints, those of a wrong type last."""
    costs: dict[tuple[object, ...], dict[str, float]] = {}
    for item in located:
        if len(item.branches) > level:
            members = costs.setdefault(_union(item, level), {})
            at_union = item.path == item.branches[level][0] and item.detail["type"] in _WANTED
            if item.path == item.branches[level][0] and item.detail["type"] == "literal_error":
                at_union = not isinstance(item.detail["input"], str)
            name = item.branches[level][1]
            members[name] = members.get(name, 0.0) + (100.0 if at_union else 1.0)
    return {union: min(members, key=lambda name: members[name]) for union, members in costs.items()}


def _all_wanted(item: _Located, located: list[_Located]) -> ErrorDetails:
    """Name every member of the union when the value has the type of none of them."""
    if item.detail["type"] not in _WANTED or not item.branches or item.path != item.branches[-1][0]:
        return item.detail
    wanted: dict[str, None] = {}
    for rival in located:
        if rival.path == item.path:
            wanted |= dict.fromkeys(_wanted_by(rival.detail))
    detail = item.detail.copy()
    detail["ctx"] = {**detail.get("ctx", {}), "wanted": _either(wanted)}
    return detail


def _wanted_by(detail: ErrorDetails) -> list[str]:
    if detail["type"] == "literal_error":
        return [f"'{word}'" for word in _quoted(str(detail.get("ctx", {})["expected"]))]
    return [_WANTED[detail["type"]]] if detail["type"] in _WANTED else []


def _either(words: Iterable[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last


def _fault(path: Path, detail: ErrorDetails, model: type[BaseModel], value: Data) -> Fault:
    kind, context = detail["type"], detail.get("ctx", {})
    cause = context.get("error")
    if kind == "missing":
        return Fault(path[:-1], f"missing key '{path[-1]}'", on_key=True)
    if kind == "union_tag_not_found":
        return Fault(path, f"missing key {context['discriminator']}", on_key=True)
    if kind == "extra_forbidden":
        return _unknown_key(path, known_keys(model, path[:-1], value))
    if isinstance(cause, KeyFaultError):
        return Fault((*path, *cause.path), str(cause), cause.suggestion)
    if kind in {"literal_error", "enum", "union_tag_invalid"}:
        return _choice_fault(path, detail)
    return Fault(path, str(cause) if cause is not None else _mismatch(detail))


def _choice_fault(path: Path, detail: ErrorDetails) -> Fault:
    context = detail.get("ctx", {})
    if detail["type"] != "union_tag_invalid":
        return _wrong_word(path, detail["input"], _quoted(str(context["expected"])))
    inside = (*path, str(context["discriminator"]).strip("'"))
    return _wrong_word(inside, context["tag"], _quoted(str(context["expected_tags"])))


def _mismatch(detail: ErrorDetails) -> str:
    """Return the message of a value of the wrong type or size."""
    kind, given, said = detail["type"], detail["input"], detail["msg"]
    context = detail.get("ctx", {})
    if kind in _COMPARED:
        words, key = _COMPARED[kind]
        return f"must be {words} {context[key]}, is {describe(given)}"
    if kind in _WANTED:
        wanted = context.get("wanted", _WANTED[kind])
        return f"must be {wanted}, is {describe(given)}{_hint(str(wanted), given)}"
    if kind in {"too_short", "too_long"}:
        words, key = ("least", "min_length") if kind == "too_short" else ("most", "max_length")
        return f"must have at {words} {context[key]} entries, has {context['actual_length']}"
    if kind == "string_too_short":
        return "must not be empty" if context["min_length"] == 1 else said
    return said.replace("Input should", "must").replace("Value error, ", "")


def _hint(wanted: str, given: object) -> str:
    if "number" not in wanted or not isinstance(given, str):
        return ""
    if re.fullmatch(r"\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*", given):
        return " (leave out the quotes)"
    if re.match(r"\s*[-+]?[0-9.]+\s*[A-Za-z/°%]", given):
        return " (a plain number; its unit stands in the key)"
    return ""


def describe(given: object) -> str:
    """Return a value as a message shows it, short."""
    if given is None:
        return "empty"
    if isinstance(given, bool):
        return "true" if given else "false"
    if isinstance(given, dict):
        return "a mapping"
    if isinstance(given, list | tuple):
        return f"a list of {len(given)}"
    if isinstance(given, str):
        return f"the text '{given[:60]}'"
    return str(given)[:60]


def _quoted(expected: str) -> list[str]:
    return re.findall(r"'([^']*)'", expected) or re.split(r",\s*|\s+or\s+", expected)


def _wrong_word(path: Path, given: object, known: list[str]) -> Fault:
    shown = f"'{given}'" if isinstance(given, str) else describe(given)
    choice = f"must be {_either(known)}" if known else "has no choice"
    meant = closest(given, known) if isinstance(given, str) else ""
    return Fault(path, f"{choice}, is {shown}", meant)


def _unknown_key(path: Path, known: list[str]) -> Fault:
    meant = closest(str(path[-1]), known)
    message = f"unknown key '{path[-1]}'"
    if not meant and known:
        message += f" (known here: {', '.join(known)})"
    return Fault(path, message, meant, on_key=True)


def _without_echoes(faults: list[Fault]) -> list[Fault]:
    """Drop "missing x" where "unknown y; did you mean x" is said, and what is said twice."""
    meant = {(fault.path[:-1], fault.suggestion) for fault in faults if "unknown" in fault.message}
    kept: dict[Fault, None] = {}
    for fault in faults:
        missing = re.fullmatch(r"missing key '(.*)'", fault.message)
        if missing is None or (fault.path, missing[1]) not in meant:
            kept[fault] = None
    return list(kept)


def known_keys(model: type[BaseModel], path: Path, value: Data) -> list[str]:
    """Return the keys that may stand in the mapping at `path` of a value of this model."""
    candidates: list[object] = [model]
    here: object = value
    for step in path:
        _, here = _descend(here, step)
        candidates = [inner for candidate in candidates for inner in _inside(candidate, step, here)]
    names: dict[str, None] = {}
    for candidate in candidates:
        for name in _fields(candidate) if _may_be(candidate, here) else ():
            names[name] = None
    return list(names)


def _fields(candidate: object) -> dict[str, object]:
    if not (isinstance(candidate, type) and issubclass(candidate, BaseModel)):
        return {}
    return {field.alias or name: field.annotation for name, field in candidate.model_fields.items()}


def _may_be(candidate: object, here: object) -> bool:
    """Return whether no literal field (`type: camera`) of the candidate contradicts the value."""
    if not isinstance(here, dict):
        return True
    return all(
        here.get(name) in typing.get_args(annotation)
        for name, annotation in _fields(candidate).items()
        if typing.get_origin(annotation) is typing.Literal and name in here
    )


def _inside(candidate: object, step: str | int, below: object) -> list[object]:
    """Return the types that the value under one key or index of a candidate may have."""
    fields = _fields(candidate)
    if fields:
        return _members(fields[str(step)]) if step in fields else []
    arguments = [a for a in typing.get_args(candidate) if a is not Ellipsis]
    if not arguments:
        return []
    is_map = isinstance(step, str)
    picked = arguments[-1] if is_map or len(arguments) <= int(step) else arguments[int(step)]
    return [member for member in _members(picked) if _may_be(member, below)]


def _members(annotation: object) -> list[object]:
    """Return the types an annotation stands for: members of a union, contents of Annotated."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _members(typing.get_args(annotation)[0])
    if origin in {typing.Union, types.UnionType}:
        return [m for part in typing.get_args(annotation) for m in _members(part)]
    return [annotation]
