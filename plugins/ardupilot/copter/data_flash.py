"""A flight log in ArduPilot's format: small, but complete for the tools that read it.

libraries/AP_Logger/LogStructure.h of ArduPilot.
"""

import math
import struct

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.vehicles.embedded.physics.states import BodyMotion


class DataFlash:
    """ArduPilot's log format .bin: an FMT message describes each type before its first use."""

    _HEAD = b"\xa3\x95"
    _FORMATS = (
        (128, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"), "BB4s16s64s"),
        (129, "PARM", "QNff", ("TimeUS", "Name", "Value", "Default"), "Q16sff"),
        (130, "MSG", "QZ", ("TimeUS", "Message"), "Q64s"),
        (131, "XKF1", "Qfffffff", ("TimeUS", "PN", "PE", "PD", "VN", "VE", "VD", "Yaw"), "Q7f"),
    )

    def __init__(self, t_us: int, parameters: ParameterTable) -> None:
        self._layouts = {name: (number, struct.Struct("<" + packed))
                         for number, name, _, _, packed in self._FORMATS}  # fmt: skip
        self._data = bytearray()
        for number, name, codes, columns, _ in self._FORMATS:
            length = 3 + self._layouts[name][1].size
            described = (name.encode(), codes.encode(), ",".join(columns).encode())
            self._add("FMT", number, length, *described)
        for name in parameters:
            self._add("PARM", t_us, name.encode(), parameters[name], parameters[name])

    def text(self, t_us: int, text: str) -> None:
        """Add a text to the DataFlash log."""
        self._add("MSG", t_us, text.encode()[:64])

    def position(self, t_us: int, now: BodyMotion) -> None:
        """Add the estimate to the DataFlash log."""
        yaw = math.degrees(now.euler_rad[2]) % 360.0  # as ArduPilot logs it
        self._add("XKF1", t_us, *now.position_ned_m, *now.velocity_ned_m_s, yaw)

    def data(self) -> bytes:
        """Return the DataFlash log's bytes so far."""
        return bytes(self._data)

    def _add(self, name: str, *fields: float | bytes) -> None:
        number, layout = self._layouts[name]
        self._data += self._HEAD + bytes([number]) + layout.pack(*fields)
