"""Documentation of the steps and their parameters, for `wil-campaign list operators` and docs."""

import inspect
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from wil_campaign.recipes.model.registry import StepType

_TYPES: dict[Any, str] = {float: "number", int: "whole number", bool: "true or false", str: "text"}


@dataclass(frozen=True, slots=True)
class StepParameterDoc:
    """A step parameter's documentation: key, accepted values, default ("" for none)."""

    name: str
    takes: str
    default: str
    needed: bool


@dataclass(frozen=True, slots=True)
class StepDoc:
    """A step's documentation. details: shapes, units, frames. notes: meaning of its parameters."""

    name: str
    stage: str
    sensors: tuple[str, ...]
    gives: str
    summary: str
    details: str
    parameters: tuple[StepParameterDoc, ...]
    notes: str


def describe_step(kind: StepType) -> StepDoc:
    """Return the documentation of one kind of step."""
    _, _, details = inspect.cleandoc(kind.build.__doc__ or "").partition("\n")
    fields = kind.parameters.model_fields.items()
    return StepDoc(
        name=kind.name,
        stage=kind.stage,
        sensors=kind.sensors,
        gives=" or ".join(dict.fromkeys(kind.gives.values())),
        summary=kind.summary,
        details=_join_words(details),
        parameters=tuple(_parameter(field.alias or name, field) for name, field in fields),
        notes=_join_words(inspect.cleandoc(kind.parameters.__doc__ or "")),
    )


def _join_words(text: str) -> str:
    return " ".join(text.split())


def _parameter(name: str, field: FieldInfo) -> StepParameterDoc:
    needed = field.is_required()
    default = field.get_default(call_default_factory=True, validated_data={})
    shown = "" if needed or default in (None, PydanticUndefined) else _show_value(default)
    return StepParameterDoc(name, _takes(field.annotation), shown, needed)


def _show_value(value: object) -> str:
    """Return a step parameter's default as documentation shows it."""
    match value:
        case bool():
            return "true" if value else "false"
        case float():
            return f"{value:g}"
        case list():
            return f"[{', '.join(map(_show_value, value))}]"
        case dict() | BaseModel():
            return ""
        case _:
            return str(value)


def _takes(annotation: Any) -> str:
    """Return the values that a step's parameter takes, in words, from its annotation."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _takes(arguments[0])
    if origin in {Union, UnionType}:
        return " or ".join(_takes(each) for each in arguments if each is not NoneType)
    if origin is Literal:
        return " | ".join(map(str, arguments))
    if origin is list:
        return f"list of {_plural(arguments[0])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"{{{', '.join(annotation.model_fields)}}}"
    return _TYPES.get(annotation, "mapping")


def _plural(annotation: Any) -> str:
    """Return the plural word for the items of a step's list parameter."""
    item = _takes(annotation)
    return {"text": "names", "number": "numbers"}.get(item, item)
