"""The links that the guard's process opens."""

import time
from collections.abc import Callable, Mapping
from functools import partial

from wil_campaign.safety.guard.core.events import EventKind
from wil_campaign.safety.guard.local_guard import GuardLinks
from wil_campaign.safety.guard.process.guard_config import GuardedVehicleConfig
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.link_conditions import LinkSite, link_under_conditions
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link
from wil_campaign.vehicles.links.udp import UdpLink


def guard_vehicle_link(guarded: GuardedVehicleConfig) -> Link:
    """Return the guard process's link to a vehicle; a free loopback UDP port for one to start."""
    signed = guarded.conditions.signing is not None
    if guarded.link:
        return open_link(parse_link(guarded.link), patient=guarded.patient, signed=signed)
    return UdpLink(address=LinkAddress(kind="udpin", host="127.0.0.1", port=0))


def _spare_links(guarded: GuardedVehicleConfig) -> list[Link]:
    signed = guarded.conditions.signing is not None
    return [open_link(parse_link(spare), signed=signed) for spare in guarded.spares]


def guard_links(
    guarded: GuardedVehicleConfig, near: Link, inner: Link, *, report: Callable[[str], None]
) -> GuardLinks:
    """Return the guard process's links of a vehicle: under its conditions, and to a ground station.

    near: the one to the vehicle. inner: the one to the orchestrator. report: gets link changes.
    """
    outer = link_under_conditions(
        [near, *_spare_links(guarded)],
        guarded.conditions,
        utc_s=time.time(),
        site=LinkSite(guarded.vehicle.target.system, report),
    )
    gcs = open_link(parse_link(guarded.gcs)) if guarded.gcs else None
    return GuardLinks(vehicle=outer.link, orchestrator=inner, gcs=gcs, impaired=outer.impaired)


def open_ports(
    links: Mapping[str, Link], *, report: Callable[[EventKind, str, str], None]
) -> tuple[int, ...]:
    """Return the UDP ports of the guard process's vehicle links, 0 for one without.

    report: gets "rival", the name of a vehicle, and which other sender uses its system id there;
    or "link", the name, and which address its frames come from now.
    """
    udp = {name: link for name, link in links.items() if isinstance(link, UdpLink)}
    for name, link in udp.items():
        link.on_rival(partial(report, "rival", name))
        link.on_change(partial(report, "link", name))
    return tuple(udp[name].local_port if name in udp else 0 for name in links)
