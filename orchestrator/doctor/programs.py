"""Autopilots' simulations and MQTT brokers that are at hand."""

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
    """Yield findings on the programs of ArduPilot and PX4 SITL; beneath `home` and on PATH."""
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
    """Yield the finding whether an MQTT broker program runs here, or could be started."""
    if _broker_answers(port):
        yield Finding(BROKERS, "good", f"something answers on tcp {port}, MQTT's port")
    elif which("mosquitto"):
        yield Finding(BROKERS, "note", "mosquitto is installed and does not run", "mosquitto -d")
    else:
        yield Finding(
            BROKERS,
            "note",
            f"no broker answers on tcp {port}, and there is no mosquitto on PATH",
            "for operators on other machines: apt install mosquitto",
        )
    if find_spec(module) is not None:
        yield Finding(BROKERS, "good", f"{module}, a broker in Python, is installed")


def _docker(which: Which) -> Iterator[Finding]:
    """Yield findings on the program docker."""
    docker = which("docker")
    if docker is None:
        yield Finding(AUTOPILOTS, "note", "no docker; only images of PX4 need it")
        return
    try:
        asked = subprocess.run(  # noqa: S603 - docker's client, found on PATH
            [docker, "image", "ls", "--format", "{{.Repository}}:{{.Tag}}"],
            capture_output=True,
            text=True,
            timeout=_DOCKER_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        yield Finding(AUTOPILOTS, "note", f"docker does not answer: {error}", "start its daemon")
        return
    if asked.returncode:
        said = (asked.stderr.strip().splitlines() or ["it printed nothing"])[-1]
        yield Finding(
            AUTOPILOTS,
            "note",
            f"docker refuses: {said}",
            "start its daemon, or add yourself to the group docker and log in again",
        )
        return
    images = [line for line in asked.stdout.splitlines() if "px4" in line.lower()]
    if images:
        yield Finding(AUTOPILOTS, "good", f"docker, with images of PX4: {', '.join(images)}")
    else:
        said = "docker pull px4io/px4-sitl"
        yield Finding(AUTOPILOTS, "note", "docker, without an image of PX4", said)


def _first(home: Path, place: str) -> Path | None:
    """Return a program's path beneath home; None when it is no file."""
    found = home / place
    return found if found.is_file() else None


def _broker_answers(port: int) -> bool:
    """Return whether a broker program listens on a local port."""
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=0.5):
            return True
    except OSError:
        return False
