"""Checks whether usual ports of autopilots and ground stations are in use, and by what."""

import contextlib
import errno
import socket
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from wil_campaign.plugins.doctor.findings import Finding

TOPIC = "ports"
Protocol = Literal["udp", "tcp"]


@dataclass(frozen=True, slots=True)
class UsualPort:
    """A port by convention, and its use."""

    number: int
    protocol: Protocol
    purpose: str


USUAL = (
    UsualPort(14540, "udp", "PX4's companion link"),
    UsualPort(14541, "udp", "companion link of a second PX4"),
    UsualPort(14550, "udp", "ground stations"),
    UsualPort(5760, "tcp", "ArduPilot SITL"),
    UsualPort(5770, "tcp", "second ArduPilot SITL"),
)


def usual_port_findings(ports: Iterable[UsualPort] = USUAL) -> Iterator[Finding]:
    """Yield findings on usual ports that are in use, with the process."""
    free: list[str] = []
    for port in ports:
        name = f"{port.protocol} {port.number}"
        if not is_port_in_use(port.number, port.protocol):
            free.append(name)
            continue
        holder = port_holder(port.number, port.protocol)
        by = "by a process of another user" if holder is None else f"by {holder}"
        yield Finding(
            TOPIC,
            "note",
            f"{name} ({port.purpose}) is in use {by}",
            "end the process, give it another port, or give the campaign's link another port",
        )
    if free:
        yield Finding(TOPIC, "good", f"free: {', '.join(free)}")


def is_port_in_use(number: int, protocol: Protocol) -> bool:
    """Return whether a port is in use: it cannot be bound on all addresses."""
    kind = socket.SOCK_DGRAM if protocol == "udp" else socket.SOCK_STREAM
    with socket.socket(socket.AF_INET, kind) as probe:
        if protocol == "tcp":
            # A connection that just ended does not hold the port.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("0.0.0.0", number))  # noqa: S104 - as autopilots and ground stations do
        except OSError as error:
            return error.errno == errno.EADDRINUSE
    return False


def port_holder(number: int, protocol: Protocol) -> str | None:
    """Return name and id of the process that uses a port; None where unknown."""
    sockets = {f"socket:[{inode}]" for inode in _inodes(number, protocol)}
    for process in Path("/proc").iterdir() if sockets else ():
        if process.name.isdecimal() and sockets.intersection(_open_files(process)):
            with contextlib.suppress(OSError):
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
    return None


def _open_files(process: Path) -> Iterator[str]:
    """Yield what a process has open; nothing of one that ended meanwhile, or is somebody else's."""
    with contextlib.suppress(OSError):
        for link in (process / "fd").iterdir():
            with contextlib.suppress(OSError):
                yield str(link.readlink())


def _inodes(number: int, protocol: Protocol) -> Iterator[str]:
    """Yield the inodes of sockets bound to a port: proc(5), /proc/net/udp."""
    for table in (protocol, f"{protocol}6"):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
                fields = line.split()
                if int(fields[1].rpartition(":")[2], 16) == number:
                    yield fields[9]
