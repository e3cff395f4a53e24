"""Setups of links: impairments of their frames, and link outages."""

from dataclasses import dataclass, field

from wil_campaign.campaigns.schema.links import FlightStage, LinkPart, WayPart
from wil_campaign.vehicles.links.impairment import Impairment, LinkOutage


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


def link_setup(part: LinkPart) -> LinkSetup:
    """Return the setup of one vehicle's link from its YAML part."""
    fixed = tuple(
        LinkOutage(outage.from_s, outage.for_s)
        for outage in part.blackouts
        if outage.from_s is not None
    )

    def way(own: WayPart | None) -> Impairment:
        return (part if own is None else own).impairment(fixed)

    return LinkSetup(
        outgoing=way(part.to_vehicle),
        incoming=way(part.from_vehicle),
        outages=tuple(
            StageOutage(stage=outage.on, after_s=outage.after_s, for_s=outage.for_s)
            for outage in part.blackouts
            if outage.on is not None
        ),
    )
