"""Checks for SITL builds of autopilots, and docker images."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

from wil_campaign.foundation.files.paths import is_file
from wil_campaign.plugins.doctor.findings import Finding
from wil_campaign.vehicles.autopilots.registry import autopilot_strategies

AUTOPILOTS = "autopilots"
_DOCKER_S = 5.0
Which = Callable[[str], str | None]


def autopilot_program_findings(home: Path | None, which: Which = shutil.which) -> Iterator[Finding]:
    """Yield findings on ArduPilot and PX4 SITL, beneath `home` and on PATH."""
    known = " and ".join(strategy.label for strategy in autopilot_strategies().values())
    yield Finding(AUTOPILOTS, "good", f"embedded {known}: nothing to install")
    copter = _first(home, "ardupilot/build/sitl/bin/arducopter") or which("arducopter")
    if copter:
        yield Finding(
            AUTOPILOTS, "good", f"ArduCopter: link: {{launch: ardupilot, binary: {copter}}}"
        )
    else:
        yield Finding(
            AUTOPILOTS,
            "note",
            "no arducopter in ~/ardupilot/build/sitl/bin or on PATH",
            "to launch it: ./waf configure --board sitl && ./waf copter in ArduPilot's folder",
        )
    px4 = _first(home, "PX4-Autopilot/build/px4_sitl_default/bin/px4")
    if px4:
        build = px4.parent.parent
        yield Finding(AUTOPILOTS, "good", f"PX4: link: {{launch: px4, build: {build}}}")
    else:
        yield Finding(
            AUTOPILOTS,
            "note",
            "no PX4 build in ~/PX4-Autopilot/build/px4_sitl_default",
            "to launch it: make px4_sitl in PX4's folder, or use a container image",
        )
    yield from _docker(which)


def _docker(which: Which) -> Iterator[Finding]:
    """Yield the finding on docker and its images of PX4."""
    docker = which("docker")
    if docker is None:
        yield Finding(AUTOPILOTS, "note", "docker is not installed; only images of PX4 need it")
        return
    try:
        result = subprocess.run(  # noqa: S603 - docker's client, found on PATH
            [docker, "image", "ls", "--format", "{{.Repository}}:{{.Tag}}"],
            capture_output=True,
            text=True,
            timeout=_DOCKER_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Finding(AUTOPILOTS, "note", f"docker does not answer: {error}", "start its daemon")
        return
    if result.returncode:
        reason = (result.stderr.strip().splitlines() or ["no message"])[-1]
        yield Finding(
            AUTOPILOTS,
            "note",
            f"docker failed: {reason}",
            "start its daemon, or add yourself to the group docker and log in again",
        )
        return
    images = [line for line in result.stdout.splitlines() if "px4" in line.lower()]
    if images:
        yield Finding(AUTOPILOTS, "good", f"docker, with images of PX4: {', '.join(images)}")
    else:
        remedy = "docker pull px4io/px4-sitl"
        yield Finding(AUTOPILOTS, "note", "docker, without an image of PX4", remedy)


def _first(home: Path | None, place: str) -> Path | None:
    """Return a program's path beneath home; None if it is not a file."""
    return home / place if home is not None and is_file(home / place) else None
