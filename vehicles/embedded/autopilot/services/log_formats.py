"""Flight logs of emulated autopilots: small, but complete for the tools that read them.

ULog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

import struct
from typing import Protocol

from wil_campaign.vehicles.embedded.autopilot.flight.parameter_table import ParameterTable
from wil_campaign.vehicles.embedded.physics.states import BodyMotion

_POSITION_FIELDS = ("x", "y", "z", "vx", "vy", "vz", "heading")


class LogWriter(Protocol):
    """A growing vehicle log in some format (protocol)."""

    def text(self, t_us: int, text: str) -> None:
        """Add a text to the log."""

    def position(self, t_us: int, now: BodyMotion) -> None:
        """Add the estimate to the log: local NED."""

    def data(self) -> bytes:
        """Return the log's bytes so far."""


class ULog:
    """PX4's log format .ulg: definitions, then data of one topic, and logged strings."""

    _TOPIC = "vehicle_local_position"
    _TOPIC_ID = 0

    def __init__(self, t_us: int, parameters: ParameterTable) -> None:
        # The magic and version 1, then the time of the start.
        self._data = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", t_us))
        self._add("B", bytes(40))
        fields = "".join(f"float {name};" for name in _POSITION_FIELDS)
        self._add("F", f"{self._TOPIC}:uint64_t timestamp;{fields}".encode())
        self._info("char[3] sys_name", b"PX4")
        for name in parameters:
            self._parameter(name, parameters)
        self._add("A", struct.pack("<BH", 0, self._TOPIC_ID) + self._TOPIC.encode())

    def text(self, t_us: int, text: str) -> None:
        """Add a text to the ULog, at the level of information."""
        self._add("L", b"6" + struct.pack("<Q", t_us) + text.encode())

    def position(self, t_us: int, now: BodyMotion) -> None:
        """Add the estimate to the ULog."""
        values = (*now.position_ned_m, *now.velocity_ned_m_s, now.euler_rad[2])
        self._add("D", struct.pack("<HQ7f", self._TOPIC_ID, t_us, *values))

    def data(self) -> bytes:
        """Return the ULog's bytes so far."""
        return bytes(self._data)

    def _parameter(self, name: str, parameters: ParameterTable) -> None:
        whole = parameters.is_whole(name)
        key = f"{'int32_t' if whole else 'float'} {name}".encode()
        value = parameters[name]
        packed = struct.pack("<i", int(value)) if whole else struct.pack("<f", value)
        self._add("P", bytes([len(key)]) + key + packed)

    def _info(self, key: str, value: bytes) -> None:
        self._add("I", bytes([len(key)]) + key.encode() + value)

    def _add(self, kind: str, body: bytes) -> None:
        self._data += struct.pack("<H", len(body)) + kind.encode() + body
