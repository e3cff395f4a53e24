"""The emulated autopilot's own logs: one per flight, written while armed, served over MAVLink."""

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.services.command_registry import on_message
from wil_campaign.vehicles.embedded.autopilot.services.log_formats import LogWriter
from wil_campaign.vehicles.embedded.physics.states import BodyMotion

_PIECE = 90
_PER_TURN = 20
"""Pieces per turn of 20 ms: 90 kB/s, as over UDP."""
_PERIOD_S = 0.2
_MOST_LOGS = 20
"""Older ones are deleted, as by LOG_MAX_FILES and SDLOG_DIRS_MAX."""


class FlightLogs:
    """Writes a log per flight, and serves LOG_REQUEST_LIST, _DATA, _END and LOG_ERASE.

    first: the number of the first log (ArduPilot counts from 1, PX4 from 0). begin: creates the
    log of a flight that begins at a time in us.
    """

    def __init__(
        self, *, send: Callable[[Any], None], begin: Callable[[int], LogWriter], first: int
    ) -> None:
        self._send = send
        self._begin = begin
        self._next = first
        self._logs: dict[int, bytes] = {}
        self._writer: LogWriter | None = None
        self._due_s = 0.0
        self._request: tuple[bytes, int, int, int] | None = None

    def turn(self, t_s: float, *, armed: bool, now: BodyMotion) -> None:
        """Write due log entries, and send requested log data; called every 20 ms."""
        if armed or self._writer is not None:
            self._write(t_s, armed=armed, now=now)
        if self._request is not None:
            self._send_pieces(*self._request)

    @on_message("LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE")
    def _on_logs(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "LOG_REQUEST_LIST":
            self._list(message.start, message.end)
        elif kind == "LOG_REQUEST_DATA":
            data = self._logs.get(message.id)
            if data is not None:
                self._request = (data, message.id, message.ofs, message.ofs + message.count)
        elif kind == "LOG_REQUEST_END":
            self._request = None
        elif kind == "LOG_ERASE":
            self._logs.clear()

    def _list(self, start: int, end: int) -> None:
        last = max(self._logs, default=0)
        if not self._logs:
            self._send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))
        for number, data in self._logs.items():
            if start <= number <= end:
                # A time of 0 means unknown.
                self._send(
                    mavlink.MAVLink_log_entry_message(number, len(self._logs), last, 0, len(data))
                )

    def _write(self, t_s: float, *, armed: bool, now: BodyMotion) -> None:
        t_us = int(t_s * 1e6)
        writer = self._writer
        if writer is None:
            writer = self._writer = self._begin(t_us)
            writer.text(t_us, "armed")
            self._due_s = t_s
        if t_s >= self._due_s:
            self._due_s += _PERIOD_S
            writer.position(t_us, now)
        if not armed:
            writer.text(t_us, "disarmed")
            self._logs[self._next] = writer.data()
            self._next += 1
            self._writer = None
            while len(self._logs) > _MOST_LOGS:
                del self._logs[next(iter(self._logs))]

    def _send_pieces(self, data: bytes, number: int, offset: int, end: int) -> None:
        for _ in range(_PER_TURN):
            piece = data[offset : min(offset + _PIECE, end)]
            padded = list(piece.ljust(_PIECE, b"\0"))
            self._send(mavlink.MAVLink_log_data_message(number, offset, len(piece), padded))
            offset += len(piece)
            if len(piece) < _PIECE or offset >= end:
                self._request = None
                return
        self._request = (data, number, offset, end)
