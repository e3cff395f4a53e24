"""What steps work on: a reading with the part of it that is kept, and what may stop a mixture."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

from vehicles.perception.hsv import Mask
from vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    Reading,
)
from worlds.frames import Pose

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
bad_*: the reading itself is at fault. no_history: nothing of the time asked for is known."""

R = TypeVar("R", bound=Reading)


@dataclass(frozen=True, slots=True)
class Masked(Generic[R]):
    """A reading in work between two recipe steps, and the mask of its kept elements.

    mask: one value per element, never per channel: (height, width) uint8 for a picture, (beams,)
    for a scan, (points,) for points, (1,) for a reading of one value; 255 kept and 0 not; None
    keeps all. A mask may be the buffer of the step that made it: it holds until that step's next
    frame and never leaves the mixer.
    """

    reading: R
    mask: Mask | None = None


AnyMasked = Masked[Any]
"""A side whatever its sensor; which one it is, the recipe's check has settled."""


def element_shape(reading: Reading) -> tuple[int, ...]:
    """Return the shape of a mask for a reading: how its elements are laid out."""
    if isinstance(reading, CameraReading):
        return reading.image_bgr.shape[:2]
    if isinstance(reading, DepthReading):
        return reading.depth_m.shape
    if isinstance(reading, LidarScanReading):
        return reading.ranges_m.shape
    if isinstance(reading, LidarPointsReading):
        return reading.points_frd_m.shape[:1]
    if isinstance(reading, MicrophoneReading):
        return reading.samples.shape
    return (1,)


@dataclass(frozen=True, slots=True)
class PoseRequest:
    """The request of `register` for a reading from this pose at the real exposure.

    pose: whose pose it is taken from. align: `interpolate` between the samples around the middle
    of the exposure; `latest` takes the newest sample there is; `hold` the last one at or before
    the exposure. max_gap_s: no reading when the samples used are farther apart, or the one used
    is farther from the exposure.
    """

    pose: Side
    align: Align
    max_gap_s: float


@dataclass(frozen=True, slots=True)
class AlignedPose:
    """The pose found for a PoseRequest. t_s: its time, so the image's exposure.

    how: "interpolated", "predicted", "latest" or "hold", for the record. gap_s: between the
    samples used, or from the one used to the exposure.
    """

    pose: Pose
    t_s: float
    how: str
    gap_s: float


class CannotMixError(Exception):
    """A step cannot work on this frame; the overlay is left out, counted under `reason`."""

    def __init__(self, reason: DropReason, message: str) -> None:
        super().__init__(message)
        self.reason: DropReason = reason


class StepError(Exception):
    """A recipe step failed by a fault of its own: the run's verdict is ERROR.

    file, line: of the step in the recipe. step: its name, or the user's file and function.
    frame: how many readings were mixed before. detail: what was raised, and where.
    """

    def __init__(self, *, file: str, line: int, step: str, frame: int, detail: str) -> None:
        super().__init__(f"{file}:{line}: step {step}, frame {frame}: {detail}")
        self.file = file
        self.line = line
        self.step = step
        self.frame = frame
        self.detail = detail


Sides = Mapping[Side, AnyMasked]
"""The sides that are there, after transform and filter."""

Operator = Callable[[AnyMasked, AnyMasked | None], AnyMasked]
"""Transform or filter: this side, and the other where there is one, to this side made anew."""

Merge = Callable[[Sides], Reading]
"""Combines the sides; the mixer sets times and source of what it returns."""


class TimedOperator(ABC):
    """A step's operator that selects readings by time, so it is offered all of them."""

    @abstractmethod
    def offer(self, reading: Reading) -> Reading | None:
        """Take a reading of this side; a repeated one changes nothing.

        Returns what stands for it in the step after this one; None when there is nothing yet.
        """

    @abstractmethod
    def __call__(self, work: AnyMasked, other: AnyMasked | None) -> AnyMasked:
        """Return this side's working reading for the time of the other."""


Built = Operator | Merge | PoseRequest
