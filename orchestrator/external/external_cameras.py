"""Cameras whose pictures come from outside: recordings, and live ones."""

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path

from campaigns.values.external_setups import SourceSetup
from campaigns.values.sensor_setups import CameraSetup
from orchestrator.model.external_results import SourceResult
from vehicles.readings import Reading, Source
from vehicles.sources.camera_source import (
    CameraSource,
    SourceCounts,
    SourceError,
    SourceStalledError,
)
from vehicles.sources.cameras.camera_factory import live_camera
from vehicles.sources.cameras.image_files import ImageFolder, VideoFile
from vehicles.sources.cameras.mcap_images import McapFile
from vehicles.sources.cameras.recorded_camera import ImageFile, RecordedCamera

Deliver = Callable[[Reading], None]


class ExternalCamera:
    """A vehicle's camera with external images; a Stream of readings.

    Opened with the run, so that what cannot be had is known before anything flies. `run` hands on
    what was taken since it began: a live camera goes on from before, a recording starts then.
    """

    def __init__(self, *, camera: CameraSetup, source: SourceSetup, side: Source) -> None:
        self._camera = camera
        self._setup = source
        self._side: Source = side
        self._source: CameraSource | None = None
        self._stalled: Callable[[str], None] = lambda _: None
        self._stalls = 0
        self._trouble = ""
        self._before = SourceCounts()
        self._has_begun = False

    async def open(self, stack: AsyncExitStack) -> None:
        """Open an external camera, live or recorded. Raises SourceError."""
        source = self._make_source()
        if source.kind == "live":
            self._source = await stack.enter_async_context(source)
        else:
            async with source:
                pass

    def on_stall(self, stalled: Callable[[str], None]) -> None:
        """Call `stalled` with the reason whenever the camera delivers nothing for too long."""
        self._stalled = stalled

    async def run(self, deliver: Deliver) -> None:
        """Deliver the external camera's images until cancelled. Raises SourceError at their end."""
        try:
            if self._source is not None:
                await self._run(self._source, deliver)
                return
            async with self._make_source() as source:
                self._source = source
                await self._run(source, deliver)
        except SourceError as error:
            self._trouble = str(error)
            raise

    @property
    def result(self) -> SourceResult:
        """Return the counts of the external camera's exposures since `run` began."""
        counts = self._counts()
        return SourceResult(
            vehicle=str(self._side),
            sensor=self._camera.name,
            source=self._setup.shown_as,
            delivered=counts.delivered,
            dropped=counts.dropped,
            missed=counts.missed,
            damaged=counts.damaged,
            stalls=self._stalls,
            trouble=self._trouble,
        )

    async def _run(self, source: CameraSource, deliver: Deliver) -> None:
        since_s = asyncio.get_running_loop().time()
        while True:
            try:
                async for reading in source:
                    if reading.arrived_s < since_s:
                        continue
                    self._begin_counting(source.counts)
                    deliver(reading)
            except SourceStalledError as error:
                self._stalls += 1
                self._trouble = str(error)
                self._stalled(f"{self._side} {self._camera.name}: {error}")
            else:
                raise SourceError(f"{source.name}: the recording is over")

    def _begin_counting(self, counts: SourceCounts) -> None:
        """Leave out what came before the first image that is handed on: nobody wanted those."""
        if not self._has_begun:
            self._has_begun = True
            self._before = replace(counts, delivered=counts.delivered - 1)

    def _counts(self) -> SourceCounts:
        if self._source is None or not self._has_begun:
            return SourceCounts()
        counts, before = self._source.counts, self._before
        return SourceCounts(
            delivered=counts.delivered - before.delivered,
            dropped=counts.dropped - before.dropped,
            missed=counts.missed - before.missed,
            damaged=counts.damaged - before.damaged,
        )

    def _make_source(self) -> CameraSource:
        setup, intrinsics = self._setup, self._camera.intrinsics
        if setup.shown_as == "file":
            return RecordedCamera(
                file=_file(setup, self._camera.rate_hz),
                intrinsics=intrinsics,
                side=self._side,
                latency_s=setup.latency_s,
            )
        return live_camera(
            setup.address,
            intrinsics=intrinsics,
            side=self._side,
            latency_s=setup.latency_s,
            rate_hz=self._camera.rate_hz,
            open_timeout_s=setup.open_s,
            stall_timeout_s=setup.stall_s,
            rtsp_transport=setup.transport,
            v4l2_format=setup.device_format,
        )


def _file(setup: SourceSetup, rate_hz: float) -> ImageFile:
    """Return the reader of an external camera's recorded images."""
    path = Path(setup.address)
    if setup.kind == "images":
        return ImageFolder(path=path, rate_hz=rate_hz)
    if setup.kind == "mcap":
        return McapFile(path=path, topic=setup.topic)
    return VideoFile(path=path)
