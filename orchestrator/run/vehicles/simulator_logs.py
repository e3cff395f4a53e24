"""Finds the log of a launched simulator in its folder, so that no download is needed."""

from pathlib import Path

_SUFFIXES = frozenset({".bin", ".ulg"})
_NO_LOG = "eeprom.bin"
"""The parameters of ArduPilot, no log."""


def flight_log(folder: Path) -> Path | None:
    """Return the log of a simulator's flight, the largest below its folder; None without one.

    ArduCopter begins another one, almost empty, as soon as it has landed.
    """
    files = (file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES)
    logs = (file for file in files if file.name != _NO_LOG)
    return max(logs, key=lambda file: file.stat().st_size, default=None)
