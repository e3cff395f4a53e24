"""ArduCopter's modes: numbers, names and requirements.

Source: ArduCopter/mode.h (4.7).
"""

from enum import Enum

from wil_campaign.vehicles.embedded.autopilot.services.discovery import ModeEntry


class CopterMode(Enum):
    """An ArduCopter mode, by its number in HEARTBEAT.custom_mode."""

    STABILIZE = 0
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17
    SMART_RTL = 21

    @property
    def needs_position(self) -> bool:
        """Return whether ArduCopter refuses the mode without a position."""
        return self not in {CopterMode.STABILIZE, CopterMode.ALT_HOLD, CopterMode.LAND}

    @property
    def controls_position(self) -> bool:
        """Return whether ArduCopter's position controller runs in the mode."""
        return self.needs_position or self is CopterMode.LAND

    @property
    def is_manual(self) -> bool:
        """Return whether a pilot's sticks fly the ArduCopter mode."""
        return self in {
            CopterMode.STABILIZE,
            CopterMode.ALT_HOLD,
            CopterMode.LOITER,
            CopterMode.POSHOLD,
        }

    @property
    def is_autopilot(self) -> bool:
        """Return whether ArduCopter calls the mode an autopilot's (Mode::is_autopilot)."""
        return not self.is_manual and self is not CopterMode.BRAKE

    @property
    def allows_arming(self) -> bool:
        """Return whether ArduCopter allows arming in the mode."""
        return self not in {
            CopterMode.AUTO,
            CopterMode.RTL,
            CopterMode.LAND,
            CopterMode.BRAKE,
            CopterMode.SMART_RTL,
        }

    @property
    def words(self) -> str:
        """Return the mode's name in ArduCopter's texts."""
        return "SMARTRTL" if self is CopterMode.SMART_RTL else self.name


_STANDARD = {"LOITER": 1, "ALT_HOLD": 4, "SMART_RTL": 5, "AUTO": 6, "LAND": 7}
"""MAV_STANDARD_MODE of those that are one."""

ENTRIES = tuple(
    ModeEntry(mode.name, mode.value, standard=_STANDARD.get(mode.name, 0)) for mode in CopterMode
)


def copter_mode(number: int) -> CopterMode | None:
    """Return the ArduCopter mode of a number; None for one that is not emulated."""
    try:
        return CopterMode(number)
    except ValueError:
        return None
