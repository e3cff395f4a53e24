"""Logs that launched simulators write in their own folders, so that nobody has to fetch them."""

from pathlib import Path

_SUFFIXES = frozenset({".bin", ".ulg"})
_NO_LOG = "eeprom.bin"
"""ArduPilot's parameters."""


def newest_log(folder: Path) -> Path | None:
    """Return the newest log that a simulator wrote below its folder; None when there is none."""
    files = (file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES)
    logs = (file for file in files if file.name != _NO_LOG)
    return max(logs, key=lambda file: file.stat().st_mtime, default=None)
