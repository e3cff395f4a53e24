"""Writes readings as messages for other programs: the format that `reading_message` reads; pure."""

import dataclasses
import math
from typing import Any

import numpy as np

from wil_campaign.plugins.readings.messagepack import pack_header
from wil_campaign.plugins.readings.reading_message import PROTOCOL
from wil_campaign.vehicles.readings import Reading, sensor_type_of
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

_ENVELOPE = frozenset({"t_s", "arrived_s", "seq", "source", "sensor"})
_NOT_SENT = frozenset({"mount", "camera_pose", "object_ids", "rendered"})
"""What a sensor does not tell, or what its campaign states."""


def written_reading(reading: Reading) -> bytes:
    """Return a reading of any sensor but a camera as a message, MessagePack.

    Its keys are those of the reading's fields, arrays as bytes, little-endian; times are of the run
    clock, and a distance at which nothing came back is nil. A depth image has its camera beside it.
    """
    values: dict[str, Any] = {
        "protocol": PROTOCOL,
        "sensor": reading.sensor,
        "type": sensor_type_of(reading),
        "seq": reading.seq,
        "t_s": reading.t_s,
        "arrived_s": reading.arrived_s,
        "source": reading.source,
    }
    for field in dataclasses.fields(reading):
        if field.name not in _ENVELOPE | _NOT_SENT:
            values |= _written(field.name, getattr(reading, field.name))
    return pack_header(values)


def _written(name: str, value: Any) -> dict[str, Any]:
    """Return the keys of a field of a reading."""
    if value is None:
        return {}
    if isinstance(value, Pose):
        return {"position_ned_m": list(value.position_ned_m), "q_wxyz": list(value.q_wxyz)}
    if isinstance(value, Intrinsics):
        return {"camera": {**dataclasses.asdict(value), "distortion": list(value.distortion)}}
    if isinstance(value, np.ndarray):
        return {name: value.astype(value.dtype.newbyteorder("<"), copy=False).tobytes()}
    if isinstance(value, float) and math.isinf(value):
        return {name: None}
    return {name: list(value) if isinstance(value, tuple) else value}
