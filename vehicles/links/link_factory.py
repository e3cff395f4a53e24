"""Creates the link of an address."""

from wil_campaign.vehicles.links.link import Link, LinkError
from wil_campaign.vehicles.links.link_strings import LinkAddress
from wil_campaign.vehicles.links.reconnection import BackOff
from wil_campaign.vehicles.links.serial import SerialLink
from wil_campaign.vehicles.links.tcp import TcpInLink, TcpOutLink
from wil_campaign.vehicles.links.udp import UdpLink

_SOON = BackOff(first_s=0.1, longest_s=0.5)
"""For a simulator that is being started: ArduPilot's SITL boots only once a client connects."""


def open_link(address: LinkAddress, *, patient: bool = False, signed: bool = False) -> Link:
    """Return the link of an address, not yet entered.

    patient: the peer may not listen yet. signed: senders are told apart by their signatures, not
    by their addresses.
    Raises LinkError for memory://, whose two ends are created together.
    """
    match address.kind:
        case "udpin" | "udpout":
            return UdpLink(address=address, signed=signed)
        case "tcpout":
            if patient:
                return TcpOutLink(address=address, back_off=_SOON, patient=True)
            return TcpOutLink(address=address)
        case "tcpin":
            return TcpInLink(address=address)
        case "serial":
            return SerialLink(address=address)
        case "memory":
            raise LinkError(
                "memory:// links have both ends in one process; memory_pair() creates both"
            )
