"""Launches PX4's own simulation (SITL) from a build folder or a container image.

Command line, ports and environment: platforms/posix/src/px4/common/main.cpp,
ROMFS/px4fmu_common/init.d-posix/{rcS,px4-rc.mavlink}, Tools/simulation/sitl_multiple_run.sh and
Tools/packaging/containers of PX4.
"""

import os
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from wil_campaign.foundation.files.paths import is_file, is_folder
from wil_campaign.plugins.firmware.launch_plan import (
    LaunchPlan,
    LaunchPort,
    PlannedLaunch,
    launch_executable,
    parameter_text,
)
from wil_campaign.plugins.firmware.prepared_launch import PreparedLaunch
from wil_campaign.vehicles.launch import LaunchError, LaunchPart, Pace, Text, path_beside_campaign
from wil_campaign.vehicles.links.link_strings import LinkAddress

_API_PORT = 14540
_LOCAL_PORTS = (14580, 14280, 13030, 18570)
"""The ports that each instance binds: API, payload, gimbal, ground station; plus the instance."""
_SIH_PORT = 19450
_HOOK = "px4-rc.simulator"
"""The script that rcS runs just before the modules start, from the first folder in PATH."""
_CONTAINER_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_READY = ("Startup script returned successfully",)
_FATAL = (
    "PX4 server already running",
    "Startup script returned with return value",
    "Error opening startup file",
    "Unknown model",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4Launch(PlannedLaunch):
    """The launch of PX4 from `build` (build/px4_sitl_default) or the container `image`.

    model: its PX4_SIM_MODEL. pace: its PX4_SIM_SPEED_FACTOR; PX4 multiplies its own time-outs by
    it. Instances beyond ten would share one port.
    """

    label: ClassVar[str] = "PX4 SITL"
    instances: ClassVar[int] = 10
    pace_key: ClassVar[str] = "speed"

    build: Path | None = None
    image: str | None = None
    model: str = "sihsim_quadx"

    def __post_init__(self) -> None:
        if (self.build is None) == (self.image is None):
            raise ValueError("PX4 is launched from a build folder or from an image: give one")

    def prepare(self, *, folder: Path, system_id: int) -> PreparedLaunch:
        """Reserve the folder and an instance of the simulator. Raises LaunchError."""
        return PreparedLaunch(launch=self, folder=folder, system_id=system_id)

    def check(self) -> None:
        """Raise LaunchError when PX4's build folder, or docker, is missing."""
        if not 0.0 < self.pace <= 100.0:
            raise LaunchError(f"PX4 SITL: speed {self.pace} is not within 0 to 100")
        if self.build is None:
            self._docker()
            return
        self._binary(self.build)
        if not is_file(self.build / "etc" / "init.d-posix" / "rcS"):
            raise LaunchError(
                f"PX4 SITL: {self.build} has no etc/init.d-posix/rcS; name the build folder, such "
                "as PX4-Autopilot/build/px4_sitl_default"
            )

    def ports(self, instance: int) -> tuple[LaunchPort, ...]:
        """Return the ports that a PX4 instance binds, and the one that the link to it binds."""
        numbers = [_API_PORT + instance, *(base + instance for base in _LOCAL_PORTS)]
        if self.model.startswith("sihsim"):
            numbers.append(_SIH_PORT + instance)
        return tuple(LaunchPort(number, "udp") for number in numbers)

    def plan(self, *, instance: int, system_id: int, folder: Path) -> LaunchPlan:
        """Return PX4's launch plan; parameters and logs go to its working folder."""
        environment = self._environment()
        files = {_HOOK: self._hook(system_id)}
        link = LinkAddress("udpin", host="127.0.0.1", port=_API_PORT + instance)
        if self.build is not None:
            build = self.build.resolve()
            # -d: no shell on stdin. The build's etc is linked into the working folder.
            return LaunchPlan(
                label=self.label,
                argv=(self._binary(build), "-i", str(instance), "-d", str(build / "etc")),
                environment={**environment, "PATH": f"{folder}:{os.environ.get('PATH', '')}"},
                link=link,
                ready=_READY,
                fatal=_FATAL,
                files=files,
            )
        environment["PATH"] = f"/wil:{_CONTAINER_PATH}"
        docker = self._docker()
        name = f"wil-px4-{os.getpid()}-{instance}"
        variables = [part for item in environment.items() for part in ("-e", "=".join(item))]
        argv = (
            docker, "run", "--rm", "--init", "--pull", "never", "--network", "host", "--name", name,
            # Where its parameters and logs go in the container: both below the mounted folder.
            "-v", f"{folder}:/wil", "-e", "XDG_DATA_HOME=/wil", "-e", "XDG_STATE_HOME=/wil",
            *variables, self.image or "", "-d", "-i", str(instance),
        )  # fmt: skip
        return LaunchPlan(
            label=f"{self.label} in {self.image}",
            argv=argv,
            link=link,
            ready=_READY,
            fatal=(
                *_FATAL,
                "No such image",
                "Cannot connect to the Docker daemon",
                "permission denied",
            ),
            # The end of the docker client does not end the container.
            cleanup=(docker, "rm", "--force", name),
            files=files,
        )

    def _hook(self, system_id: int) -> str:
        """Return PX4's start-up hook that sets the parameters, then runs PX4's own.

        rcS sets PX4_PARAM_* of the environment too, but afterwards overwrites the system id
        (instance + 1) and, by the speed, its time-outs.
        """
        wanted = (("MAV_SYS_ID", float(system_id)), *self.params)
        rows = [f"param set {shlex.quote(name)} {parameter_text(value)}" for name, value in wanted]
        return "\n".join((*rows, f'. "${{R}}etc/init.d-posix/{_HOOK}"', ""))

    def _environment(self) -> dict[str, str]:
        variables = {
            "PX4_SIM_MODEL": self.model,
            "PX4_SIM_SPEED_FACTOR": f"{self.pace:g}",
        }
        if self.home is not None:
            variables |= {
                "PX4_HOME_LAT": f"{self.home.latitude_deg:.7f}",
                "PX4_HOME_LON": f"{self.home.longitude_deg:.7f}",
                "PX4_HOME_ALT": f"{self.home.altitude_m:.2f}",
                "PX4_HOME_YAW": f"{self.home.heading_deg:.1f}",
            }
        return variables

    @staticmethod
    def _binary(build: Path) -> str:
        if not is_folder(build):
            raise LaunchError(f"PX4 SITL: there is no build folder {build}; run 'make px4_sitl'")
        return launch_executable(build / "bin" / "px4", "PX4 SITL", "run 'make px4_sitl'")

    @staticmethod
    def _docker() -> str:
        docker = shutil.which("docker")
        if docker is None:
            raise LaunchError(
                "PX4 SITL: docker is not installed, which `image` needs; install docker, or "
                "name a build folder"
            )
        return docker


class Px4LaunchPart(LaunchPart):
    """A vehicle's `launch` of PX4's own simulation: from a `build` folder or an `image`.

    launch: the autopilot whose simulation is started. build: a folder of PX4 that was built for
    SITL, such as build/px4_sitl_default. image: a container image that holds a PX4 built for SITL.
    model: PX4's name of the simulated airframe (PX4_SIM_MODEL). speed: how many times real time it
    simulates, at most 100.
    """

    name: ClassVar[str] = "px4"

    launch: Literal["px4"]
    build: Text | None = None
    image: Text | None = None
    model: Text = "sihsim_quadx"
    speed: Pace = 1.0

    @model_validator(mode="after")
    def _require_exactly_one(self) -> Self:
        """Require either build or image for launching a PX4 vehicle."""
        if (self.build is None) == (self.image is None):
            raise ValueError("give the build folder, or the image")
        return self

    def setup(self, folder: Path) -> Px4Launch:
        """Return the launch of PX4's simulation."""
        return Px4Launch(
            build=None if self.build is None else path_beside_campaign(folder, self.build),
            image=self.image,
            model=self.model,
            pace=self.speed,
        )
