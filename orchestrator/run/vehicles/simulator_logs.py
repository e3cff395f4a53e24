"""Logs that launched simulators write in their own folders, so that nobody has to fetch them."""

from pathlib import Path

_SUFFIXES = frozenset({".bin", ".ulg"})
_NO_LOG = "eeprom.bin"
"""ArduPilot's parameters."""


def flight_log(folder: Path) -> Path | None:
    """Return the log of a simulator's flight, the largest below its folder; None without one.

    ArduCopter begins another, all but empty, as soon as it has landed.
    """
    files = (file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES)
    logs = (file for file in files if file.name != _NO_LOG)
    return max(logs, key=lambda file: file.stat().st_size, default=None)
