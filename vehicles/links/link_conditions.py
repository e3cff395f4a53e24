"""Wraps the link to a vehicle: signing, simulated impairment and redundant links."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from wil_campaign.vehicles.links.impaired import ImpairedLink
from wil_campaign.vehicles.links.impairment import Impairment
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.redundant import RedundantLink
from wil_campaign.vehicles.links.signed_link import SignedLink
from wil_campaign.vehicles.mavlink.signing_key import (
    SigningKey,
    key_from_environment,
    key_from_file,
)

_FLAWLESS = Impairment()


@dataclass(frozen=True, slots=True)
class KeySource:
    """Where a link's signing key is: a file, or an environment variable; never the key."""

    kind: Literal["file", "environment"]
    name: str

    def key(self) -> SigningKey:
        """Return the link's signing key. Raises SigningKeyError."""
        if self.kind == "file":
            return key_from_file(Path(self.name))
        return key_from_environment(self.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkConditions:
    """The conditions of a link to a vehicle: signing, impairment.

    outgoing, incoming: the impairment of each direction. seed: of its random numbers. signing:
    where the key is; None for unsigned frames.
    """

    outgoing: Impairment = field(default_factory=Impairment)
    incoming: Impairment = field(default_factory=Impairment)
    seed: tuple[int, ...] = (0,)
    signing: KeySource | None = None
    has_later_outage: bool = False
    """Whether an outage begins at a stage of the flight, a moment that is not known yet."""

    @property
    def impaired(self) -> bool:
        """Return whether the link's conditions include impairment."""
        return self.has_later_outage or (self.outgoing, self.incoming) != (_FLAWLESS, _FLAWLESS)


@dataclass(frozen=True, slots=True)
class ConditionedLink:
    """A link under conditions. impaired: the link whose outages can be started; None without."""

    link: Link
    impaired: ImpairedLink | None = None


def under_conditions(
    link: Link,
    conditions: LinkConditions,
    *,
    utc_s: float,
    spares: Sequence[Link] = (),
    system_id: int | None = None,
    on_switch: Callable[[str], None] | None = None,
) -> ConditionedLink:
    """Return a link under conditions: signed first, then impaired, as on the air.

    utc_s: the present time (UTC, seconds since 1970). spares: standby links to the same vehicle,
    unimpaired; system_id: of that vehicle, None where it is not known; on_switch: called with a
    message when another link becomes active. Raises SigningKeyError.
    """
    impaired: ImpairedLink | None = None
    if conditions.impaired:
        link = impaired = ImpairedLink(
            link=link,
            outgoing=conditions.outgoing,
            incoming=conditions.incoming,
            rng=np.random.default_rng(list(conditions.seed)),
        )
    links = [link, *spares]
    if conditions.signing is not None:
        key = conditions.signing.key()
        links = [
            SignedLink(link=one, key=key, utc_s=utc_s, link_id=number)
            for number, one in enumerate(links)
        ]
    if not spares:
        return ConditionedLink(links[0], impaired)
    together = RedundantLink(links=links, system_id=system_id, on_switch=on_switch)
    return ConditionedLink(together, impaired)
