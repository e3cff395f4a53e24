"""Writes a vehicle's .tlog: all frames both ways, for MAVExplorer and Mission Planner."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Self

from wil_campaign.foundation.background_file import BackgroundFile

_FLUSH_S = 1.0
_stamp = struct.Struct(">Q")


class TlogWriter:
    """Writes a tlog: MAVLink frames with their time; a context manager.

    Format: for each frame the time as 8-byte big-endian microseconds since 1970, then the raw
    frame (pymavlink's mavlogfile). `epoch_s` is the UTC time at which the run clock was zero.
    open_file: opens a new file.
    """

    def __init__(
        self,
        *,
        path: Path,
        epoch_s: float,
        open_file: Callable[[Path], BackgroundFile] = BackgroundFile,
    ) -> None:
        self._path = path
        self._epoch_s = epoch_s
        self._open_file = open_file

    def __enter__(self) -> Self:
        self._file = self._open_file(self._path)
        self._last_flush_s = 0.0
        return self

    def write(self, t_s: float, frame: bytes) -> None:
        """Append one frame at the run clock's t_s to the tlog. Raises OSError."""
        self._file.write(_stamp.pack(round((self._epoch_s + t_s) * 1e6)) + frame)
        if t_s - self._last_flush_s >= _FLUSH_S:
            self._last_flush_s = t_s
            self._file.flush()

    def __exit__(self, *_: object) -> None:
        self._file.close()
