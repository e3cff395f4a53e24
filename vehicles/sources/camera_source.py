"""What every source of readings is, cameras among them: one protocol, its counts, its errors."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Literal, Protocol, Self, TypeVar, runtime_checkable

from vehicles.errors import VehicleError
from vehicles.readings import CameraReading, Reading
from worlds.camera import Intrinsics

SourceKind = Literal["live", "file"]
R_co = TypeVar("R_co", bound=Reading, covariant=True)


class SourceError(VehicleError):
    """A source that is unavailable or untrustworthy: what, where, what to do."""


class SourceStalledError(SourceError):
    """A source that was open and delivers nothing any more."""


class ImageChangedError(SourceError):
    """Images of another size than the camera source's intrinsics hold for."""


@dataclass(frozen=True, slots=True)
class SourceCounts:
    """The counts of a source's readings (of a camera: exposures) by outcome.

    delivered: handed on. dropped: came, and made way for a newer one because nobody took them.
    missed: never came, by the gaps in the stamps (only told when the rate is known). damaged:
    came with lost or broken data, and were not handed on.
    """

    delivered: int = 0
    dropped: int = 0
    missed: int = 0
    damaged: int = 0


class ReadingSource(Protocol[R_co]):
    """A source of readings that are not made by us: the one interface of all of them.

    An async context manager and an async iterator of readings in order of sampling: `async with
    source: async for reading in source: ...`. `t_s` is the sampling and `arrived_s` the arrival,
    both on the run clock; `seq` counts samples, so what was missed, damaged or dropped leaves a
    gap. Opening raises SourceError when the source cannot be had. Iterating raises
    SourceStalledError when nothing comes for too long, SourceError when a live source ends; a file
    that is over ends the loop.
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
    """A camera source that is not rendered by us: its readings have rendered=False.

    Iterating raises ImageChangedError, too, when the size changes.
    """

    @property
    def intrinsics(self) -> Intrinsics:
        """Return the camera model that the source's images fit."""
