"""Converts pydantic's errors into faults with readable messages and paths.

Pure: an error, the value and its model in; faults (path, message, suggestion) out.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from wil_campaign.foundation.files.model_keys import Path, descend_value, known_keys
from wil_campaign.foundation.files.problems import closest_word
from wil_campaign.foundation.files.yaml_nodes import Data


class Part(BaseModel):
    """The base model of every part of a file: no unknown keys, no NaN, strict types.

    Its validator is built when it is first used: few processes read every kind of file.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True
    )


class KeyFaultError(ValueError):
    """A fault that a model's validator finds in one of its keys; `check` locates it."""

    def __init__(self, key: str | int | Path, message: str, suggestion: str = "") -> None:
        super().__init__(message)
        self.path: Path = key if isinstance(key, tuple) else (key,)
        self.suggestion = suggestion


@dataclass(frozen=True, slots=True)
class ValidationFault:
    """A validation fault at a path; on_key: concerns the key itself, not its value."""

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


def validation_faults(
    error: ValidationError, value: Data, model: type[BaseModel]
) -> list[ValidationFault]:
    """Return the faults of a pydantic ValidationError; paths are relative to `value`."""
    errors = error.errors(include_url=False)
    details = [_locate(detail, value) for detail in errors if not _counts_good_ones(detail)]
    faults = [_fault(path, detail, model, value) for path, detail in _settle_unions(details)]
    return _without_echoes(faults)


def _counts_good_ones(detail: ErrorDetails) -> bool:
    """Return whether a too-short list fault only follows from wrong entries."""
    given = detail["input"]
    short = detail["type"] == "too_short" and isinstance(given, list)
    return short and len(given) >= detail["ctx"]["min_length"]


@dataclass(frozen=True, slots=True)
class _Located:
    """A validation error located in the file: its path and the union members tried."""

    path: Path
    branches: tuple[tuple[Path, str], ...]
    """Where a union was tried on the way, and which member; from the outside in."""
    detail: ErrorDetails


def _locate(detail: ErrorDetails, value: Data) -> _Located:
    """Return a pydantic error's location split into file path and union members."""
    path: list[str | int] = []
    branches: list[tuple[Path, str]] = []
    here: object = value
    location = detail["loc"]
    for index, step in enumerate(location):
        last = index == len(location) - 1
        if step == "[key]" and last:
            continue
        found, below = descend_value(here, step)
        if found or (last and detail["type"] == "missing"):
            path.append(step)
            here = below
        else:
            branches.append((tuple(path), str(step)))
    return _Located(tuple(path), tuple(branches), detail)


def _settle_unions(located: list[_Located]) -> list[tuple[Path, ErrorDetails]]:
    """Return validation errors without those of union members that fit worse."""
    kept = located
    depth = max((len(item.branches) for item in located), default=0)
    for level in range(depth):
        best = _best_members(kept, level)
        kept = [
            item
            for item in kept
            if len(item.branches) <= level or item.branches[level][1] == best[_union(item, level)]
        ]
    return [(item.path, _all_wanted_keys(item, located)) for item in kept]


def _union(item: _Located, level: int) -> tuple[tuple[Path, str] | Path, ...]:
    """Return the path and position of the union in which a validation error arose."""
    return (*item.branches[:level], item.branches[level][0])


def _best_members(located: list[_Located], level: int) -> dict[tuple[object, ...], str]:
    """Return for each union the member of fewest validation errors, wrong types last."""
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


def _all_wanted_keys(item: _Located, located: list[_Located]) -> ErrorDetails:
    """Return the fault naming every union member when the value fits none by type."""
    if not _wanted_by(item.detail) or not item.branches or item.path != item.branches[-1][0]:
        return item.detail
    wanted: dict[str, None] = {}
    for rival in located:
        if rival.path == item.path:
            wanted |= dict.fromkeys(_wanted_by(rival.detail))
    detail = item.detail.copy()
    detail["ctx"] = {**detail.get("ctx", {}), "wanted": _either(wanted)}
    return detail


def _wanted_by(detail: ErrorDetails) -> list[str]:
    """Return the names of the values or types that a validation error demands."""
    if detail["type"] == "literal_error":
        return _quote(str(detail.get("ctx", {})["expected"]))
    return [_WANTED[detail["type"]]] if detail["type"] in _WANTED else []


def _either(words: Iterable[str]) -> str:
    """Return words joined by commas and "or" for a validation message."""
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last


def _fault(
    path: Path, detail: ErrorDetails, model: type[BaseModel], value: Data
) -> ValidationFault:
    kind, context = detail["type"], detail.get("ctx", {})
    cause = context.get("error")
    if kind in {"missing", "union_tag_not_found"}:
        return _missing_fault(path, detail)
    if kind == "extra_forbidden":
        return _unknown_key(path, known_keys(model, path[:-1], value))
    if isinstance(cause, KeyFaultError):
        return ValidationFault((*path, *cause.path), str(cause), cause.suggestion)
    if kind in {"literal_error", "enum", "union_tag_invalid"}:
        return _choice_fault(path, detail)
    on_key = detail["loc"][-1:] == ("[key]",)
    message = str(cause) if cause is not None else _mismatch(detail)
    return ValidationFault(path, message, on_key=on_key)


def _missing_fault(path: Path, detail: ErrorDetails) -> ValidationFault:
    """Return the fault of a missing key or of too few entries."""
    if detail["type"] == "union_tag_not_found":
        return ValidationFault(path, f"missing key {detail['ctx']['discriminator']}", on_key=True)
    if isinstance(path[-1], int):
        return ValidationFault(path[:-1], f"has too few entries ({len(detail['input'])})")
    return ValidationFault(path[:-1], f"missing key '{path[-1]}'", on_key=True)


def _choice_fault(path: Path, detail: ErrorDetails) -> ValidationFault:
    """Return the fault of a value outside its choices, with the probable one."""
    context, given = detail.get("ctx", {}), detail["input"]
    if detail["type"] == "union_tag_invalid":
        path = (*path, str(context["discriminator"]).strip("'"))
        given, known = context["tag"], _quote(str(context["expected_tags"]))
    else:
        known = _quote(str(context["expected"]))
    wanted = context.get("wanted", _either(known))
    shown = f"'{given}'" if isinstance(given, str) else describe_value(given)
    meant = closest_word(given, known) if isinstance(given, str) else ""
    return ValidationFault(path, f"must be {wanted}, is {shown}", meant)


def _mismatch(detail: ErrorDetails) -> str:
    """Return the validation message of a value of the wrong type or size."""
    kind, given, message = detail["type"], detail["input"], detail["msg"]
    context = detail.get("ctx", {})
    if kind in _COMPARED:
        words, key = _COMPARED[kind]
        return f"must be {words} {context[key]:g}, is {describe_value(given)}"
    if kind in _WANTED:
        wanted = context.get("wanted", _WANTED[kind])
        return f"must be {wanted}, is {describe_value(given)}{_hint(str(wanted), given)}"
    if kind in {"too_short", "too_long"}:
        words, key = ("least", "min_length") if kind == "too_short" else ("most", "max_length")
        return f"must have at {words} {context[key]} entries, has {context['actual_length']}"
    if kind == "string_too_short":
        return "must not be empty" if context["min_length"] == 1 else message
    return message.replace("Input should", "must").replace("Value error, ", "")


def _hint(wanted: str, given: object) -> str:
    """Return a validation hint about a text where a number is required; "" without one."""
    if "number" not in wanted or not isinstance(given, str):
        return ""
    if re.fullmatch(r"\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?\s*", given):
        if math.isinf(_number(given)):
            return " (it must be finite)"
        return " (leave out the quotes)" if len(given) < 20 and "e" not in given.lower() else ""
    if given.lower().strip("+-") in {".nan", "nan", ".inf", "inf", "infinity"}:
        return " (it must be finite)"
    if re.match(r"\s*[-+]?[0-9.]+\s*[A-Za-z/°%]", given):
        return " (a plain number; the key has its unit)"
    return ""


def _number(text: str) -> float:
    """Return the number in a text for a validation hint; 0 when there is none."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def describe_value(given: object) -> str:
    """Return a value as a validation message shows it, short."""
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


def _quote(expected: str) -> list[str]:
    """Return the choices in pydantic's description of expected values."""
    return re.findall(r"'([^']*)'", expected) or re.split(r",\s*|\s+or\s+", expected)


def _unknown_key(path: Path, known: list[str]) -> ValidationFault:
    meant = closest_word(str(path[-1]), known)
    if path[-1] == "true" and "on" in known:  # so tools of YAML 1.1 write the key `on`
        meant = "on"
    message = f"unknown key '{path[-1]}'"
    if not meant and known:
        message += f" (known here: {', '.join(known)})"
    return ValidationFault(path, message, meant, on_key=True)


def _without_echoes(faults: list[ValidationFault]) -> list[ValidationFault]:
    """Return the faults without duplicates and "missing x" that repeat an "unknown y"."""
    meant = {(fault.path[:-1], fault.suggestion) for fault in faults if "unknown" in fault.message}
    kept: dict[ValidationFault, None] = {}
    for fault in faults:
        missing = re.fullmatch(r"missing key '(.*)'", fault.message)
        if missing is None or (fault.path, missing[1]) not in meant:
            kept[fault] = None
    return list(kept)
