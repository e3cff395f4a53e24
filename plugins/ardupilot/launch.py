"""Launches ArduCopter's own simulation (SITL).

Command line and ports: libraries/AP_HAL_SITL/SITL_cmdline.cpp and UARTDriver.cpp of ArduPilot.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from wil_campaign.foundation.files.paths import is_file
from wil_campaign.hooks import links
from wil_campaign.installed_plugins import absent_additions
from wil_campaign.plugins.firmware.launch_plan import (
    LaunchPlan,
    LaunchPort,
    PlannedLaunch,
    launch_executable,
    parameter_text,
)
from wil_campaign.plugins.firmware.prepared_launch import PreparedLaunch
from wil_campaign.vehicles.launch import (
    LaunchError,
    LaunchHome,
    LaunchPart,
    Pace,
    Text,
    path_beside_campaign,
)
from wil_campaign.vehicles.links.link_strings import LinkAddress

_LINK = "tcpout"
_BASE_PORT = 5760
_PER_INSTANCE = 10
_BOOT_PARAMS_FILE = "campaign.parm"
_TREE = Path("Tools", "autotest", "default_params")
_FRAME = "FRAME_CLASS"


@dataclass(frozen=True, slots=True, kw_only=True)
class ArduPilotLaunch(PlannedLaunch):
    """The launch of an arducopter binary built for SITL.

    frame: its --model ("quad", "hexa"). defaults: parameter files, later ones win; empty for those
    of its source tree for the frame, without which its frame class is undefined and it never arms.
    params are set on top of the defaults.
    """

    label: ClassVar[str] = "ArduPilot SITL"
    instances: ClassVar[int] = 50
    pace_key: ClassVar[str] = "speedup"

    binary: Path
    frame: str = "quad"
    defaults: tuple[Path, ...] = ()

    def prepare(self, *, folder: Path, system_id: int) -> PreparedLaunch:
        """Reserve the folder and an instance of the simulator. Raises LaunchError."""
        return PreparedLaunch(launch=self, folder=folder, system_id=system_id)

    def check(self) -> None:
        """Raise LaunchError when the binary, a parameter file or links by TCP are missing."""
        launch_executable(self.binary, "ArduPilot SITL", "build it with './waf copter'")
        for file in self.defaults:
            if not is_file(file):
                raise LaunchError(f"ArduPilot SITL: there is no parameter file {file}")
        if not self._parameter_files() and _FRAME not in dict(self.params):
            raise LaunchError(
                f"ArduPilot SITL: no folder above {self.binary} has {_TREE}/copter.parm, and "
                f"without parameters its {_FRAME} is 0 and it never arms; name that file in "
                "'defaults'"
            )
        if not 0.0 < self.pace <= 100.0:
            raise LaunchError(f"ArduPilot SITL: speedup {self.pace} is not within 0 to 100")
        if why := absent_additions(links).get(_LINK):
            raise LaunchError(f"ArduPilot SITL: {why}")

    def ports(self, instance: int) -> tuple[LaunchPort, ...]:
        """Return ArduPilot's ports: serial 0 to 2 and its input for remote control."""
        tcp, rc = _BASE_PORT + _PER_INSTANCE * instance, 5501 + _PER_INSTANCE * instance
        return (
            LaunchPort(tcp, "tcp"),
            LaunchPort(tcp + 2, "tcp"),
            LaunchPort(tcp + 3, "tcp"),
            LaunchPort(rc, "udp"),
        )

    def plan(self, *, instance: int, system_id: int, folder: Path) -> LaunchPlan:
        """Return ArduPilot's launch plan; eeprom and logs go to its working folder."""
        argv = [
            launch_executable(self.binary, "ArduPilot SITL", "build it with './waf copter'"),
            "--model", self.frame,
            "--speedup", f"{self.pace:g}",
            "--instance", str(instance),
            "--sysid", str(system_id),
        ]  # fmt: skip
        defaults = [file.resolve() for file in self._parameter_files()]
        files: dict[str, str] = {}
        if self.params:
            rows = (f"{name} {parameter_text(value)}\n" for name, value in self.params)
            files[_BOOT_PARAMS_FILE] = "".join(rows)
            defaults.append(folder.resolve() / _BOOT_PARAMS_FILE)
        if defaults:
            argv += ["--defaults", ",".join(map(str, defaults))]
        if self.home is not None:
            argv += ["--home", _home_argument(self.home)]
        port = _BASE_PORT + _PER_INSTANCE * instance
        return LaunchPlan(
            label=self.label,
            argv=tuple(argv),
            link=LinkAddress(_LINK, host="127.0.0.1", port=port),
            # It boots when a client connects, and serves only the first one: a probe of the port
            # would take the link's place.
            ready=("Waiting for connection", f"SERIAL0 on TCP port {port}"),
            files=files,
            fatal=("bind failed on port", "Vehicle model (", "PANIC", "Failed to load defaults"),
        )

    def _parameter_files(self) -> tuple[Path, ...]:
        """Return ArduPilot's default parameter files, as of sim_vehicle.py."""
        if self.defaults:
            return self.defaults
        binary = Path(shutil.which(str(self.binary)) or self.binary).resolve()
        folders = (folder / _TREE for folder in binary.parents)
        found = next((path for path in folders if is_file(path / "copter.parm")), None)
        if found is None:
            return ()
        parts = self.frame.partition(":")[0].split("-")
        names = ["-".join(parts[: count + 1]) for count in range(len(parts))]
        own = [found / f"copter-{name}.parm" for name in names]
        return (found / "copter.parm", *(file for file in own if is_file(file)))


def _home_argument(home: LaunchHome) -> str:
    """Return ArduPilot's --home argument."""
    place = f"{home.latitude_deg:.7f},{home.longitude_deg:.7f},{home.altitude_m:.2f}"
    return f"{place},{home.heading_deg:.1f}"


class ArduPilotLaunchPart(LaunchPart):
    """A vehicle's `launch` of ArduCopter's own simulation (SITL).

    binary: one built for SITL, beside this file or on PATH. defaults: parameter files, later ones
    win. launch: the autopilot whose simulation is started. frame: ArduPilot's name of the airframe
    (its --model). speedup: how many times real time it simulates, at most 100.
    """

    name: ClassVar[str] = "ardupilot"

    launch: Literal["ardupilot"]
    binary: Text
    frame: Text = "quad"
    defaults: list[Text] = Field(default_factory=list)
    speedup: Pace = 1.0

    def setup(self, folder: Path) -> ArduPilotLaunch:
        """Return the launch of ArduPilot's simulation."""
        named = Path(self.binary)
        return ArduPilotLaunch(
            # A bare name is looked for on PATH.
            binary=named
            if named.name == self.binary
            else path_beside_campaign(folder, self.binary),
            frame=self.frame,
            defaults=tuple(path_beside_campaign(folder, file) for file in self.defaults),
            pace=self.speedup,
        )
