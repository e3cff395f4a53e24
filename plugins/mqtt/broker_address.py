"""Address of an MQTT broker: mqtt://[user@]host[:port], mqtts:// with TLS, `embedded[:port]`."""

from dataclasses import dataclass
from urllib.parse import urlsplit

from wil_campaign.foundation.files.problems import without_passwords

_PORTS = {"mqtt": 1883, "mqtts": 8883}
_LIKE = "(like mqtt://127.0.0.1:1883, mqtts://broker.example:8883, or embedded)"


class BrokerAddressError(ValueError):
    """An MQTT broker address that cannot be parsed; says why."""


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """An MQTT broker's address; embedded: started for the campaign, on loopback."""

    host: str
    port: int
    tls: bool = False
    user: str = ""
    embedded: bool = False

    def __str__(self) -> str:
        name = "embedded" if self.embedded else self.host
        host = f"[{name}]" if ":" in name else name
        scheme = "" if self.embedded else "mqtts://" if self.tls else "mqtt://"
        return f"{scheme}{host}:{self.port}"


def parse_broker_address(text: str) -> BrokerAddress:
    """Return the MQTT broker address in a text. Raises BrokerAddressError."""
    name, _, port = text.partition(":")
    if name == "embedded":
        return BrokerAddress("127.0.0.1", _port(text, port or "1883"), embedded=True)
    try:
        parts = urlsplit(text)
        host, number = parts.hostname, parts.port
    except ValueError as error:
        raise BrokerAddressError(
            f"broker '{without_passwords(text)}' cannot be read: {error} {_LIKE}"
        ) from error
    if parts.scheme not in _PORTS or not host or parts.path not in {"", "/"} or parts.query:
        raise BrokerAddressError(f"broker '{without_passwords(text)}' cannot be read {_LIKE}")
    if parts.password is not None:
        raise BrokerAddressError(
            "a password in an address would appear in logs; name the variable that holds it by "
            "password_env"
        )
    tls = parts.scheme == "mqtts"
    return BrokerAddress(host, number or _PORTS[parts.scheme], tls, parts.username or "")


def _port(text: str, port: str) -> int:
    """Return the port of a broker address. Raises BrokerAddressError outside 1 to 65535."""
    if not port.isdecimal() or not 0 < int(port) < 65536:
        raise BrokerAddressError(f"broker '{text}': port {port} is not within 1..65535")
    return int(port)
