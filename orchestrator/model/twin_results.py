"""What the twin of a run in mode wil did, beside the flight that is judged."""

from dataclasses import dataclass

from vehicles.coupling import Coupling


@dataclass(frozen=True, slots=True)
class DropOut:
    """A vehicle that is not judged left the flight. at_s: run clock. reason: in words."""

    at_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class TwinResult:
    """How the twin was kept with its vehicle, and how far it was from it.

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
