"""Lists and downloads the vehicle's own logs over MAVLink, once it has landed.

LOG_REQUEST_LIST, LOG_REQUEST_DATA: https://mavlink.io/en/messages/common.html#LOG_REQUEST_DATA;
ArduPilot's .bin and PX4's .ulg are transferred the same way.
"""

import asyncio
import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.driver.session.session import MavlinkSession
from wil_campaign.vehicles.errors import VehicleError

_PIECE = 90
"""Bytes in a LOG_DATA; a shorter one is the log's last."""
_WINDOW = 512 * _PIECE
"""Bytes in one request: 46 kB, a second of a fast link."""


class VehicleLogError(VehicleError):
    """A vehicle log could not be fetched; the message says how much of it was received."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One log on the vehicle; utc_s: its start (seconds since 1970), None when unknown."""

    number: int
    size_bytes: int
    utc_s: int | None


class VehicleLogs:
    """Lists and fetches the vehicle's logs, one operation at a time.

    A reply that does not come within `timeout_s` is requested again, `tries` times in a row.
    """

    def __init__(self, *, session: MavlinkSession, timeout_s: float = 0.7, tries: int = 8) -> None:
        self._session = session
        self._timeout_s = timeout_s
        self._tries = tries
        self._suffix = ".log"
        self._numbered_in_order = True
        self._turn = asyncio.Lock()
        self._inbox: asyncio.Queue[Any] | None = None
        session.on(mavlink.MAVLINK_MSG_ID_LOG_ENTRY, self._on_message)
        session.on(mavlink.MAVLINK_MSG_ID_LOG_DATA, self._on_message)

    def use_format(self, suffix: str, *, numbered_in_order: bool) -> None:
        """Set the suffix of this autopilot's log files (".bin", ".ulg"), and their order.

        numbered_in_order: a later log has a higher number (ArduPilot); otherwise the numbers are
        those of a directory's entries, and times tell the order (PX4).
        """
        self._suffix = suffix
        self._numbered_in_order = numbered_in_order

    async def list(self) -> tuple[LogEntry, ...]:
        """Return the logs on the vehicle, oldest first. Raises LogError.

        Where times tell the order, one without a time counts as older than any other.
        """
        async with self._turn:
            return tuple(sorted(await self._entries(), key=self._age))

    def _age(self, entry: LogEntry) -> tuple[int, int]:
        """Return what orders the logs by age; the newest has the highest."""
        utc_s = 0 if self._numbered_in_order else entry.utc_s or 0
        return utc_s, entry.number

    async def fetch(
        self,
        entry: LogEntry,
        folder: Path,
        *,
        name: str = "log",
        progress: Callable[[int], None] | None = None,
    ) -> Path:
        """Fetch a vehicle log into `folder` as `<name>-<number><suffix>`; return the file.

        The file is complete or absent. progress: called with the number of bytes received. Raises
        LogError, also for a log without a byte.
        """
        path = folder / f"{name}-{entry.number}{self._suffix}"
        half = path.with_suffix(f"{self._suffix}.part")
        async with self._turn:
            try:
                await self._fetch_to(entry, half, progress)
                if half.stat().st_size == 0:
                    raise VehicleLogError(f"log {entry.number} is empty")
                half.replace(path)
            except OSError as error:
                raise VehicleLogError(f"log {entry.number} to {path}: {error.strerror}") from error
            finally:
                half.unlink(missing_ok=True)
                self._send(mavlink.MAVLink_log_request_end_message)
        return path

    async def _entries(self) -> tuple[LogEntry, ...]:
        with self._listen_for() as inbox:
            return await self._list(inbox)

    async def _fetch_to(
        self, entry: LogEntry, half: Path, progress: Callable[[int], None] | None
    ) -> None:
        with half.open("w+b") as file, self._listen_for() as inbox:
            await self._fetch(entry, file, inbox, progress)
            file.flush()
            os.fsync(file.fileno())

    @contextlib.contextmanager
    def _listen_for(self) -> Any:
        self._inbox = inbox = asyncio.Queue[Any]()
        try:
            yield inbox
        finally:
            self._inbox = None

    async def _list(self, inbox: "asyncio.Queue[Any]") -> tuple[LogEntry, ...]:
        entries: dict[int, LogEntry] = {}
        first, total = 0, None
        for _ in range(self._tries):
            self._send(mavlink.MAVLink_log_request_list_message, start=first, end=0xFFFF)
            while (message := await self._next(inbox, "LOG_ENTRY")) is not None:
                total = message.num_logs
                if total == 0:
                    return ()
                entries[message.id] = _entry(message)
                if len(entries) >= total:
                    return tuple(entries.values())
        arrived = "nothing arrived" if total is None else f"{len(entries)} of {total} arrived"
        raise VehicleLogError(
            f"{self._session.link.name}: the list of logs is incomplete: {arrived}"
        )

    async def _fetch(
        self,
        entry: LogEntry,
        file: BinaryIO,
        inbox: "asyncio.Queue[Any]",
        progress: Callable[[int], None] | None,
    ) -> None:
        pieces = _Pieces(entry.size_bytes)
        failures = 0
        while (gap := pieces.gap(_WINDOW)) is not None:
            before = pieces.received
            self._send(
                mavlink.MAVLink_log_request_data_message, id=entry.number, ofs=gap[0], count=gap[1]
            )
            while not pieces.has(gap):
                message = await self._next(inbox, "LOG_DATA")
                if message is None:
                    break
                if message.id == entry.number and pieces.take(message.ofs, message.count):
                    file.seek(message.ofs)
                    file.write(bytes(message.data[: message.count]))
            failures = 0 if pieces.received > before else failures + 1
            if failures >= self._tries:
                raise VehicleLogError(
                    f"{self._session.link.name}: log {entry.number} stopped at {pieces.received} "
                    f"of {entry.size_bytes} bytes, requested {failures} more times"
                )
            if progress is not None:
                progress(pieces.received)
        file.truncate(pieces.size)

    async def _next(self, inbox: "asyncio.Queue[Any]", kind: str) -> Any | None:
        """Return the next log message of a kind; None when none comes in time."""
        try:
            async with asyncio.timeout(self._timeout_s):
                while True:
                    message = await inbox.get()
                    if message.get_type() == kind:
                        return message
        except TimeoutError:
            return None

    def _send(self, kind: Any, **fields: int) -> None:
        target = self._session.target
        if target is None:
            raise VehicleLogError(f"{self._session.link.name}: no vehicle is identified yet")
        message = kind(target_system=target.system, target_component=target.component, **fields)
        self._session.send(message)

    def _on_message(self, message: Any, _t_s: float) -> None:
        if self._inbox is not None:
            self._inbox.put_nowait(message)


class _Pieces:
    """Which pieces of a vehicle log have arrived."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.received = 0
        self._missing = bytearray(b"\1") * (-(-size // _PIECE))

    def take(self, offset: int, count: int) -> bool:
        """Note a log's piece; return whether it is new and aligned."""
        if count < _PIECE and offset + count < self.size and offset % _PIECE == 0:
            # The log is shorter than its entry states.
            self._end(offset + count)
        number, odd = divmod(offset, _PIECE)
        if odd or count == 0 or number >= len(self._missing) or not self._missing[number]:
            return False
        self._missing[number] = 0
        self.received += count
        return True

    def gap(self, most: int) -> tuple[int, int] | None:
        """Return (offset, count) of a log's first gap, at most `most` bytes; None when complete."""
        first = self._missing.find(1)
        if first < 0:
            return None
        after = self._missing.find(0, first)
        end = len(self._missing) if after < 0 else after
        offset = first * _PIECE
        return offset, min(most, min(end * _PIECE, self.size) - offset)

    def has(self, gap: tuple[int, int]) -> bool:
        first, last = gap[0] // _PIECE, (gap[0] + gap[1] - 1) // _PIECE
        return self._missing.find(1, first, last + 1) < 0

    def _end(self, size: int) -> None:
        self.size = size
        del self._missing[-(-size // _PIECE) :]


def _entry(message: Any) -> LogEntry:
    return LogEntry(message.id, message.size, message.time_utc or None)
