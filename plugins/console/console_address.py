"""The address of a console, and the Host and Origin that requests must have; pure."""

import ipaddress
import re
from collections.abc import Mapping
from dataclasses import dataclass

from wil_campaign.hooks import LiveViewError
from wil_campaign.plugins.console.console_access import AccessError

_ADDRESS = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+)?(?::(?P<port>[0-9]{1,5}))?")
_LOOPBACK = ("127.0.0.1", "localhost")
_MAX_PORT = 65535


class ConsoleError(LiveViewError):
    """A console cannot be opened; the message says why, and what to do."""


class ConsoleOptionError(ConsoleError):
    """The address of a console, or the text of `--console`, is wrong."""

    code = 2


@dataclass(frozen=True, slots=True)
class ConsoleAddress:
    """The address of a console. port 0: any free one. is_loopback: only this machine reaches it."""

    host: str
    port: int

    @classmethod
    def parse(cls, text: str, *, port: int = 0) -> "ConsoleAddress":
        """Return the address in HOST, HOST:PORT or :PORT; port: the default.

        Raises OptionError.
        """
        found = _ADDRESS.fullmatch(text)
        port = int((found and found["port"]) or port)
        if found is None or port > _MAX_PORT:
            raise ConsoleOptionError(
                f"{text!r} is not a console address: give HOST, :PORT or HOST:PORT"
            )
        return cls((found["host"] or _LOOPBACK[0]).strip("[]"), port)

    @property
    def is_loopback(self) -> bool:
        """Return whether only this machine reaches the address."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def shown(self) -> str:
        """Return host and port as in a URL."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class RequestRules:
    """The rules for requests to a console: the Host and Origin that they must have.

    They block pages of other sites (cross-site requests and WebSockets, and DNS rebinding).
    scheme: http or https.
    """

    scheme: str
    hosts: frozenset[str]

    @classmethod
    def of(cls, address: ConsoleAddress, *, tls: bool) -> "RequestRules":
        """Return the rules of a console at an address."""
        hosts = {address.shown}
        if address.is_loopback:
            hosts |= {f"{name}:{address.port}" for name in _LOOPBACK}
        return cls("https" if tls else "http", frozenset(hosts))

    def check(self, headers: Mapping[str, str], *, needs_origin: bool) -> None:
        """Raise AccessError for a request from another site, or to another host name."""
        host, origin = headers.get("Host", ""), headers.get("Origin")
        if host.lower() not in self.hosts:
            raise AccessError(f"Host {host[:80]!r} is not this console")
        if origin is None and needs_origin:
            raise AccessError("a request without Origin is refused")
        if origin is not None and origin.lower() != f"{self.scheme}://{host.lower()}":
            raise AccessError(f"Origin {origin[:80]!r} is not this console")


def require_safe_console_address(address: ConsoleAddress, *, tls: bool) -> None:
    """Raise OptionError for an address that other machines reach, unless TLS protects it."""
    if not address.is_loopback and not tls:
        raise ConsoleOptionError(
            f"{address.host} can be reached by other machines: the console needs a certificate "
            "(--tls-cert and --tls-key; of `run`: --console ADDRESS,CERTIFICATE,KEY); or give it a "
            "loopback address"
        )
    if address.host in {"0.0.0.0", "::"}:  # noqa: S104 - refused here
        raise ConsoleOptionError(
            f"{address.host} is not an address that a browser can open: give the one address or "
            "host name of the console"
        )
