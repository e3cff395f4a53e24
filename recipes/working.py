"""What steps work on: a reading with the part of it that is kept, and what may stop a mixture."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from vehicles.perception.hsv import Mask
from vehicles.readings import CameraReading
from worlds.frames import Pose

Side = Literal["real", "twin"]
SIDES: tuple[Side, ...] = ("real", "twin")

Need = Literal["depth", "ids"]
Align = Literal["interpolate", "latest", "hold"]

DropReason = Literal["no_real", "no_twin", "stale", "mismatch", "bad_real", "bad_twin", "no_ids"]


@dataclass(frozen=True, slots=True)
class Masked:
    """A reading between two steps, and which of its elements are kept.

    mask: one value per element, never per channel: (height, width) uint8 for a picture, 255
    kept and 0 not; None keeps all. A mask may be the buffer of the step that made it: it
    holds until that step's next frame and never leaves the mixer.
    """

    reading: CameraReading
    mask: Mask | None = None


@dataclass(frozen=True, slots=True)
class PoseRequest:
    """What `register` asks of a side's source: a picture from this pose at the real exposure.

    pose: whose pose it is taken from. align: `interpolate` between the samples around the middle
    of the exposure; `latest` takes the newest sample there is; `hold` the last one at or before
    the exposure. max_gap_s: no picture when the samples used are farther apart, or the one used
    is farther from the exposure.
    """

    pose: Side
    align: Align
    max_gap_s: float


@dataclass(frozen=True, slots=True)
class AlignedPose:
    """The pose that a request found. t_s: the time it stands for, so the picture's exposure.

    how: "interpolated", "predicted", "latest" or "hold", for the record. gap_s: between the
    samples used, or from the one used to the exposure.
    """

    pose: Pose
    t_s: float
    how: str
    gap_s: float


class CannotMixError(Exception):
    """A frame that a step cannot work on; the overlay is left out, and counted under `reason`."""

    def __init__(self, reason: DropReason, message: str) -> None:
        super().__init__(message)
        self.reason: DropReason = reason


Sides = Mapping[Side, Masked]
"""The sides that are there, after transform and filter."""

Operator = Callable[[Masked, Masked | None], Masked]
"""Transform or filter: this side, and the other where there is one, to this side made anew."""

Merge = Callable[[Sides], CameraReading]
"""Combines the sides; the mixer sets times and source of what it returns."""

Built = Operator | Merge | PoseRequest
