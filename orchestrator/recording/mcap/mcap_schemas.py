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

from wil_campaign.vehicles.readings import reading_types
from wil_campaign.vehicles.readings.numbers import is_numbers, number_fields

Schema = dict[str, Any]
"""A JSON schema, as it is written to the file."""

_NUMBER: Schema = {"type": "number"}
_INTEGER: Schema = {"type": "integer"}
_STRING: Schema = {"type": "string"}
_BASE64: Schema = {"type": "string", "contentEncoding": "base64"}


def _object(title: str, **properties: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": properties}


def _array(items: Schema) -> Schema:
    return {"type": "array", "items": items}


_TIME = _object("time", sec=_INTEGER, nsec=_INTEGER)
_VECTOR3 = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR3, orientation=_QUATERNION)
_FIELD = _object("foxglove.PackedElementField", name=_STRING, offset=_INTEGER, type=_INTEGER)
_WIL: Schema = {"type": "object"}

UINT8, FLOAT32 = 1, 7
"""foxglove.NumericType."""


def _with_stamp(title: str, **properties: Schema) -> Schema:
    """Return the JSON schema of a message with a timestamp."""
    return _object(title, timestamp=_TIME, frame_id=_STRING, **properties, wil=_WIL)


def numbers_schema(kind: type) -> str:
    """Return the name of the schema of readings that consist of numbers only."""
    return f"wil.{kind.__name__}"


def _numbers(kind: type) -> Schema:
    return _with_stamp(numbers_schema(kind), **dict.fromkeys(number_fields(kind), _NUMBER))


_ALL: tuple[Schema, ...] = (
    _with_stamp("foxglove.CompressedImage", data=_BASE64, format=_STRING),
    _with_stamp(
        "foxglove.RawImage",
        width=_INTEGER,
        height=_INTEGER,
        encoding=_STRING,
        step=_INTEGER,
        data=_BASE64,
    ),
    _with_stamp(
        "foxglove.CameraCalibration",
        width=_INTEGER,
        height=_INTEGER,
        distortion_model=_STRING,
        D=_array(_NUMBER),
        K=_array(_NUMBER),
        R=_array(_NUMBER),
        P=_array(_NUMBER),
    ),
    _with_stamp(
        "foxglove.LaserScan",
        pose=_POSE,
        start_angle=_NUMBER,
        end_angle=_NUMBER,
        ranges=_array(_NUMBER),
        intensities=_array(_NUMBER),
    ),
    _with_stamp(
        "foxglove.PointCloud",
        pose=_POSE,
        point_stride=_INTEGER,
        fields=_array(_FIELD),
        data=_BASE64,
    ),
    _with_stamp("foxglove.PoseInFrame", pose=_POSE),
    _with_stamp(
        "foxglove.LocationFix",
        latitude=_NUMBER,
        longitude=_NUMBER,
        altitude=_NUMBER,
        position_covariance=_array(_NUMBER),
        position_covariance_type=_INTEGER,
    ),
    _with_stamp(
        "foxglove.RawAudio",
        data=_BASE64,
        format=_STRING,
        sample_rate=_INTEGER,
        number_of_channels=_INTEGER,
    ),
    _object(
        "foxglove.FrameTransform",
        timestamp=_TIME,
        parent_frame_id=_STRING,
        child_frame_id=_STRING,
        translation=_VECTOR3,
        rotation=_QUATERNION,
    ),
    _object(
        "foxglove.Log",
        timestamp=_TIME,
        level=_INTEGER,
        message=_STRING,
        name=_STRING,
        file=_STRING,
        line=_INTEGER,
    ),
    _with_stamp("wil.Drawing"),
    _with_stamp("wil.Imu", linear_acceleration=_VECTOR3, angular_velocity=_VECTOR3),
)


@cache
def schemas() -> Mapping[str, bytes]:
    """Return the text of each schema of run.mcap by its name, with those of plugins' readings."""
    numbers = map(_numbers, filter(is_numbers, reading_types().values()))
    texts = ((each["title"], json.dumps(each, separators=(",", ":"))) for each in (*_ALL, *numbers))
    return {name: text.encode() for name, text in texts}


def schema_of(title: str, kind: type) -> bytes:
    """Return the JSON schema of a dataclass or struct, with a timestamp: names and types."""
    properties = _fields_of(kind)
    schema = _object(title, timestamp=_TIME, **properties)
    return json.dumps(schema, separators=(",", ":")).encode()


def _fields_of(kind: type) -> dict[str, Schema]:
    """Return the JSON schemas of the fields of a dataclass or a struct."""
    hints = typing.get_type_hints(kind)
    if (names := getattr(kind, "__struct_fields__", None)) is None:
        names = tuple(field.name for field in dataclasses.fields(kind))
    return {name: _schema_of_hint(hints[name]) for name in names}


_PLAIN: Mapping[Any, Schema] = types.MappingProxyType(
    {bool: {"type": "boolean"}, int: _INTEGER, float: _NUMBER, str: _STRING}
)


def _schema_of_hint(hint: Any) -> Schema:
    if hint in _PLAIN:
        return _PLAIN[hint]
    if isinstance(hint, type) and (
        dataclasses.is_dataclass(hint) or issubclass(hint, msgspec.Struct)
    ):
        return _object(hint.__name__, **_fields_of(hint))
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (types.UnionType, typing.Union):
        known = [argument for argument in arguments if argument is not types.NoneType]
        return _schema_of_hint(known[0]) if len(known) == 1 else {}
    if origin is typing.Literal:
        return _STRING
    if origin is tuple:
        return _array(_schema_of_hint(arguments[0]))
    return {}
