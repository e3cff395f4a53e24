"""What came in from outside and what went out, as results carry it."""

from dataclasses import dataclass

from campaigns.values.external_setups import ShownAs
from vehicles.sources.mocap.feed_statistics import FeedStatistics


@dataclass(frozen=True, slots=True)
class SourceResult:
    """Exposures of a camera with pictures from outside, by what became of them.

    dropped: came, and made way for newer ones. missed: never came. damaged: came broken, or wrong.
    stalls: how often nothing came for too long. trouble: the last complaint.
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


@dataclass(frozen=True, slots=True)
class CaptureResult:
    """Motion capture of a vehicle. garbage: messages on its port that could not be read."""

    vehicle: str
    address: str
    feed: FeedStatistics
    garbage: int
    trouble: str


@dataclass(frozen=True, slots=True)
class OutletResult:
    """Pictures offered to a way out, by what became of them. trouble: why the last failed."""

    name: str
    offered: int
    delivered: int
    dropped: int
    failed: int
    trouble: str


@dataclass(frozen=True, slots=True)
class InjectedResult:
    """Messages of one kind to one autopilot.

    sent; replaced by newer ones before they were due; not sent, for they had become too old.
    """

    vehicle: str
    thing: str
    sent: int
    replaced: int
    stale: int


@dataclass(frozen=True, slots=True)
class ProgramResult:
    """The autonomy of a vehicle that is a program. exit: how it ended, in words.

    refused: frames of it that were not passed on to the vehicle. trouble: what it did wrong.
    """

    vehicle: str
    exit: str
    refused: int
    trouble: str = ""


@dataclass(frozen=True, slots=True)
class ExternalResult:
    """All that a run had outside of this process."""

    sources: tuple[SourceResult, ...] = ()
    captures: tuple[CaptureResult, ...] = ()
    outlets: tuple[OutletResult, ...] = ()
    injected: tuple[InjectedResult, ...] = ()
    programs: tuple[ProgramResult, ...] = ()

    @property
    def anything(self) -> bool:
        """Return whether there was anything outside."""
        parts = (self.sources, self.captures, self.outlets, self.injected, self.programs)
        return any(parts)
