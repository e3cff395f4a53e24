"""`links`: impairments of the link between the guard and a vehicle: latency, loss, outages."""

from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from wil_campaign.campaigns.schema import CampaignPart
from wil_campaign.campaigns.schema.faults import Duration, FlightStage
from wil_campaign.foundation.files.documents import Document, KeyFaultError, Part, Problem
from wil_campaign.plugins.impaired_links.impairment import BurstLoss, Impairment, LinkOutage
from wil_campaign.plugins.impaired_links.link_setups import (
    ImpairedLinks,
    LinkSetup,
    StageOutage,
)
from wil_campaign.vehicles.faults import LATEST_S

Chance = Annotated[float, Field(ge=0, le=1)]
Milliseconds = Annotated[float, Field(ge=0, le=60_000)]


class BurstsPart(Part):
    """Burst loss of a link: mean length of bursts, and mean time between them.

    length_s: mean length of a burst. gap_s: mean time between two bursts. loss_within: the
    probability that a frame is lost within a burst, from 0 to 1. loss_between: the probability that
    a frame is lost between bursts, from 0 to 1.
    """

    length_s: Duration
    gap_s: Duration
    loss_within: Chance = 1.0
    loss_between: Chance = 0.0


class OutagePart(Part):
    """A link outage of `for_s`, so long after the link's opening or after a stage.

    `{from_s: 60, for_s: 3}`, or `{on: goal, after_s: 2, for_s: 3}`.

    for_s: how long nothing arrives. from_s: when it begins, counted from the link's opening. on:
    the stage of the flight after which it begins, in place of from_s. after_s: how long after the
    stage `on` it begins.
    """

    for_s: Duration
    from_s: Annotated[float, Field(ge=0, le=LATEST_S)] | None = None
    on: FlightStage | None = None
    after_s: Annotated[float, Field(ge=0, le=LATEST_S)] = 0.0

    @model_validator(mode="after")
    def _one_beginning(self) -> Self:
        """Require exactly one beginning of a link outage: from_s or on."""
        if (self.from_s is None) == (self.on is None):
            raise ValueError("give from_s, or the stage `on` after which it begins")
        if self.from_s is not None and "after_s" in self.model_fields_set:
            raise KeyFaultError("after_s", "counts from a stage; from_s is given already")
        return self


class WayPart(Part):
    """The impairments of one direction of a link; every probability is per frame.

    latency_ms: mean time that a frame takes. jitter_ms: by how much a frame may be earlier or later
    than latency_ms; frames keep their order. loss: the probability that a frame is lost, from 0 to
    1. bursts: loss in bursts, in addition to `loss`. duplicate: the probability that a frame
    arrives twice. reorder: the probability that later frames overtake one. corrupt: the probability
    that one bit of a frame is flipped. bandwidth_kbit_s: capacity of the link; frames queue for it,
    up to one second; by default unlimited.
    """

    latency_ms: Milliseconds = 0.0
    jitter_ms: Milliseconds = 0.0
    loss: Chance = 0.0
    bursts: BurstsPart | None = None
    duplicate: Chance = 0.0
    reorder: Chance = 0.0
    corrupt: Chance = 0.0
    bandwidth_kbit_s: Annotated[float, Field(gt=0, le=1e6)] | None = None

    @model_validator(mode="after")
    def _causal(self) -> Self:
        """Refuse a link's jitter above its latency: no frame arrives before it was sent."""
        if self.jitter_ms > self.latency_ms:
            message = f"is more than the latency of {self.latency_ms:g} ms; a frame cannot be early"
            raise KeyFaultError("jitter_ms", message)
        return self

    def impairment(self, outages: tuple[LinkOutage, ...]) -> Impairment:
        """Return the impairment of one direction of a link."""
        bursts, kbit_s = self.bursts, self.bandwidth_kbit_s
        return Impairment(
            latency_s=self.latency_ms / 1e3,
            jitter_s=self.jitter_ms / 1e3,
            loss=self.loss,
            bursts=None if bursts is None else BurstLoss(**bursts.model_dump()),
            duplicate=self.duplicate,
            reorder=self.reorder,
            corrupt=self.corrupt,
            bandwidth_bit_s=None if kbit_s is None else kbit_s * 1e3,
            outages=outages,
        )


class LinkPart(WayPart):
    """One vehicle's link, both directions; `to_vehicle` or `from_vehicle` replaces one.

    to_vehicle, from_vehicle: the impairments of that direction alone. blackouts: times in which
    nothing arrives.
    """

    to_vehicle: WayPart | None = None
    from_vehicle: WayPart | None = None
    blackouts: list[OutagePart] = Field(default_factory=list)

    @model_validator(mode="after")
    def _applies_to_a_way(self) -> Self:
        """Refuse impairments of both directions of a link where each has its own."""
        if self.to_vehicle is not None and self.from_vehicle is not None:
            for key in WayPart.model_fields.keys() & self.model_fields_set:
                raise KeyFaultError(key, "to_vehicle and from_vehicle replace this; remove it")
        return self

    def setup(self) -> LinkSetup:
        """Return the impairments of a vehicle's link."""
        fixed = tuple(
            LinkOutage(outage.from_s, outage.for_s)
            for outage in self.blackouts
            if outage.from_s is not None
        )
        outgoing, incoming = self.to_vehicle or self, self.from_vehicle or self
        return LinkSetup(
            outgoing=outgoing.impairment(fixed),
            incoming=incoming.impairment(fixed),
            outages=tuple(
                StageOutage(stage=outage.on, after_s=outage.after_s, for_s=outage.for_s)
                for outage in self.blackouts
                if outage.on is not None
            ),
        )


class LinksPart(Part):
    """The campaign's `links`: impairments of the pair's links; a link not named has none."""

    real: LinkPart | None = None
    twin: LinkPart | None = None


def links_field() -> tuple[Any, Any]:
    """Return the type and the field of the key `links`."""
    return LinksPart, LinksPart()


def links_setup(
    given: LinksPart, _campaign: Document, _part: CampaignPart, _problems: list[Problem]
) -> ImpairedLinks | None:
    """Return the impaired links of a case; None without any."""
    parts = {"real": given.real, "twin": given.twin}
    setups = {name: part.setup() for name, part in parts.items() if part is not None}
    return ImpairedLinks(setups) if setups else None
