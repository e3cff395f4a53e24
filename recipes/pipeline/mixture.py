"""What a mixture is, and what is told of it."""

from dataclasses import dataclass
from typing import Generic

from typing_extensions import TypeVar

from recipes.working import DropReason
from vehicles.readings import CameraReading, Reading

R = TypeVar("R", bound=Reading, default=CameraReading)


@dataclass(frozen=True, slots=True)
class StageTime:
    """The duration of one step of a mixture, by the clock that was handed to the mixer."""

    step: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class Provenance:
    """The provenance of a mixture: the readings, times and alignment it is made of.

    real_*, twin_*: number and middle of exposure (run clock) of the inputs, where a step chose
    among several of the one chosen; None when there was none. skew_ms: by how much the exposures
    differ, without sign; None when one is missing. latency_ms: from the real exposure to now; None
    without a real reading. alignment: how the pose of the twin's reading was found, as the caller
    says. dropped: why nothing of the twin is in the mixture, or why there is no mixture; None when
    all is in. detail: the same in a sentence. stages: empty without a clock, so that virtual runs
    repeat to the byte. registration_error_px: RMS distance between where what is virtual was drawn
    and where an independent reference puts it, as the caller measured; None without one.
    registration_bound_px: without a reference, what that error is within by all that is known of
    the pose. mixed_s:
    when it was mixed, run clock. given_*: numbers of the readings that the mixer was handed.
    """

    real_seq: int | None
    real_t_s: float | None
    twin_seq: int | None
    twin_t_s: float | None
    skew_ms: float | None
    latency_ms: float | None
    alignment: str = ""
    dropped: DropReason | None = None
    detail: str = ""
    stages: tuple[StageTime, ...] = ()
    registration_error_px: float | None = None
    registration_bound_px: float | None = None
    mixed_s: float | None = None
    given_real_seq: int | None = None
    given_twin_seq: int | None = None


@dataclass(frozen=True, slots=True)
class Mixed(Generic[R]):
    """A mixture, or None where there is nothing to show, with its provenance."""

    reading: R | None
    provenance: Provenance


@dataclass(frozen=True, slots=True)
class MixCounts:
    """The counts of a mixture's frames: all, fully mixed, dropped by reason.

    frames: calls. mixed: with everything in. dropped: each reason and how often; such a frame
    shows the real reading alone, or nothing where that is what was missing. faults: what was
    wrong with readings that were refused, as "twin not_finite", and how often.
    """

    frames: int
    mixed: int
    dropped: tuple[tuple[DropReason, int], ...]
    faults: tuple[tuple[str, int], ...] = ()
