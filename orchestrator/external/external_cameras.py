"""Cameras with external images, recorded or live."""

from pathlib import Path

from wil_campaign.campaigns.values.external_setups import SourceSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.orchestrator.external.external_sources import ExternalSource
from wil_campaign.vehicles.readings import Source
from wil_campaign.vehicles.sources.camera_source import CameraSource
from wil_campaign.vehicles.sources.cameras.camera_factory import live_camera
from wil_campaign.vehicles.sources.cameras.image_files import ImageFolder, VideoFile
from wil_campaign.vehicles.sources.cameras.mcap_images import McapFile
from wil_campaign.vehicles.sources.cameras.recorded_camera import ImageFile, RecordedCamera


class ExternalCamera(ExternalSource):
    """A vehicle's camera with external images; a Stream of readings."""

    def __init__(self, *, camera: CameraSetup, source: SourceSetup, side: Source) -> None:
        super().__init__(
            sensor=camera.name, shown_as=source.shown_as, side=side, make=self._make_source
        )
        self._camera = camera
        self._setup = source

    def _make_source(self) -> CameraSource:
        setup, intrinsics = self._setup, self._camera.intrinsics
        if setup.shown_as == "file":
            return RecordedCamera(
                file=_image_file(setup, self._camera.rate_hz),
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


def _image_file(setup: SourceSetup, rate_hz: float) -> ImageFile:
    path = Path(setup.address)
    if setup.kind == "images":
        return ImageFolder(path=path, rate_hz=rate_hz)
    if setup.kind == "mcap":
        return McapFile(path=path, topic=setup.topic)
    return VideoFile(path=path)
