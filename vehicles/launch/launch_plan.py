"""What is to be started, and how it is known that it runs; pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from vehicles.errors import VehicleError
from vehicles.links.link_strings import LinkAddress


class LaunchError(VehicleError):
    """A simulated autopilot that cannot be started, or died; says what it printed."""


@dataclass(frozen=True, slots=True)
class Port:
    """A port on this machine that the program, or our link to it, will bind."""

    number: int
    kind: Literal["tcp", "udp"]


@dataclass(frozen=True, slots=True)
class Home:
    """Where the vehicle stands: WGS-84 degrees, metres above sea level, heading in degrees."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    heading_deg: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchPlan:
    """One program: its arguments, what is added to its environment, and the link to it.

    ready: a line that holds one of these says that it runs. fatal: one that holds one of these
    says that it will not. complaints: lines with these are told when it does not become ready.
    cleanup: a command that removes what remains when the program was killed; empty for none.
    files: by name, what has to stand in its folder before.
    """

    label: str
    argv: tuple[str, ...]
    link: LinkAddress
    ready: tuple[str, ...]
    fatal: tuple[str, ...]
    complaints: tuple[str, ...] = ("ERROR", "Error", "error:")
    environment: Mapping[str, str] = field(default_factory=dict)
    cleanup: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)


BornWith = tuple[tuple[str, float], ...]
"""Parameters that an autopilot boots with: names and values."""


def parameter_text(value: float) -> str:
    """Return a parameter's value as autopilots read it, whole numbers without a point."""
    return str(int(value)) if float(value).is_integer() else f"{value:.9g}"


class Launch(Protocol):
    """A kind of autopilot that can be started several times on one machine."""

    @property
    def label(self) -> str:
        """Return what people call it."""

    @property
    def instances(self) -> int:
        """Return how many can run at once by its port numbers."""

    def check(self) -> None:
        """Raise LaunchError when something that it needs is missing; starts nothing."""

    def ports(self, instance: int) -> tuple[Port, ...]:
        """Return the ports that an instance binds."""

    def plan(self, *, instance: int, system_id: int, folder: Path) -> LaunchPlan:
        """Return what to start for an instance that runs in `folder`."""
