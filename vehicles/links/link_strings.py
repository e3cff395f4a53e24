"""Parses link strings, and suggests the right form for the spellings of other tools."""

import difflib
import re
from dataclasses import dataclass

from wil_campaign.hooks import links
from wil_campaign.installed_plugins import absent_additions, plugin_additions
from wil_campaign.vehicles.links.link import LinkError

_USUAL_BAUD = 57600
"""Telemetry radios (SiK) come set to it."""
_HOST_PORT = re.compile(r"(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^:/\[\]\s]+):(?P<port>\d{1,5})")
_DEVICE_BAUD = re.compile(r"(?P<device>\S+):(?P<baud>\d+)")
_FOREIGN_NET = re.compile(
    r"(?P<kind>udpin|udpout|udp|udpbcast|udpci|tcp|tcpin|tcpout):(?://)?"
    r"(?P<host>\[[0-9A-Fa-f:.]+\]|[^:/\[\]\s]*):(?P<port>\d{1,5})/?"
)
_FOREIGN_SERIAL = re.compile(
    r"(?:serial:)?/*(?P<device>/dev/[^:,\s]+|/?COM\d+|tty\w+)(?:[:,](?P<baud>\d+))?"
)
_FOREIGN_KIND = {
    "udp": "udpin",
    "udpbcast": "udpout",
    "udpci": "udpin",
    "tcp": "tcpout",
}


class LinkAddressError(LinkError, ValueError):
    """A link string cannot be parsed; says the right form."""


@dataclass(frozen=True, slots=True)
class LinkAddress:
    """The address in a link string: host and port of a network link, or device and baud.

    kind: the name of a `LinkKind`.
    """

    kind: str
    host: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0

    def __str__(self) -> str:
        """Return the address as a link string."""
        if self.device:
            return f"{self.kind}://{self.device}:{self.baud}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}://{host}:{self.port}" if host else f"{self.kind}://"


def parse_link(text: str) -> LinkAddress:
    """Return the address that a link string names.

    `udpin://host:port` (listens), `udpout://host:port` (sends first), `memory://`, and those of
    plugins: `tcpout://`, `tcpin://`, `serial:///dev/ttyACM0:921600`. Raises LinkAddressError, with
    the string that was probably meant.
    """
    name, mark, rest = text.partition("://")
    if mark and (why := absent_additions(links).get(name)):
        raise LinkAddressError(why)
    kind = plugin_additions(links).get(name) if mark else None
    if kind is None:
        raise _unreadable(text)
    if kind.at == "":
        return LinkAddress(name)
    if kind.at == "device":
        return _of_device(text, name, rest)
    match = _HOST_PORT.fullmatch(rest)
    if match is None:
        raise _unreadable(text, f"{name}:// needs host:port")
    port = int(match["port"])
    if not 1 <= port <= 65535:
        raise _unreadable(text, f"port {port} is not within 1..65535")
    return LinkAddress(name, host=match["host"].strip("[]"), port=port)


def _of_device(text: str, kind: str, rest: str) -> LinkAddress:
    match = _DEVICE_BAUD.fullmatch(rest)
    if match is None:
        raise _unreadable(text, f"{kind}:// needs device:baud")
    baud = int(match["baud"])
    if not 1200 <= baud <= 12_000_000:
        raise _unreadable(text, f"{baud} is not a baud rate; serial ports have 1200 to 12000000")
    return LinkAddress(kind, device=match["device"], baud=baud)


def _unreadable(text: str, why: str = "") -> LinkAddressError:
    suggestion = _suggestion(text)
    meant = f"; did you mean {suggestion}?" if suggestion else ""
    forms = "" if suggestion else " (like udpin://0.0.0.0:14540 or serial:///dev/ttyACM0:57600)"
    reason = f": {why}" if why else ""
    return LinkAddressError(f"link {text!r} cannot be read{reason}{meant}{forms}")


def _suggestion(text: str) -> str:
    """Return the link string that a foreign spelling probably means; "" when unknown."""
    if match := _FOREIGN_NET.fullmatch(text.strip()):
        name = match["kind"]
        kind = _FOREIGN_KIND.get(name, name)
        return _if_readable(f"{kind}://{match['host'] or '0.0.0.0'}:{match['port']}")  # noqa: S104 - what the foreign spelling means
    if match := _FOREIGN_SERIAL.fullmatch(text.strip()):
        device = match["device"]
        device = f"/dev/{device}" if device.startswith("tty") else device
        return _if_readable(f"serial://{device}:{match['baud'] or _USUAL_BAUD}")
    kind, mark, rest = text.strip().partition("://")
    near = difflib.get_close_matches(kind.lower(), plugin_additions(links), n=1)
    return _if_readable(f"{near[0]}://{rest}") if mark and near and near[0] != kind else ""


def _if_readable(text: str) -> str:
    """Return a suggested link string if it is well-formed; else ""."""
    name, _, rest = text.partition("://")
    kind = plugin_additions(links).get(name)
    if kind is None:
        return ""
    if kind.at == "device":
        return text if _DEVICE_BAUD.fullmatch(rest) else ""
    match = _HOST_PORT.fullmatch(rest)
    return text if not kind.at or (match and 1 <= int(match["port"]) <= 65535) else ""
