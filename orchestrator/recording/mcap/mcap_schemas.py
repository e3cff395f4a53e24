"""JSON schemas of run.mcap: Foxglove's where one fits, our own otherwise.

Names, fields and types are those of Foxglove's message schemas, on which its panels depend; `wil`
has the other values of a reading, so that it can be read back exactly.
"""

import dataclasses
import json
import types
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any

import msgspec

from wil_campaign.vehicles.readings.kinds import sensor_specs
from wil_campaign.vehicles.readings.messages import (
    BASE64,
    INTEGER,
    NUMBER,
    QUATERNION,
    STRING,
    TIME,
    VECTOR3,
    Schema,
    schema_of_array,
    schema_of_object,
    stamped_message_schema,
)
from wil_campaign.vehicles.readings.numbers import is_numbers_reading, number_fields_of_reading


def numbers_schema(kind: type) -> str:
    """Return the name of the schema of readings that consist of numbers only."""
    return f"wil.{kind.__name__}"


def _numbers(kind: type) -> Schema:
    return stamped_message_schema(
        numbers_schema(kind), **dict.fromkeys(number_fields_of_reading(kind), NUMBER)
    )


_ALL: tuple[Schema, ...] = (
    stamped_message_schema("foxglove.CompressedImage", data=BASE64, format=STRING),
    stamped_message_schema(
        "foxglove.RawImage",
        width=INTEGER,
        height=INTEGER,
        encoding=STRING,
        step=INTEGER,
        data=BASE64,
    ),
    stamped_message_schema(
        "foxglove.CameraCalibration",
        width=INTEGER,
        height=INTEGER,
        distortion_model=STRING,
        D=schema_of_array(NUMBER),
        K=schema_of_array(NUMBER),
        R=schema_of_array(NUMBER),
        P=schema_of_array(NUMBER),
    ),
    schema_of_object(
        "foxglove.FrameTransform",
        timestamp=TIME,
        parent_frame_id=STRING,
        child_frame_id=STRING,
        translation=VECTOR3,
        rotation=QUATERNION,
    ),
    schema_of_object(
        "foxglove.Log",
        timestamp=TIME,
        level=INTEGER,
        message=STRING,
        name=STRING,
        file=STRING,
        line=INTEGER,
    ),
    stamped_message_schema("wil.Drawing"),
)


@cache
def mcap_schema_texts() -> Mapping[str, bytes]:
    """Return the text of each schema of run.mcap by its name, with those of readings."""
    of_readings = (
        _numbers(spec.reading) if is_numbers_reading(spec.reading) else spec.traits.schema
        for spec in sensor_specs().values()
    )
    texts = (
        (each["title"], json.dumps(each, separators=(",", ":")))
        for each in (*_ALL, *filter(None, of_readings))
    )
    return {name: text.encode() for name, text in texts}


def schema_of_class(title: str, kind: type) -> bytes:
    """Return the JSON schema of a dataclass or struct, with a timestamp: names and types."""
    properties = _fields_of(kind)
    schema = schema_of_object(title, timestamp=TIME, **properties)
    return json.dumps(schema, separators=(",", ":")).encode()


def _fields_of(kind: type) -> dict[str, Schema]:
    """Return the JSON schemas of the fields of a dataclass or a struct."""
    hints = typing.get_type_hints(kind)
    if (names := getattr(kind, "__struct_fields__", None)) is None:
        names = tuple(field.name for field in dataclasses.fields(kind))
    return {name: _schema_of_hint(hints[name]) for name in names}


_PLAIN: Mapping[Any, Schema] = types.MappingProxyType(
    {bool: {"type": "boolean"}, int: INTEGER, float: NUMBER, str: STRING}
)


def _schema_of_hint(hint: Any) -> Schema:
    if hint in _PLAIN:
        return _PLAIN[hint]
    if isinstance(hint, type) and (
        dataclasses.is_dataclass(hint) or issubclass(hint, msgspec.Struct)
    ):
        return schema_of_object(hint.__name__, **_fields_of(hint))
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        known = [argument for argument in arguments if argument is not types.NoneType]
        return _schema_of_hint(known[0]) if len(known) == 1 else {}
    if origin is typing.Literal:
        return STRING
    if origin is tuple:
        return schema_of_array(_schema_of_hint(arguments[0]))
    return {}
