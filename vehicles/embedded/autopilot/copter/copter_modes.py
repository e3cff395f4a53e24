"""ArduCopter's modes: numbers, names, and what they need.

Source: ArduCopter/mode.h (4.7).
"""

from enum import Enum

from vehicles.embedded.autopilot.services.discovery import ModeEntry


class CopterMode(Enum):
    """The number that HEARTBEAT.custom_mode carries."""

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
        """Return whether it is refused without a position."""
        return self not in {CopterMode.STABILIZE, CopterMode.ALT_HOLD, CopterMode.LAND}

    @property
    def controls_position(self) -> bool:
        """Return whether the horizontal position controller runs in it."""
        return self.needs_position or self is CopterMode.LAND

    @property
    def is_manual(self) -> bool:
        """Return whether a person's sticks fly it."""
        return self in {
            CopterMode.STABILIZE,
            CopterMode.ALT_HOLD,
            CopterMode.LOITER,
            CopterMode.POSHOLD,
        }

    @property
    def allows_arming(self) -> bool:
        """Return whether arming is allowed in it."""
        return self not in {
            CopterMode.AUTO,
            CopterMode.RTL,
            CopterMode.LAND,
            CopterMode.BRAKE,
            CopterMode.SMART_RTL,
        }

    @property
    def words(self) -> str:
        """Return the name that ArduCopter uses in its texts."""
        return {"ALT_HOLD": "AltHold", "POSHOLD": "PosHold", "SMART_RTL": "SmartRTL"}.get(
            self.name, self.name if self is CopterMode.RTL else self.name.capitalize()
        )


_STANDARD = {"LOITER": 1, "ALT_HOLD": 4, "SMART_RTL": 5, "AUTO": 6, "LAND": 7}
"""MAV_STANDARD_MODE of those that are one."""

ENTRIES = tuple(
    ModeEntry(mode.name, mode.value, standard=_STANDARD.get(mode.name, 0)) for mode in CopterMode
)


def copter_mode(number: int) -> CopterMode | None:
    """Return the mode of a number; None for one that is not flown here."""
    try:
        return CopterMode(number)
    except ValueError:
        return None
