"""Messages of readings in JSON: values there and back, exactly, and their schemas.

JSON has no infinity: 1e999 is written, a valid JSON number that every reader in double precision
reads as infinity. NaN is null.
"""

import base64
import binascii
import dataclasses
import json
import math
import uuid
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.frames import Pose, Vec3

Json = Any
"""A value from json.loads."""
Schema = dict[str, Any]
"""A JSON schema, as it is written to a recording."""

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
STRING: Schema = {"type": "string"}
BASE64: Schema = {"type": "string", "contentEncoding": "base64"}
UINT8, FLOAT32 = 1, 7
"""foxglove.NumericType."""


def schema_of_object(title: str, **properties: Schema) -> Schema:
    """Return the JSON schema of a message's part."""
    return {"title": title, "type": "object", "properties": properties}


def schema_of_array(items: Schema) -> Schema:
    """Return the JSON schema of an array in a message."""
    return {"type": "array", "items": items}


TIME = schema_of_object("time", sec=INTEGER, nsec=INTEGER)
VECTOR3 = schema_of_object("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = schema_of_object("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE_SCHEMA = schema_of_object("foxglove.Pose", position=VECTOR3, orientation=QUATERNION)


def stamped_message_schema(title: str, **properties: Schema) -> Schema:
    """Return the JSON schema of a reading's message: a timestamp, these fields, and `wil`."""
    wil: Schema = {"type": "object"}
    return schema_of_object(title, timestamp=TIME, frame_id=STRING, **properties, wil=wil)


_MARK = uuid.uuid4().hex
_INFINITE, _MINUS_INFINITE = f"\x00{_MARK}", f"\x00-{_MARK}"
"""What stands for an infinity until the text is made: no text that is recorded has the mark."""
_WRITTEN = ((f'"\\u0000{_MARK}"'.encode(), b"1e999"), (f'"\\u0000-{_MARK}"'.encode(), b"-1e999"))


def encode_message(document: dict[str, Json], data: bytes | None = None) -> bytes:
    """Return a message document as JSON text; `data` becomes its field of that name, base64."""
    try:
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    except ValueError:
        finite = _without_infinity(document)
        text = json.dumps(finite, separators=(",", ":"), allow_nan=False).encode()
    if b'"\\u0000' in text:
        for mark, written in _WRITTEN:
            text = text.replace(mark, written)
    if data is None:
        return text
    # joined manually: json would scan every character of the long text again
    return b"".join((text[:-1], b',"data":"', binascii.b2a_base64(data, newline=False), b'"}'))


def _without_infinity(value: Json) -> Json:
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else _INFINITE if value > 0 else _MINUS_INFINITE
    if isinstance(value, dict):
        return {key: _without_infinity(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_infinity(one) for one in value]
    return value


def numbers_to_json(array: NDArray[np.float32]) -> list[Json]:
    """Return the values of a (n,) array for a JSON document."""
    values: list[Json] = array.tolist()
    for index in np.flatnonzero(~np.isfinite(array)).tolist():
        values[index] = _without_infinity(values[index])
    return values


_PLAIN = frozenset({float, int, str, bool, type(None)})


@cache
def _names(kind: type) -> tuple[str, ...] | None:
    """Return the names of a dataclass's fields; None for another class."""
    if not dataclasses.is_dataclass(kind):
        return None
    return tuple(field.name for field in dataclasses.fields(kind))


def plain_json_document(value: Any) -> Json:
    """Return a frozen dataclass, its tuples and its parts as a JSON document."""
    kind: Any = type(value)
    if kind in _PLAIN:
        return value
    if (names := _names(kind)) is not None:
        return {name: plain_json_document(getattr(value, name)) for name in names}
    if isinstance(value, tuple | list):
        return [plain_json_document(one) for one in value]
    return value


def number_from_json(value: Json) -> float:
    """Return a float of a JSON document, where null is NaN."""
    return math.nan if value is None else float(value)


def vector_from_json(value: Json) -> Vec3:
    """Return three floats of a JSON document."""
    x, y, z = (number_from_json(one) for one in value)
    return (x, y, z)


def pose_to_json(pose: Pose) -> dict[str, Json]:
    """Return a pose as the JSON of a foxglove.Pose."""
    (x, y, z), (qw, qx, qy, qz) = pose.position_ned_m, pose.q_wxyz
    return {
        "position": {"x": x, "y": y, "z": z},
        "orientation": {"x": qx, "y": qy, "z": qz, "w": qw},
    }


def pose_from_json(value: Json) -> Pose:
    """Return the pose in the JSON of a foxglove.Pose."""
    p, q = value["position"], value["orientation"]
    return Pose(
        vector_from_json((p["x"], p["y"], p["z"])),
        (number_from_json(q["w"]), *vector_from_json((q["x"], q["y"], q["z"]))),
    )


def base64_from_array(array: NDArray[np.uint8]) -> str:
    """Return an array's bytes as base64, for a JSON field beside `data`."""
    return base64.b64encode(array.tobytes()).decode("ascii")


def bytes_from_base64(text: str) -> bytes:
    """Return the bytes of a base64 JSON field. Raises ValueError."""
    return base64.b64decode(text, validate=True)
