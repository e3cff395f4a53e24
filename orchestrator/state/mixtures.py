"""Mixtures with their input readings, and preview images of them for people."""

from dataclasses import dataclass

from wil_campaign.recipes.pipeline.mixture import MixedReading
from wil_campaign.recipes.visibility.model import FrameVisibility
from wil_campaign.vehicles.readings import CameraReading, Reading


@dataclass(frozen=True, slots=True)
class MixedFrame:
    """A mixture with the readings behind it.

    name: of the combination. visibility: of the virtual objects; None where it was not measured.
    unbounded: why the registration error has no bound; empty where it has one.
    """

    name: str
    sensor: str
    real: Reading | None
    twin: Reading | None
    mixed: MixedReading[Reading]
    visibility: FrameVisibility | None = None
    unbounded: str = ""


@dataclass(frozen=True, slots=True)
class PreviewImages:
    """Preview images of a mixture for people: what the subject perceives, and the inputs.

    topic: of the perceived image in run.mcap. alone: why the mixture contains nothing of the twin;
    empty where it does.
    """

    perceived: CameraReading
    topic: str
    real: CameraReading | None = None
    twin: CameraReading | None = None
    alone: str = ""
