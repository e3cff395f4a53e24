"""What every camera source is: one protocol, its counts, its errors."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Protocol, Self, runtime_checkable

from vehicles.errors import VehicleError
from vehicles.readings import CameraReading
from worlds.camera import Intrinsics

SourceKind = Literal["live", "file"]


class SourceError(VehicleError):
    """A source that cannot be had, or cannot be trusted any more: what, where, what to do."""


class SourceStalledError(SourceError):
    """A source that was open and from which nothing comes any more."""


class ImageChangedError(SourceError):
    """Pictures of another size than the one that the intrinsics hold for."""


@dataclass(frozen=True, slots=True)
class SourceCounts:
    """What became of a camera's exposures.

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
    """A camera that is not rendered by us: this is the one interface of all of them.

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
        """Return what people know it by, without passwords ("rtsp://camera.local/main")."""

    @property
    def kind(self) -> SourceKind:
        """Return whether a camera takes the pictures now, or took them some time."""

    @property
    def intrinsics(self) -> Intrinsics:
        """Return the camera model that its pictures fit."""

    @property
    def counts(self) -> SourceCounts:
        """Return what became of the exposures so far."""

    async def __aenter__(self) -> Self:
        """Open. Raises SourceError."""

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close; gives back the device, the port and the thread."""

    def __aiter__(self) -> AsyncIterator[CameraReading]:
        """Return itself."""

    async def __anext__(self) -> CameraReading:
        """Wait for the next picture."""
