"""A mixture with its provenance, and the counts of mixtures."""

from dataclasses import dataclass
from typing import Generic

from typing_extensions import TypeVar

from wil_campaign.recipes.working import DropReason
from wil_campaign.vehicles.readings import CameraReading, Reading

R = TypeVar("R", bound=Reading, default=CameraReading)


@dataclass(frozen=True, slots=True)
class StageTime:
    """The duration of one step of a mixture, by the clock that was handed to the mixer."""

    step: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class Provenance:
    """The provenance of a mixture: the readings, times and alignment it is made of.

    real_*, twin_*: number and middle of exposure (run clock) of the inputs, of the selected one
    where a step selects among several; None without one. skew_ms: absolute difference of the
    exposures; None when one is missing. latency_ms: from the real exposure to `mixed_s`, until the
    caller adds what the mixing took; None without a real reading. alignment: how the pose of the
    twin's reading was determined, from the caller. dropped: why the twin's reading is not in the
    mixture, or why there is no mixture; None for a full one. detail: the same in a sentence.
    stages: empty without a clock, so that virtual runs repeat to the byte. registration_error_px:
    RMS distance between virtual objects as drawn and an independent reference, as the caller
    measured; None without one. registration_bound_px: without a reference, the bound of that error
    from the accuracy of the pose. mixed_s: when the mixing began, run clock. given_*: numbers of
    the readings that the mixer received.
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
class MixedReading(Generic[R]):
    """A mixture with its provenance. reading: None where nothing could be mixed."""

    reading: R | None
    provenance: Provenance


@dataclass(frozen=True, slots=True)
class MixCounts:
    """The counts of a mixture's frames: all, fully mixed, dropped by reason.

    frames: calls. mixed: full mixtures. dropped: number by reason; such a frame is the real reading
    alone, or none where that was missing. faults: number of refused readings by fault, such as
    "twin not_finite".
    """

    frames: int
    mixed: int
    dropped: tuple[tuple[DropReason, int], ...]
    faults: tuple[tuple[str, int], ...] = ()
