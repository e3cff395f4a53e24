"""The firmware that flew: of each vehicle of a run its version, board, and parameters' digest."""

from collections.abc import Iterable
from dataclasses import dataclass

_SHORT = 10
"""Digits of a git hash in a text."""


@dataclass(frozen=True, slots=True)
class FlownFirmware:
    """The firmware of one vehicle, as it identified itself before arming.

    version: with the kind of release, as "4.7.0-dev". board: its vendor, product and board ids;
    "simulation" of one; "emulated" of an embedded vehicle, which says what it emulates. uid: of the
    board; not unique of a simulation. frame: its MAV_TYPE, with
    the parameters that tell its frame. parameters: a digest of all parameters with which it flew,
    without those that change by themselves; empty where it was not received. All as it says.
    """

    vehicle: str
    autopilot: str
    version: str
    git_hash: str
    board: str
    uid: str
    frame: str
    parameters: str

    @property
    def release(self) -> str:
        """Return autopilot, version and git hash in words."""
        is_known = bool(self.git_hash.strip("0"))
        commit = f" ({self.git_hash[:_SHORT]})" if is_known else ""
        return f"{self.autopilot} {self.version}{commit}"

    @property
    def kind(self) -> tuple[str, ...]:
        """Return what two vehicles with the same firmware on the same kind of board share."""
        return (self.autopilot, self.version, self.git_hash, self.board, self.frame)

    @property
    def unit(self) -> str:
        """Return the board's own uid; empty of a simulation, whose uid is of its machine."""
        return "" if self.board in {"simulation", "emulated"} else self.uid

    def __str__(self) -> str:
        parts = [self.release, self.board, self.frame, f"uid {self.uid}" if self.uid else ""]
        parts.append(f"parameters {self.parameters}" if self.parameters else "")
        return ", ".join(part for part in parts if part)


def firmware_changes(before: FlownFirmware, now: FlownFirmware) -> tuple[str, str]:
    """Return in words how the firmware of a vehicle differs, and how its unit does; empty for not.

    The unit: the board's own uid, and the parameters, where both are known.
    """
    kind = ""
    if before.kind != now.kind:
        kind = (
            f"the firmware of {now.vehicle} was {before.release}, {before.board}, {before.frame}; "
            f"now it is {now.release}, {now.board}, {now.frame}"
        )
    unit = []
    if before.unit and now.unit and before.unit != now.unit:
        unit.append(f"the uid of its board was {before.unit}, now it is {now.unit}")
    if before.parameters and now.parameters and before.parameters != now.parameters:
        unit.append(
            f"the digest of its parameters was {before.parameters}, now it is {now.parameters}"
        )
    return kind, f"{now.vehicle}: {'; '.join(unit)}" if unit else ""


def distinct(firmware: Iterable[FlownFirmware]) -> tuple[FlownFirmware, ...]:
    """Return each firmware once, by vehicle, in the order in which they flew."""
    found = dict.fromkeys(firmware)
    return tuple(sorted(found, key=lambda one: one.vehicle))
