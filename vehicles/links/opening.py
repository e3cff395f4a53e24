"""From a link's address to the link."""

from vehicles.links.base import Link, LinkError
from vehicles.links.parse import LinkAddress
from vehicles.links.serial import SerialLink
from vehicles.links.tcp import TcpInLink, TcpOutLink
from vehicles.links.udp import UdpLink


def open_link(address: LinkAddress) -> Link:
    """Return the link of an address, not yet entered.

    Raises LinkError for memory://, whose two ends are made at once.
    """
    match address.kind:
        case "udpin" | "udpout":
            return UdpLink(address=address)
        case "tcpout":
            return TcpOutLink(address=address)
        case "tcpin":
            return TcpInLink(address=address)
        case "serial":
            return SerialLink(address=address)
        case "memory":
            raise LinkError(
                "memory:// links have two ends in one process; memory_pair() makes both at once"
            )
