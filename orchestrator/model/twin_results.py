"""The result of the twin of a run in mode wil, beside the judged flight."""

from dataclasses import dataclass

from wil_campaign.vehicles.coupling import Coupling


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
