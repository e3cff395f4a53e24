"""The plan of a simulator's launch: command, link, and the output that shows readiness; pure."""

import os
import shutil
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

from wil_campaign.foundation.files.paths import is_folder, path_exists
from wil_campaign.vehicles.launch import LaunchError, SimulatorLaunch
from wil_campaign.vehicles.links.link_strings import LinkAddress


@dataclass(frozen=True, slots=True)
class LaunchPort:
    """A port on this machine that the launched program, or the link to it, binds."""

    number: int
    kind: Literal["tcp", "udp"]


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


def parameter_text(value: float) -> str:
    """Return a parameter's value as launched autopilots read it, integers without a point."""
    return str(int(value)) if float(value).is_integer() else f"{value:.9g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedLaunch(SimulatorLaunch):
    """A kind of simulator that can be launched several times on one machine."""

    label: ClassVar[str]
    """Its name in messages."""
    instances: ClassVar[int]
    """How many of them port numbers allow."""

    @abstractmethod
    def ports(self, instance: int) -> tuple[LaunchPort, ...]:
        """Return the ports that an instance of the launch binds."""

    @abstractmethod
    def plan(self, *, instance: int, system_id: int, folder: Path) -> LaunchPlan:
        """Return the launch plan of an instance that runs in `folder`."""


def launch_executable(path: Path, label: str, remedy: str) -> str:
    """Return a launched program's absolute path, PATH included. Raises LaunchError."""
    found = shutil.which(str(path))
    if found is not None:
        return str(Path(found).absolute())
    if not path_exists(path):
        raise LaunchError(f"{label}: there is no program {path}; {remedy}, or correct the path")
    if is_folder(path):
        raise LaunchError(f"{label}: {path} is a folder; name the program in it")
    if not os.access(path, os.X_OK):
        raise LaunchError(f"{label}: {path} is not executable; run 'chmod +x {path}'")
    raise LaunchError(f"{label}: {path} cannot be executed")
