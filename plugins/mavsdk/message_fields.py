"""Converts MAVLink messages to the JSON fields that mavsdk's MavlinkDirect takes; pure."""

import json
import math
from typing import Any


def message_fields_json(message: Any) -> str:
    """Return the fields of a pymavlink message as JSON for mavsdk.

    NaN becomes null: JSON has no NaN, and mavsdk 4.1 reads null as NaN. Raises ValueError for an
    infinite value.
    """
    fields = {name: _plain(getattr(message, name)) for name in message.fieldnames}
    return json.dumps(fields, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return None if math.isnan(value) else value
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode("ascii", errors="replace")
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value
