"""Checks for SITL builds of autopilots, docker images and MQTT brokers."""

import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

from orchestrator.doctor.findings import Finding

AUTOPILOTS = "autopilots"
BROKERS = "brokers"
_BROKER_PORT = 1883
_DOCKER_S = 5.0
Which = Callable[[str], str | None]


def autopilots(home: Path, which: Which = shutil.which) -> Iterator[Finding]:
    """Yield findings on ArduPilot and PX4 SITL, beneath `home` and on PATH."""
    yield Finding(AUTOPILOTS, "good", "embedded PX4 and ArduCopter: nothing to install")
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


def brokers(
    which: Which = shutil.which, port: int = _BROKER_PORT, module: str = "amqtt"
) -> Iterator[Finding]:
    """Yield findings on MQTT brokers that run here or are installed."""
    if _broker_answers(port):
        yield Finding(BROKERS, "good", f"a program answers on tcp {port}, MQTT's port")
    elif which("mosquitto"):
        yield Finding(BROKERS, "note", "mosquitto is installed but not running", "mosquitto -d")
    else:
        yield Finding(
            BROKERS,
            "note",
            f"no broker answers on tcp {port}, and mosquitto is not on PATH",
            "for operators on other machines: apt install mosquitto",
        )
    if find_spec(module) is not None:
        yield Finding(BROKERS, "good", f"{module}, a broker in Python, is installed")


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


def _first(home: Path, place: str) -> Path | None:
    """Return a program's path beneath home; None if it is not a file."""
    found = home / place
    return found if found.is_file() else None


def _broker_answers(port: int) -> bool:
    """Return whether a program accepts connections on a local port."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=0.5):
            return True
    except OSError:
        return False
