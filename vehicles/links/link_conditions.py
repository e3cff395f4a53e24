"""What the links to a vehicle are led through: a simulated radio, signing, redundancy."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Protocol, runtime_checkable

import msgspec

from wil_campaign.hooks import link_layers
from wil_campaign.installed_plugins import absent_additions, loaded_additions
from wil_campaign.vehicles.links.link import Link, LinkError

SPARE_LINKS = "spare_links"
"""The layer that joins several links to one vehicle."""
SIGNING = "signing"
"""The layer that signs frames: of a KeySource, and of the time (UTC, seconds since 1970)."""


@dataclass(frozen=True, slots=True)
class KeySource:
    """Where a link's signing key is: a file, or an environment variable; never the key."""

    kind: Literal["file", "environment"]
    name: str


@dataclass(frozen=True, slots=True)
class LinkSite:
    """The vehicle that links lead to.

    system_id: of MAVLink; None where it is not known. on_switch: called with a message when another
    link becomes active.
    """

    system_id: int | None = None
    on_switch: Callable[[str], None] | None = None


class LinkLayer(ABC):
    """What the links to a vehicle are led through; a frozen data class, sent to the guard."""

    name: str
    """Of its `LinkLayerKind`; a field with that default."""

    @abstractmethod
    def over(self, links: Sequence[Link], site: LinkSite) -> list[Link]:
        """Return links over these ones, the preferred one first."""


@runtime_checkable
class Interruptible(Protocol):
    """A link whose outages can be started."""

    def start_outage(self, duration_s: float) -> None:
        """Start an outage of the link, both ways, for a while."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConditions:
    """The conditions of a link to a vehicle. air: what it goes through on the air.

    signing: where the key is; None for unsigned frames.
    """

    air: tuple[LinkLayer, ...] = ()
    signing: KeySource | None = None


@dataclass(frozen=True, slots=True)
class ConditionedLink:
    """A link under conditions. impaired: the link whose outages can be started; None without."""

    link: Link
    impaired: Interruptible | None = None


def link_under_conditions(
    links: Sequence[Link], conditions: LinkConditions, *, utc_s: float, site: LinkSite | None = None
) -> ConditionedLink:
    """Return the links to a vehicle as one under conditions: signed first, then on the air.

    links: the preferred one first; of several the others are standby. utc_s: the present time (UTC,
    seconds since 1970). Raises SigningKeyError, and LinkError for what lacks its plugin.
    """
    site = site or LinkSite()
    for layer in conditions.air:
        links = layer.over(links, site)
    impaired = next((link for link in links if isinstance(link, Interruptible)), None)
    if conditions.signing is not None:
        signing: Any = _layer_named(SIGNING)
        links = signing(conditions.signing, utc_s).over(links, site)
    if len(links) > 1:
        links = _layer_named(SPARE_LINKS)().over(links, site)
    return ConditionedLink(links[0], impaired)


def layer_of_plain(plain: Any) -> LinkLayer:
    """Return the layer of plain fields. Raises LinkError, ValueError, KeyError."""
    return msgspec.convert(plain, _layer_named(plain["name"]))


def _layer_named(name: str) -> type[LinkLayer]:
    """Return the class of a layer. Raises LinkError where its plugin is not installed."""
    if why := absent_additions(link_layers).get(name):
        raise LinkError(why)
    return _layers()[name]


@cache
def _layers() -> Mapping[str, type[LinkLayer]]:
    return loaded_additions(link_layers, "layer")
