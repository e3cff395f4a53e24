"""Describes oracles and their parameters for `wil-campaign list oracles` and the documentation."""

from collections.abc import Iterable
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from wil_campaign.foundation.files.problems import unit_of_key
from wil_campaign.safety.oracles.oracle import OracleSpec
from wil_campaign.safety.oracles.oracle_terms import OracleParameters, Windowed

_TYPES: dict[Any, str] = {float: "number", int: "whole number", bool: "true or false", str: "text"}
_UNITS = {
    "m": "m",
    "s": "s",
    "m_s": "m/s",
    "deg": "deg",
    "percent": "%",
    "v": "V",
}


@dataclass(frozen=True, slots=True)
class OracleParameterDoc:
    """An oracle parameter's documentation: key, values, unit, default ("" for none)."""

    name: str
    takes: str
    unit: str
    default: str
    needed: bool
    meaning: str


@dataclass(frozen=True, slots=True)
class OracleDoc:
    """An oracle's documentation: what it checks, when it judges, its parameters."""

    name: str
    summary: str
    window: str
    fail_fast: bool
    parameters: tuple[OracleParameterDoc, ...]


def describe_oracles(spec: OracleSpec) -> OracleDoc:
    """Return an oracle's documentation, without the `common_parameters`."""
    windowed = issubclass(spec.parameters, Windowed)
    window = f"from {spec.window.first} to {spec.window.last}" if windowed else "at the end"
    common = {*OracleParameters.model_fields, *Windowed.model_fields}
    own = {name: f for name, f in spec.parameters.model_fields.items() if name not in common}
    return OracleDoc(
        spec.name, spec.summary, window, spec.fail_fast, _documented_parameters(own.items())
    )


def common_parameters() -> tuple[OracleParameterDoc, ...]:
    """Return the documentation of the parameters that every oracle takes."""
    return _documented_parameters(Windowed.model_fields.items())


def _documented_parameters(
    fields: Iterable[tuple[str, FieldInfo]],
) -> tuple[OracleParameterDoc, ...]:
    return tuple(_parameter(field.alias or name, field) for name, field in fields)


def _parameter(name: str, field: FieldInfo) -> OracleParameterDoc:
    needed = field.is_required()
    default = "" if needed or field.default is None else _show_value(field.default)
    unit = _UNITS.get(unit_of_key(name), "")
    return OracleParameterDoc(
        name, _takes(field.annotation), unit, default, needed, field.description or ""
    )


def _show_value(value: object) -> str:
    """Return an oracle parameter's default as documentation shows it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(str, value))}]"
    return str(value)


def _takes(annotation: Any) -> str:
    """Return in words what values an oracle parameter takes, by its annotation."""
    if get_origin(annotation) in {Union, UnionType}:
        inner = [each for each in get_args(annotation) if each is not NoneType]
        return " or ".join(map(_takes, inner))
    if get_origin(annotation) is Literal:
        return " | ".join(map(str, get_args(annotation)))
    if get_origin(annotation) is tuple:
        item = _takes(get_args(annotation)[0])
        return "list of names" if item == "text" else f"list of {item}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "mapping"
    return _TYPES[annotation]
