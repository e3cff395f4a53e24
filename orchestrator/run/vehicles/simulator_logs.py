"""Finds the log of a launched simulator in its folder, so that no download is needed."""

from pathlib import Path

_SUFFIXES = frozenset({".bin", ".ulg"})
_NO_LOG = "eeprom.bin"
"""The parameters of ArduPilot, no log."""


def flight_log(folder: Path) -> Path | None:
    """Return the log of a simulator's flight, the largest below its folder; None if all are empty.

    ArduCopter begins another one, almost empty, as soon as it has landed.
    """
    files = (file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES)
    sizes = {file: file.stat().st_size for file in files if file.name != _NO_LOG}
    written = [file for file, size in sizes.items() if size > 0]
    return max(written, key=lambda file: sizes[file], default=None)
