"""Small parts of the guard's process: the links it opens, how its children ended, its logs' end."""

import contextlib
from collections.abc import Callable, Mapping
from functools import partial

from safety.guard.process.guard_config import Guarded
from vehicles.links.link import Link
from vehicles.links.link_factory import open_link
from vehicles.links.link_strings import LinkAddress, parse_link
from vehicles.links.udp import UdpLink
from vehicles.mavlink.tlog import TlogWriter


def vehicle_link(guarded: Guarded) -> Link:
    """Return the guard process's link to a vehicle; a free loopback UDP port for one to start."""
    signed = guarded.conditions.signing is not None
    if guarded.link:
        return open_link(parse_link(guarded.link), patient=guarded.patient, signed=signed)
    return UdpLink(address=LinkAddress(kind="udpin", host="127.0.0.1", port=0))


def spare_links(guarded: Guarded) -> list[Link]:
    """Return the guard process's spare links to a vehicle."""
    signed = guarded.conditions.signing is not None
    return [open_link(parse_link(one), signed=signed) for one in guarded.spares]


def open_ports(links: Mapping[str, Link], *, told: Callable[[str, str], None]) -> tuple[int, ...]:
    """Return the UDP ports of the guard process's vehicle links, 0 for one without.

    told: gets the name of a vehicle, and in words who else speaks in its name there.
    """
    udp = {name: link for name, link in links.items() if isinstance(link, UdpLink)}
    for name, link in udp.items():
        link.on_rival(partial(told, name))
    return tuple(udp[name].local_port if name in udp else 0 for name in links)


def close_quietly(log: TlogWriter) -> None:
    """Close a link's tlog; a full disk was reported when it was written to."""
    with contextlib.suppress(OSError):
        log.__exit__(None, None, None)
