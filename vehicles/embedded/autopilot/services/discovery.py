"""The modes that ground stations request when they connect: AVAILABLE_MODES, CURRENT_MODE.

Both messages are in MAVLink's development dialect; both firmwares send them. That dialect takes
0.2 s to import and is seldom needed: it is imported with the first request.
"""

from typing import Any, NamedTuple

AVAILABLE_MODES = 435
CURRENT_MODE = 436


class ModeEntry(NamedTuple):
    """A mode for discovery by AVAILABLE_MODES. standard: MAV_STANDARD_MODE; 0 for none.

    advanced: shown to advanced users only; selectable: by a user.
    """

    name: str
    custom_mode: int
    standard: int = 0
    advanced: bool = False
    selectable: bool = True


def available_modes(entries: tuple[ModeEntry, ...], index: int) -> list[Any]:
    """Return one AVAILABLE_MODES (index from 1), or all of them for index 0."""
    from pymavlink.dialects.v20 import development  # noqa: PLC0415 - see above

    wanted = range(1, len(entries) + 1) if index == 0 else (index,)
    return [
        development.MAVLink_available_modes_message(
            len(entries),
            number,
            entry.standard,
            entry.custom_mode,
            (1 if entry.advanced else 0) | (0 if entry.selectable else 2),
            entry.name.encode(),
        )
        for number in wanted
        if 1 <= number <= len(entries)
        for entry in (entries[number - 1],)
    ]


def current_mode(entries: tuple[ModeEntry, ...], custom_mode: int) -> Any:
    """Return CURRENT_MODE for discovery."""
    from pymavlink.dialects.v20 import development  # noqa: PLC0415 - see above

    standard = next((e.standard for e in entries if e.custom_mode == custom_mode), 0)
    return development.MAVLink_current_mode_message(standard, custom_mode, custom_mode)
