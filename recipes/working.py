"""Types that recipe steps work on: masked readings, pose requests, and the errors of mixing."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, Protocol, TypeVar, get_args

from wil_campaign.vehicles.readings import Mask, Reading
from wil_campaign.vehicles.readings.kinds import traits_of
from wil_campaign.worlds.frames import Pose

Side = Literal["real", "twin"]
SIDES: tuple[Side, ...] = ("real", "twin")

Need = Literal["depth", "ids"]
Align = Literal["interpolate", "latest", "hold"]

DropReason = Literal[
    "no_real",
    "no_twin",
    "stale",
    "late",
    "mismatch",
    "bad_real",
    "bad_twin",
    "no_ids",
    "no_depth",
    "no_history",
]
"""stale: the two exposures are too far apart. late: older than `max_latency_ms` at delivery.
bad_*: the reading itself is faulty. no_history: no reading of the requested time is known."""

R = TypeVar("R", bound=Reading)


@dataclass(frozen=True, slots=True)
class Masked(Generic[R]):
    """A reading between two recipe steps, and the mask of its kept elements.

    mask: one value per element, never per channel: (height, width) uint8 for an image, (beams,)
    for a scan, (points,) for points, (1,) for a reading of one value; 255 kept and 0 not; between,
    for an image, the share of the pixel that is (`matte`), by which `overlay` blends; None keeps
    all. A mask may be the buffer of the step that made it: it is valid until that step's next
    frame and never leaves the mixer.
    """

    reading: R
    mask: Mask | None = None


AnyMasked = Masked[Any]
"""A side of any sensor type; the check of the recipe ensures the type that each step needs."""


def element_shape(reading: Reading) -> tuple[int, ...]:
    """Return the shape of a mask for a reading."""
    traits = traits_of(type(reading))
    if not traits.elements:
        return (1,)
    shape: tuple[int, ...] = getattr(reading, traits.elements).shape
    return shape[: traits.axes]


def refuse_other_elements(name: str, upper: Reading, lower: Reading) -> None:
    """Raise CannotMixError when two readings of a class have other elements, as other beams."""
    if differs := traits_of(type(upper)).mismatch(upper, lower):
        raise CannotMixError("mismatch", f"{name}: {differs}")


class ReadingTimeline(Protocol):
    """The last seconds of readings that last, of one sensor, readable at any time (protocol)."""

    def add(self, reading: Any) -> None:
        """Add a reading; one not newer than the last changes nothing."""

    def during(self, real: Any, like: Any) -> Any:
        """Return a reading of exactly the time of a real one, with other facts of another.

        Raises CannotMixError where the line does not have all of that time.
        """


@dataclass(frozen=True, slots=True)
class PoseRequest:
    """The request of `register` for a reading from this pose at the real exposure.

    pose: the vehicle whose pose is used. align: `interpolate` between the samples around the middle
    of the exposure; `latest` uses the newest sample; `hold` the last one at or before the exposure.
    max_gap_s: no reading when the samples used are farther apart, or the one used is farther from
    the exposure.
    """

    pose: Side
    align: Align
    max_gap_s: float


@dataclass(frozen=True, slots=True)
class AlignedPose:
    """The pose for a PoseRequest. t_s: its time, so the image's exposure.

    how: "interpolated", "predicted", "latest" or "hold", for the record. gap_s: between the
    samples used, or from the one used to the exposure.
    """

    pose: Pose
    t_s: float
    how: str
    gap_s: float


class CannotMixError(Exception):
    """A step cannot work on this frame; the overlay is left out, counted under `reason`.

    Raises ValueError for any other reason: an empty one would count as mixed.
    """

    def __init__(self, reason: DropReason, message: str) -> None:
        if reason not in get_args(DropReason):
            known = ", ".join(get_args(DropReason))
            raise ValueError(f"CannotMixError has no reason {reason!r}: there are {known}")
        super().__init__(message)
        self.reason: DropReason = reason


class StepError(Exception):
    """A recipe step raised an unexpected error: the run's verdict is ERROR.

    file, line: of the step, in the recipe or where a campaign overrides it; line 0 in an option.
    step: its name, or the user's file and function.
    frame: number of readings mixed before. detail: the exception, and where it was raised.
    """

    def __init__(self, *, file: str, line: int, step: str, frame: int, detail: str) -> None:
        place = f"{file}:{line}" if line else file
        super().__init__(f"{place}: step {step}, frame {frame}: {detail}")
        self.file = file
        self.line = line
        self.step = step
        self.frame = frame
        self.detail = detail


Sides = Mapping[Side, AnyMasked]
"""The available sides, after transform and filter."""

Operator = Callable[[AnyMasked, AnyMasked | None], AnyMasked]
"""Transform or filter: takes this side, and the other or None; returns this side changed."""

Merge = Callable[[Sides], Reading]
"""Combines the sides; the mixer sets times and source of the result."""


class TimedOperator(ABC):
    """A step's operator that selects readings by time, so that it is offered all of them."""

    @abstractmethod
    def offer(self, reading: Reading) -> Reading | None:
        """Store a reading of this side; a repeated one changes nothing.

        Returns the reading that the next step receives instead; None when there is none yet.
        """

    @abstractmethod
    def __call__(self, work: AnyMasked, other: AnyMasked | None) -> AnyMasked:
        """Return this side's working reading for the time of the other."""


Built = Operator | Merge | PoseRequest
