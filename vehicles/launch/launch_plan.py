"""The plan of a simulator's launch: command, link, and the output that shows readiness; pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress


class LaunchError(VehicleError):
    """A simulator cannot be launched, or has died; says what it printed."""


@dataclass(frozen=True, slots=True)
class Port:
    """A port on this machine that the launched program, or the link to it, binds."""

    number: int
    kind: Literal["tcp", "udp"]


@dataclass(frozen=True, slots=True)
class Home:
    """The launched vehicle's home: WGS-84 degrees, metres above sea level, heading in degrees."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    heading_deg: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LaunchPlan:
    """A plan to launch one program: arguments, environment additions, and the link to it.

    ready: texts of output lines that show that it runs. fatal: texts of lines that show that it
    will not. complaints: texts of lines that are reported when it does not become ready.
    cleanup: a command that removes what remains when the program was killed; empty for none.
    files: contents by name, to be written into its folder first.
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


BootParams = tuple[tuple[str, float], ...]
"""Parameters that an autopilot boots with: names and values."""


def parameter_text(value: float) -> str:
    """Return a parameter's value as launched autopilots read it, integers without a point."""
    return str(int(value)) if float(value).is_integer() else f"{value:.9g}"


class Launch(Protocol):
    """A kind of simulator that can be launched several times on one machine (protocol)."""

    @property
    def label(self) -> str:
        """Return the launch's name in messages."""

    @property
    def instances(self) -> int:
        """Return how many instances of the launch port numbers allow."""

    def check(self) -> None:
        """Raise LaunchError when something that the launch needs is missing; starts nothing."""

    def ports(self, instance: int) -> tuple[Port, ...]:
        """Return the ports that an instance of the launch binds."""

    def plan(self, *, instance: int, system_id: int, folder: Path) -> LaunchPlan:
        """Return the launch plan of an instance that runs in `folder`."""
