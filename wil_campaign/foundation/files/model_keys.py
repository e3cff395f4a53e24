"""The keys that a pydantic model allows at a path, to suggest one for a misspelt key."""

import types
import typing
from collections.abc import Callable
from dataclasses import dataclass

from pydantic import BaseModel

from wil_campaign.foundation.files.yaml_nodes import Data

Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class LaterType:
    """In an Annotated: the key's type is what `of` returns when a file is checked.

    By then the plugins are registered, which may add to it.
    """

    of: Callable[[], typing.Any]

    def __get_pydantic_core_schema__(self, _: object, handler: typing.Any) -> typing.Any:
        """Return the schema of the key's type, for pydantic."""
        return handler.generate_schema(self.of())


def descend_value(here: object, step: str | int) -> tuple[bool, object]:
    """Return whether a value has this key or index, and its value there."""
    if isinstance(here, dict) and step in here:
        return True, here[step]
    if isinstance(here, list) and isinstance(step, int) and 0 <= step < len(here):
        return True, here[step]
    return False, None


def known_keys(model: type[BaseModel], path: Path, value: Data) -> list[str]:
    """Return the keys that a model allows in the mapping at `path` of a value."""
    candidates: list[object] = [model]
    here: object = value
    for step in path:
        _, here = descend_value(here, step)
        candidates = [inner for candidate in candidates for inner in _inside(candidate, step, here)]
    names: dict[str, None] = {}
    for candidate in candidates:
        for name in _fields(candidate) if _may_be(candidate, here) else ():
            names[name] = None
    return list(names)


def _fields(candidate: object) -> dict[str, object]:
    """Return a model's keys with their annotations; none for other types."""
    if not (isinstance(candidate, type) and issubclass(candidate, BaseModel)):
        return {}
    return {field.alias or name: field.annotation for name, field in candidate.model_fields.items()}


def _may_be(candidate: object, here: object) -> bool:
    """Return whether no literal key (`type: camera`) of the model contradicts the value."""
    if not isinstance(here, dict):
        return True
    return all(
        here.get(name) in typing.get_args(annotation)
        for name, annotation in _fields(candidate).items()
        if typing.get_origin(annotation) is typing.Literal and name in here
    )


def _inside(candidate: object, step: str | int, below: object) -> list[object]:
    """Return the model types that the value under one key or index may have."""
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
    """Return the types of an annotation for key look-up: union members, Annotated's content."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        inner, *facts = typing.get_args(annotation)
        later = next((fact.of for fact in facts if isinstance(fact, LaterType)), None)
        return _members(later() if later else inner)
    if origin in {typing.Union, types.UnionType}:
        return [m for part in typing.get_args(annotation) for m in _members(part)]
    return [annotation]
