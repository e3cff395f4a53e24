"""Results of the external I/O of a run, as its result lists them."""

from dataclasses import dataclass
from typing import Self

from wil_campaign.campaigns.values.external_setups import ShownAs
from wil_campaign.vehicles.sources.feed_statistics import FeedStatistics


@dataclass(frozen=True, slots=True)
class SourceResult:
    """The result of an external camera source: exposures by outcome.

    dropped: replaced by newer ones. missed: never arrived. damaged: arrived damaged or wrong.
    stalls: how often none arrived for too long. trouble: the last error. measured: images of a
    simulator that were compared with the judged world; not_measured: why none or not all were.
    restarts: how often the sender's clock or its numbers began anew.
    """

    vehicle: str
    sensor: str
    source: ShownAs
    delivered: int
    dropped: int
    missed: int
    damaged: int
    stalls: int
    trouble: str
    measured: int = 0
    not_measured: str = ""
    restarts: int = 0


@dataclass(frozen=True, slots=True)
class CaptureResult:
    """The result of a vehicle's motion capture. garbage: unreadable messages on its port."""

    vehicle: str
    address: str
    feed: FeedStatistics
    garbage: int
    trouble: str


@dataclass(frozen=True, slots=True)
class OutletResult:
    """The result of an external image outlet: images by outcome. trouble: the last failure."""

    name: str
    offered: int
    delivered: int
    dropped: int
    failed: int
    trouble: str


@dataclass(frozen=True, slots=True)
class InjectedResult:
    """The result of injecting one kind of message into one autopilot.

    sent: messages sent. replaced: by newer ones before they were due. stale: too old to be sent.
    """

    vehicle: str
    thing: str
    sent: int
    replaced: int
    stale: int


@dataclass(frozen=True, slots=True)
class TopicResult:
    """The result of one topic of an autonomy that is reached by topics.

    direction: "out", to the autonomy, or "in". messages: published, or received. delivered: those
    of "out" that a subscriber was there for and that the wire took; those of "in" that were used:
    of setpoints the newest one at each step of the autonomy's rate. trouble: why any were refused.
    """

    topic: str
    type: str
    direction: str
    messages: int
    delivered: int
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class ProgramResult:
    """The result of an external autonomy program. exit: how it ended, in words.

    refused: its frames, or messages, that were not passed on to the vehicle for a fault of theirs;
    one that a newer one replaced before its turn is not refused. trouble: its last error. video:
    the images that it was sent; None without a camera. topics: what it was sent and what it sent,
    of an autonomy that is reached by topics.
    """

    vehicle: str
    exit: str
    refused: int
    trouble: str = ""
    video: OutletResult | None = None
    topics: tuple[TopicResult, ...] = ()


@dataclass(frozen=True, slots=True)
class ExternalResult:
    """The result of all external I/O of a run."""

    sources: tuple[SourceResult, ...] = ()
    captures: tuple[CaptureResult, ...] = ()
    outlets: tuple[OutletResult, ...] = ()
    injected: tuple[InjectedResult, ...] = ()
    programs: tuple[ProgramResult, ...] = ()

    def __add__(self, other: Self) -> Self:
        """Return the results of both, each kind in this order."""
        return type(self)(
            self.sources + other.sources,
            self.captures + other.captures,
            self.outlets + other.outlets,
            self.injected + other.injected,
            self.programs + other.programs,
        )

    @property
    def anything(self) -> bool:
        """Return whether the run had any external I/O."""
        parts = (self.sources, self.captures, self.outlets, self.injected, self.programs)
        return any(parts)
