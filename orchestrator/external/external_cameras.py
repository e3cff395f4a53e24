"""Cameras with external images, recorded or live."""

from wil_campaign.campaigns.values.external_setups import SourceSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.hooks import image_sources
from wil_campaign.installed_plugins import added, load
from wil_campaign.orchestrator.external.external_sources import ExternalSource
from wil_campaign.vehicles.readings import Source
from wil_campaign.vehicles.sources.camera_source import CameraSource


class ExternalCamera(ExternalSource):
    """A vehicle's camera with external images; a Stream of readings."""

    def __init__(self, *, camera: CameraSetup, source: SourceSetup, side: Source) -> None:
        super().__init__(
            sensor=camera.name, shown_as=source.shown_as, side=side, make=self._make_source
        )
        self._camera = camera
        self._setup = source

    def _make_source(self) -> CameraSource:
        made: CameraSource = load(added(image_sources)[self._setup.kind].open)(
            self._setup,
            intrinsics=self._camera.intrinsics,
            side=self._side,
            rate_hz=self._camera.rate_hz,
        )
        return made
