"""From a link's address to the link."""

from vehicles.links.base import Link, LinkError
from vehicles.links.parse import LinkAddress
from vehicles.links.udp import UdpLink


def open_link(address: LinkAddress) -> Link:
    """Return the link of an address, not yet entered.

    Raises LinkError for a kind that this version does not speak.
    """
    if address.kind in {"udpin", "udpout"}:
        return UdpLink(address=address)
    if address.kind == "memory":
        raise LinkError(
            "memory:// links have two ends in one process; memory_pair() makes both at once"
        )
    raise LinkError(
        f"{address}: {address.kind} links are not spoken by this version; use udpin:// or "
        "udpout://, with a router such as mavlink-routerd between them and the vehicle"
    )
