"""Parts of a run's result: external I/O, steps before arming, the twin, the firmware that flew."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Self

from wil_campaign.campaigns.values.external_setups import ShownAs
from wil_campaign.vehicles.coupling import Coupling
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


StepName = Literal["parameters", "fence", "actor", "external", "anchor", "preflight"]


@dataclass(frozen=True, slots=True)
class ArmingStep:
    """One step before arming in a run's result.

    vehicle: empty for a step of all. at_s: when it ended, run clock. ok: False for the step that
    failed and prevented arming. text: what was set or checked, or the error. restored: whether an
    attached vehicle got its own configuration back; None where nothing is restored.
    """

    step: StepName
    vehicle: str
    at_s: float
    ok: bool
    text: str
    restored: bool | None = None


@dataclass(frozen=True, slots=True)
class DropOut:
    """The drop-out of a vehicle that is not judged. at_s: run clock. reason: in words."""

    at_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class TwinResult:
    """The coupling of the twin to the real vehicle, and their distance.

    distance_m: the median, the 99th percentile and the largest distance between the two by their
    pose sources while the goal was flown and the twin flew; None where nothing was measured: a
    placed twin has no place of its own. limit_m: beyond it the run is INVALID. dropped_out: what
    ended the twin's flight before that of the real vehicle; None for nothing.
    """

    coupling: Coupling
    distance_p50_m: float | None
    distance_p99_m: float | None
    distance_max_m: float | None
    limit_m: float
    dropped_out: DropOut | None = None


_SHORT = 10
"""Digits of a git hash in a text."""


@dataclass(frozen=True, slots=True)
class FlownFirmware:
    """The firmware of one vehicle, as it identified itself before arming.

    version: with the kind of release, as "4.7.0-dev". board: its vendor, product and board ids;
    "simulation" of one; "emulated" of an embedded vehicle, which says what it emulates. uid: of the
    board; not unique of a simulation. frame: its MAV_TYPE, with
    the parameters that tell its frame. parameters: a digest of all parameters with which it flew,
    without those that change by themselves; empty where it was not received. All as it says.
    """

    vehicle: str
    autopilot: str
    version: str
    git_hash: str
    board: str
    uid: str
    frame: str
    parameters: str

    @property
    def release(self) -> str:
        """Return autopilot, version and git hash in words."""
        is_known = bool(self.git_hash.strip("0"))
        commit = f" ({self.git_hash[:_SHORT]})" if is_known else ""
        return f"{self.autopilot} {self.version}{commit}"

    @property
    def kind(self) -> tuple[str, ...]:
        """Return what two vehicles with the same firmware on the same kind of board share."""
        return (self.autopilot, self.version, self.git_hash, self.board, self.frame)

    @property
    def unit(self) -> str:
        """Return the board's own uid; empty of a simulation, whose uid is of its machine."""
        return "" if self.board in {"simulation", "emulated"} else self.uid

    def __str__(self) -> str:
        parts = [self.release, self.board, self.frame, f"uid {self.uid}" if self.uid else ""]
        parts.append(f"parameters {self.parameters}" if self.parameters else "")
        return ", ".join(part for part in parts if part)


def firmware_changes(before: FlownFirmware, now: FlownFirmware) -> tuple[str, str]:
    """Return in words how the firmware of a vehicle differs, and how its unit does; empty for not.

    The unit: the board's own uid, and the parameters, where both are known.
    """
    kind = ""
    if before.kind != now.kind:
        kind = (
            f"the firmware of {now.vehicle} was {before.release}, {before.board}, {before.frame}; "
            f"now it is {now.release}, {now.board}, {now.frame}"
        )
    unit = []
    if before.unit and now.unit and before.unit != now.unit:
        unit.append(f"the uid of its board was {before.unit}, now it is {now.unit}")
    if before.parameters and now.parameters and before.parameters != now.parameters:
        unit.append(
            f"the digest of its parameters was {before.parameters}, now it is {now.parameters}"
        )
    return kind, f"{now.vehicle}: {'; '.join(unit)}" if unit else ""


def distinct_firmware(firmware: Iterable[FlownFirmware]) -> tuple[FlownFirmware, ...]:
    """Return each firmware once, by vehicle, in the order in which they flew."""
    found = dict.fromkeys(firmware)
    return tuple(sorted(found, key=lambda one: one.vehicle))
