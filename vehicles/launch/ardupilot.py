"""Launches ArduCopter's own simulation (SITL).

Command line and ports: libraries/AP_HAL_SITL/SITL_cmdline.cpp and UARTDriver.cpp of ArduPilot.
"""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from wil_campaign.foundation.files.paths import exists, is_file, is_folder
from wil_campaign.vehicles.launch.launch_plan import (
    BootParams,
    Home,
    LaunchError,
    LaunchPlan,
    Port,
    parameter_text,
)
from wil_campaign.vehicles.links.link_strings import LinkAddress

_BASE_PORT = 5760
_PER_INSTANCE = 10
_BOOT_PARAMS_FILE = "campaign.parm"
_TREE = Path("Tools", "autotest", "default_params")
_FRAME = "FRAME_CLASS"


@dataclass(frozen=True, slots=True, kw_only=True)
class ArduPilotLaunch:
    """The launch of an arducopter binary built for SITL.

    frame: its --model ("quad", "hexa"). defaults: parameter files, later ones win; empty for those
    of its source tree for the frame, without which its frame class is undefined and it never arms.
    speedup: how many times real time its clock runs, if the machine can. params: boot parameters,
    on top of the defaults.
    """

    binary: Path
    frame: str = "quad"
    defaults: tuple[Path, ...] = ()
    speedup: float = 1.0
    home: Home | None = None
    params: BootParams = ()

    @property
    def label(self) -> str:
        """Return the ArduPilot launch's name in messages."""
        return "ArduPilot SITL"

    @property
    def instances(self) -> int:
        """Return how many ArduPilot instances port numbers allow."""
        return 50

    def check(self) -> None:
        """Raise LaunchError when the binary or a parameter file is missing."""
        executable(self.binary, "ArduPilot SITL", "build it with './waf copter'")
        for file in self.defaults:
            if not is_file(file):
                raise LaunchError(f"ArduPilot SITL: there is no parameter file {file}")
        if not self._parameter_files() and _FRAME not in dict(self.params):
            raise LaunchError(
                f"ArduPilot SITL: no folder above {self.binary} has {_TREE}/copter.parm, and "
                f"without parameters its {_FRAME} is 0 and it never arms; name that file in "
                "'defaults'"
            )
        if not 0.0 < self.speedup <= 100.0:
            raise LaunchError(f"ArduPilot SITL: speedup {self.speedup} is not within 0 to 100")

    def ports(self, instance: int) -> tuple[Port, ...]:
        """Return ArduPilot's ports: serial 0 to 2 and its input for remote control."""
        tcp, rc = _BASE_PORT + _PER_INSTANCE * instance, 5501 + _PER_INSTANCE * instance
        return (Port(tcp, "tcp"), Port(tcp + 2, "tcp"), Port(tcp + 3, "tcp"), Port(rc, "udp"))

    def plan(self, *, instance: int, system_id: int, folder: Path) -> LaunchPlan:
        """Return ArduPilot's launch plan; eeprom and logs go to its working folder."""
        argv = [
            executable(self.binary, "ArduPilot SITL", "build it with './waf copter'"),
            "--model", self.frame,
            "--speedup", f"{self.speedup:g}",
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
            link=LinkAddress("tcpout", host="127.0.0.1", port=port),
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


def _home_argument(home: Home) -> str:
    """Return ArduPilot's --home argument."""
    place = f"{home.latitude_deg:.7f},{home.longitude_deg:.7f},{home.altitude_m:.2f}"
    return f"{place},{home.heading_deg:.1f}"


def executable(path: Path, label: str, remedy: str) -> str:
    """Return a launched program's absolute path, PATH included. Raises LaunchError."""
    found = shutil.which(str(path))
    if found is not None:
        return str(Path(found).absolute())
    if not exists(path):
        raise LaunchError(f"{label}: there is no program {path}; {remedy}, or correct the path")
    if is_folder(path):
        raise LaunchError(f"{label}: {path} is a folder; name the program in it")
    if not os.access(path, os.X_OK):
        raise LaunchError(f"{label}: {path} is not executable; run 'chmod +x {path}'")
    raise LaunchError(f"{label}: {path} cannot be executed")
