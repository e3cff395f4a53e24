"""ArduPilot's file of all parameters, `@PARAM/param.pck`, which ground stations download.

Layout: libraries/AP_Filesystem/README.md of ArduPilot. A header of a magic number, the number of
parameters in the file and in total; then for each its type, the lengths of the part of the name
shared with the previous one and of the new part, the new part, and the value.
"""

import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable

PATH = "@PARAM/param.pck"
_MAGIC = 0x671B
_LAYOUTS = {
    mavlink.MAV_PARAM_TYPE_INT8: (1, "<b"),
    mavlink.MAV_PARAM_TYPE_INT16: (2, "<h"),
    mavlink.MAV_PARAM_TYPE_INT32: (3, "<i"),
    mavlink.MAV_PARAM_TYPE_REAL32: (4, "<f"),
}
"""ArduPilot's type numbers, and the struct formats of values."""


def parameter_file(parameters: ParameterTable) -> bytes:
    """Return the parameter file's bytes, in the order of the table."""
    out = bytearray(struct.pack("<HHH", _MAGIC, len(parameters), len(parameters)))
    before = ""
    for name in parameters:
        kind, layout = _LAYOUTS[parameters.kind(name)]
        value = parameters[name]
        shared = _shared_letters(before, name)
        added = name[shared:].encode()
        out += bytes([kind, (len(added) - 1) << 4 | shared]) + added
        out += struct.pack(layout, int(value) if parameters.is_whole(name) else value)
        before = name
    return bytes(out)


def _shared_letters(before: str, name: str) -> int:
    """Return how many letters two names begin with alike."""
    for count, (a, b) in enumerate(zip(before, name, strict=False)):
        if a != b:
            return count
    return min(len(before), len(name))
