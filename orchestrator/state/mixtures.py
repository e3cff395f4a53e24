"""What mixing hands on: each mixture with its readings, and the images of it for people."""

from dataclasses import dataclass

from recipes.pipeline.mixture import Mixed
from recipes.visibility.model import FrameVisibility
from vehicles.readings import CameraReading, Reading


@dataclass(frozen=True, slots=True)
class MixedFrame:
    """A mixture with the readings behind it.

    name: of the combination. visibility: what it shows of the virtual objects; None where that
    was not measured. unbounded: why nobody knows how far beside their places virtual objects may be
    drawn; empty where that is known.
    """

    name: str
    sensor: str
    real: Reading | None
    twin: Reading | None
    mixed: Mixed[Reading]
    visibility: FrameVisibility | None = None
    unbounded: str = ""


@dataclass(frozen=True, slots=True)
class PreviewImages:
    """Preview images of a mixture for people: what the subject perceives, and the inputs.

    alone: why nothing of the twin is in the mixture; empty where it is.
    """

    perceived: CameraReading
    real: CameraReading | None = None
    twin: CameraReading | None = None
    alone: str = ""
