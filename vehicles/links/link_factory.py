"""Creates the link of an address."""

from dataclasses import dataclass

from wil_campaign.hooks import links
from wil_campaign.installed_plugins import absent_additions, load_plugin_object, plugin_additions
from wil_campaign.vehicles.links.link import Link, LinkError
from wil_campaign.vehicles.links.link_strings import LinkAddress


@dataclass(frozen=True, slots=True)
class LinkRequest:
    """A link that is asked for.

    patient: the peer may not listen yet. signed: senders are told apart by their signatures, not
    by their addresses.
    """

    address: LinkAddress
    patient: bool = False
    signed: bool = False


def open_link(address: LinkAddress, *, patient: bool = False, signed: bool = False) -> Link:
    """Return the link of an address, not yet entered. patient, signed: as of LinkRequest.

    Raises LinkError for memory://, whose two ends are created together, and for a kind whose plugin
    is not installed.
    """
    if why := absent_additions(links).get(address.kind):
        raise LinkError(why)
    request = LinkRequest(address, patient=patient, signed=signed)
    link: Link = load_plugin_object(plugin_additions(links)[address.kind].open)(request)
    return link
