"""Recorded cameras: plays a recording's images at the times at which they were taken."""

import asyncio
from dataclasses import dataclass
from typing import Protocol, Self

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.plugins.cameras.frame_stamps import FrameStamper, check_frame_size, source_counts
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Source
from wil_campaign.vehicles.sources.camera_source import SourceCounts, SourceError
from wil_campaign.vehicles.sources.file_player import FilePlayer, PlayedFile
from wil_campaign.worlds.camera import Intrinsics


@dataclass(frozen=True, slots=True)
class RecordedImage:
    """An image of a recorded camera. offset_s: since its first one."""

    offset_s: float
    image_bgr: BgrImage


class ImageFile(PlayedFile, Protocol):
    """Reads a recorded camera's images (protocol)."""

    def next(self) -> RecordedImage | None:
        """Return the next recorded image; None at the end. Raises SourceError."""


class RecordedCamera(FilePlayer[ImageFile]):
    """A recorded camera, played from its opening on; a CameraSource for any clock.

    latency_s: from an image's exposure to its delivery. An image whose successor is due as well
    is dropped, as a live camera's would be; in virtual time none is.
    """

    def __init__(
        self,
        *,
        file: ImageFile,
        intrinsics: Intrinsics,
        side: Source = "real",
        latency_s: float = 0.0,
    ) -> None:
        self.name = file.name
        self.intrinsics = intrinsics
        super().__init__(file)
        self._latency_s = latency_s
        self._stamper = FrameStamper(name=file.name, side=side, intrinsics=intrinsics)
        self._next_image: RecordedImage | None = None
        self._start_s = 0.0
        self._delivered = 0
        self._dropped = 0

    @property
    def counts(self) -> SourceCounts:
        """Return the counts of the recorded camera's images so far."""
        return source_counts(self._stamper, delivered=self._delivered, dropped=self._dropped)

    async def __aenter__(self) -> Self:
        """Open the recorded camera's file, read the first image. Raises SourceError."""
        try:
            await self._in_thread(self._file.open)
            first = await self._in_thread(self._file.next)
            self._check_first(first)
        except BaseException:
            await self._close()
            raise
        self._next_image = first
        self._start_s = asyncio.get_running_loop().time()
        return self

    async def __anext__(self) -> CameraReading:
        """Wait for the next recorded image. Raises SourceError, or StopAsyncIteration."""
        loop = asyncio.get_running_loop()
        while True:
            image = self._next_image
            if image is None:
                raise StopAsyncIteration
            self._next_image = await self._in_thread(self._file.next)
            await sleep_until(self._due_s(image))
            if self._next_image is not None and self._due_s(self._next_image) < loop.time():
                self._dropped += 1
                self._stamper.skip_exposure()
                continue
            reading = self._reading_of(image)
            if reading is not None:
                self._delivered += 1
                return reading

    def _reading_of(self, image: RecordedImage) -> CameraReading | None:
        t_s = self._start_s + image.offset_s
        now_s = max(asyncio.get_running_loop().time(), t_s)
        reading = self._stamper.reading_at(image.image_bgr, t_s=t_s, arrived_s=now_s)
        if reading is None:
            self._dropped += 1
        return reading

    def _due_s(self, image: RecordedImage) -> float:
        return self._start_s + image.offset_s + self._latency_s

    def _check_first(self, first: RecordedImage | None) -> None:
        if first is None:
            raise SourceError(f"{self.name}: the recording has no image")
        check_frame_size(self.name, first.image_bgr, self.intrinsics)
