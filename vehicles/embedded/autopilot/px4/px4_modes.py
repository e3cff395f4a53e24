"""PX4's modes: custom_mode numbers, base_mode flags and requirements.

Sources: src/modules/commander/px4_custom_mode.h, ModeUtil/mode_requirements.cpp (v1.18).
"""

from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wil_campaign.vehicles.embedded.autopilot.services.discovery import ModeEntry

_MANUAL_BITS: int = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | (
    mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
)
_AUTO_BITS: int = (
    mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
    | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
)


class Px4Mode(Enum):
    """A PX4 mode: (main mode, sub mode)."""

    MANUAL = (1, 0)
    ALTITUDE = (2, 0)
    POSITION = (3, 0)
    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    MISSION = (4, 4)
    RTL = (4, 5)
    LAND = (4, 6)
    ACRO = (5, 0)
    OFFBOARD = (6, 0)
    STABILIZED = (7, 0)

    @property
    def custom_mode(self) -> int:
        """Return the PX4 mode's number in the HEARTBEAT."""
        main, sub = self.value
        return int(main) << 16 | int(sub) << 24

    @property
    def is_manual(self) -> bool:
        """Return whether the PX4 mode needs a pilot's sticks."""
        return self.value[0] in {1, 2, 3, 5, 7}

    @property
    def prevents_arming(self) -> bool:
        """Return whether PX4 refuses to arm in the mode, or to return to it landed."""
        return self in {Px4Mode.RTL, Px4Mode.LAND}

    @property
    def base_mode(self) -> int:
        """Return the PX4 mode's flags in the HEARTBEAT, without the armed one."""
        bits: int = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if self.is_manual:
            return bits | _MANUAL_BITS
        if self is Px4Mode.OFFBOARD:
            return bits | int(mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED)
        return bits | _AUTO_BITS

    @property
    def words(self) -> str:
        """Return the mode's name in PX4's texts."""
        return {"RTL": "Return"}.get(self.name, self.name.capitalize())


_STANDARD = {"POSITION": 1, "ALTITUDE": 4, "RTL": 5, "MISSION": 6, "LAND": 7, "TAKEOFF": 8}
"""MAV_STANDARD_MODE of those that are one."""

ENTRIES = tuple(
    ModeEntry(mode.words, mode.custom_mode, standard=_STANDARD.get(mode.name, 0))
    for mode in Px4Mode
)


_AUTO, _POSITION = 4, 3
NOT_EMULATED = {(_POSITION, 2), *((_AUTO, sub) for sub in (8, 9, *range(11, 19)))}
"""Modes of PX4 that the emulation does not have: slow, following, precise landing, external."""


def px4_mode(main: int, sub: int) -> Px4Mode | None:
    """Return the PX4 mode of these numbers; AUTO without a sub mode is MISSION."""
    if (main, sub) == (_AUTO, 0):
        return Px4Mode.MISSION
    for mode in Px4Mode:
        if mode.value[0] == main and (main != _AUTO or mode.value[1] == sub):
            return mode
    return None


def mode_of_flags(base_mode: int) -> Px4Mode | None:
    """Return the PX4 mode of MAV_MODE_FLAGs without a custom mode; None for none."""
    if base_mode & mavlink.MAV_MODE_FLAG_AUTO_ENABLED:
        return Px4Mode.MISSION
    if not base_mode & mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED:
        return None
    if base_mode & mavlink.MAV_MODE_FLAG_GUIDED_ENABLED:
        return Px4Mode.POSITION
    stabilized = base_mode & mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    return Px4Mode.STABILIZED if stabilized else Px4Mode.MANUAL
