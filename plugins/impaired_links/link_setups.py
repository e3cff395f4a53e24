"""Setups of links: impairments of their frames, and link outages."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from wil_campaign.campaigns.schema.faults import FlightStage
from wil_campaign.campaigns.setup.case_setup import ObserverSetup
from wil_campaign.plugins.impaired_links.impaired import Radio
from wil_campaign.plugins.impaired_links.impairment import Impairment

_FLAWLESS = Impairment()


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOutage:
    """A link outage that begins after_s after a stage was entered."""

    stage: FlightStage
    after_s: float
    for_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSetup:
    """The impairments of a vehicle's link. outgoing: to the vehicle; incoming: from it."""

    outgoing: Impairment = field(default_factory=Impairment)
    incoming: Impairment = field(default_factory=Impairment)
    outages: tuple[StageOutage, ...] = ()


@dataclass(frozen=True, slots=True)
class ImpairedLinks(ObserverSetup):
    """The impaired links of a case, by vehicle."""

    links: Mapping[str, LinkSetup]

    def link_layer(self, vehicle: str, seed: tuple[int, ...], /) -> Radio | None:
        """Return the radio of a vehicle's link; None for a flawless one without outages."""
        link = self.links.get(vehicle, LinkSetup())
        if not link.outages and link.outgoing == link.incoming == _FLAWLESS:
            return None
        return Radio(outgoing=link.outgoing, incoming=link.incoming, seed=seed)
