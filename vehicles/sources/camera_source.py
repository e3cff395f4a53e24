"""What every camera source is: one protocol, its counts, its errors."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Literal, Protocol, Self, runtime_checkable

from vehicles.errors import VehicleError
from vehicles.readings import CameraReading
from worlds.camera import Intrinsics

SourceKind = Literal["live", "file"]


class SourceError(VehicleError):
    """A camera source that is unavailable or untrustworthy: what, where, what to do."""


class SourceStalledError(SourceError):
    """A camera source that was open and delivers nothing any more."""


class ImageChangedError(SourceError):
    """Images of another size than the camera source's intrinsics hold for."""


@dataclass(frozen=True, slots=True)
class SourceCounts:
    """The counts of a camera source's exposures by outcome.

    delivered: handed on. dropped: came, and made way for a newer one because nobody took them.
    missed: never came, by the gaps in the stamps (only told when the rate is known). damaged:
    came with lost or broken data, and were not handed on.
    """

    delivered: int = 0
    dropped: int = 0
    missed: int = 0
    damaged: int = 0


@runtime_checkable
class CameraSource(Protocol):
    """A camera source that is not rendered by us: the one interface of all of them.

    An async context manager and an async iterator of CameraReadings with rendered=False, in
    order of exposure: `async with source: async for reading in source: ...`. `t_s` is the
    exposure and `arrived_s` the arrival, both on the run clock; `seq` counts exposures, so what
    was missed, damaged or dropped leaves a gap. Opening raises SourceError when the source
    cannot be had. Iterating raises SourceStalledError when nothing comes for too long,
    PictureChangedError when the size changes, SourceError when a live source ends; a file that
    is over ends the loop.
    """

    @property
    def name(self) -> str:
        """Return the camera source's name without passwords ("rtsp://camera.local/main")."""

    @property
    def kind(self) -> SourceKind:
        """Return whether the camera source is live or recorded."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Return the camera model that the source's images fit."""

    @property
    def counts(self) -> SourceCounts:
        """Return the counts of the camera source's exposures so far."""

    async def __aenter__(self) -> Self:
        """Open the camera source. Raises SourceError."""

    async def __aexit__(self, *_: object) -> None:
        """Close the camera source: device, port and thread."""

    def __aiter__(self) -> AsyncIterator[CameraReading]:
        """Return the camera source itself."""

    async def __anext__(self) -> CameraReading:
        """Wait for the camera source's next image."""
