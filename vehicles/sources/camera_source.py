"""The protocol of live and recorded sources of readings, cameras among them; counts and errors."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Literal, Protocol, Self, TypeVar, runtime_checkable

from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.readings import CameraReading, Reading
from wil_campaign.worlds.camera import Intrinsics

SourceKind = Literal["live", "file"]
R_co = TypeVar("R_co", bound=Reading, covariant=True)
IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"})
"""Of the files in a folder of recorded images."""


class SourceError(VehicleError):
    """A source is unavailable or its data cannot be used; says which, why and what to do."""


class SourceStalledError(SourceError):
    """A source was open and has stopped delivering readings."""


class ImageChangedError(SourceError):
    """A camera source's images have another size than its intrinsics."""


@dataclass(frozen=True, slots=True)
class SourceCounts:
    """The counts of a source's readings (of a camera: exposures) by outcome.

    delivered: handed on. dropped: arrived, and replaced by a newer one before they were read.
    missed: never arrived, by the gaps in the stamps (only counted when the rate is known).
    damaged: arrived with lost or broken data, or without their time, and not handed on.
    restarts: how often the sender's clock or its numbers began anew.
    """

    delivered: int = 0
    dropped: int = 0
    missed: int = 0
    damaged: int = 0
    restarts: int = 0


class ReadingSource(Protocol[R_co]):
    """A source of readings from outside this program, live or recorded (protocol).

    An async context manager and an async iterator of readings in order of sampling: `async with
    source: async for reading in source: ...`. `t_s` is the sampling and `arrived_s` the arrival,
    both on the run clock; `seq` counts samples, so that missed, damaged and dropped ones leave a
    gap. Opening raises SourceError when the source is unavailable. Iterating raises
    SourceStalledError when no reading arrives for too long, SourceError when a live source ends;
    the end of a file ends the loop.
    """

    @property
    def name(self) -> str:
        """Return the source's name without passwords ("rtsp://camera.local/main")."""

    @property
    def kind(self) -> SourceKind:
        """Return whether the source is live or recorded."""

    @property
    def counts(self) -> SourceCounts:
        """Return the counts of the source's readings so far."""

    async def __aenter__(self) -> Self:
        """Open the source. Raises SourceError."""

    async def __aexit__(self, *_: object) -> None:
        """Close the source: device, port and thread."""

    def __aiter__(self) -> AsyncIterator[R_co]:
        """Return the source itself."""

    async def __anext__(self) -> R_co:
        """Wait for the source's next reading."""


@runtime_checkable
class CameraSource(ReadingSource[CameraReading], Protocol):
    """A live or recorded camera (protocol): its readings have rendered=False.

    Iterating raises ImageChangedError, too, when the size changes.
    """

    @property
    def intrinsics(self) -> Intrinsics:
        """Return the camera model that the source's images fit."""
