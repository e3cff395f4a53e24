"""MAVLink messages as mavsdk's MavlinkDirect takes them: a name, and fields in JSON; pure."""

import json
import math
from typing import Any


def fields_json(message: Any) -> str:
    """Return the fields of a pymavlink message as JSON for mavsdk.

    NaN, which JSON has not, is null there: mavsdk 4.1 takes null for NaN, and refuses NaN. Raises
    ValueError for what is infinite.
    """
    fields = {name: _plain(getattr(message, name)) for name in message.fieldnames}
    return json.dumps(fields, allow_nan=False)


def _plain(value: Any) -> Any:
    """Return a message field's value as JSON can hold it."""
    if isinstance(value, float):
        return None if math.isnan(value) else value
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode("ascii", errors="replace")
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value
