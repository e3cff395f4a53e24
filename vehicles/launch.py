"""The launch of an autopilot's own simulation, which a plugin adds; the guard is its parent."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Protocol

from pydantic import Field

from wil_campaign.foundation.files.documents import Part
from wil_campaign.foundation.files.paths import expanded_path
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.links.link_strings import LinkAddress


class LaunchError(VehicleError):
    """A simulator cannot be launched, or has died; says what it printed."""


@dataclass(frozen=True, slots=True)
class LaunchHome:
    """The launched vehicle's home: WGS-84 degrees, metres above sea level, heading in degrees."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    heading_deg: float = 0.0


BootParams = tuple[tuple[str, float], ...]
"""Parameters that an autopilot boots with: names and values."""


StartProcess = Callable[[tuple[str, ...], Mapping[str, str]], Awaitable[int]]
"""Starts a command with additions to the environment; returns its process id."""


class ReservedLaunch(AbstractContextManager["ReservedLaunch"], Protocol):
    """What a launch has reserved, which its exit releases (protocol)."""

    @property
    def link(self) -> LinkAddress:
        """Return the link to the simulator."""

    async def start(self, process: StartProcess, end: "asyncio.Future[int | None]") -> None:
        """Start the simulator, and wait until it is ready. Raises LaunchError.

        end: done when its process has ended, with the exit code.
        """

    async def clean_up(self) -> None:
        """Remove what remains of an ended simulator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorLaunch(ABC):
    """A launch of a simulator.

    pace: how many times real time its clock runs, if the machine can. params: boot parameters.
    """

    pace_key: ClassVar[str]
    """The key of its `link` that has its pace."""

    pace: float = 1.0
    home: LaunchHome | None = None
    params: BootParams = ()

    @abstractmethod
    def check(self) -> None:
        """Raise LaunchError when something that the launch needs is missing; starts nothing."""

    @abstractmethod
    def prepare(self, *, folder: Path, system_id: int) -> ReservedLaunch:
        """Reserve what a launch in a new folder needs. Raises LaunchError."""


Text = Annotated[str, Field(min_length=1)]
Pace = Annotated[float, Field(gt=0, le=100)]


class LaunchPart(Part):
    """A vehicle's `link` that launches a simulation of its autopilot, which `launch` names."""

    launch: str

    def setup(self, folder: Path) -> SimulatorLaunch:
        """Return the launch that a campaign in a folder asks for, without parameters."""
        raise NotImplementedError


def path_beside_campaign(folder: Path, text: str) -> Path:
    """Return a file's path relative to the campaign's folder, or to the home by ~."""
    return (folder / expanded_path(Path(text))).absolute()
