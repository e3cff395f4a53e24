"""Images that another program renders on request, as a plugin gives them to a run."""

from collections.abc import Callable, Mapping
from typing import Protocol, Self

from wil_campaign.campaigns.values.external_setups import SourceSetup
from wil_campaign.hooks import image_sources
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.run_results.result_parts import SourceResult
from wil_campaign.vehicles.cameras.rendered_cameras import ImageSource
from wil_campaign.vehicles.readings import Source
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene


class RequestedImages(ImageSource, Protocol):
    """A camera's images by another program, which are checked in flight (protocol).

    An async context manager. Opening it raises SourceError. Requests are thread-safe.
    """

    async def __aenter__(self) -> Self:
        """Connect to the program. Raises SourceError."""

    async def __aexit__(self, *_: object) -> None:
        """Disconnect from the program."""

    async def warm_up(self, camera_pose: Pose, intrinsics: Intrinsics, t_s: float) -> None:
        """Request a first image, which is not counted. Raises SourceError."""

    def begin(self, is_judged: Callable[[], bool]) -> None:
        """Begin to check images while `is_judged` returns True."""

    def look_back(self) -> str:
        """Return in words what was wrong with the images of the whole flight; "" for nothing."""

    @property
    def fault(self) -> str:
        """Return the first fault that lasted long enough, in words; "" without one."""

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Return in words where the program shows another world than the judged one."""

    @property
    def result(self) -> SourceResult:
        """Return the counts of the images."""


def requested_images(
    source: SourceSetup,
    *,
    vehicle: Source,
    sensor: str,
    scene: Scene,
    world: str,
    case: str,
    events: Mapping[str, float],
) -> RequestedImages:
    """Return the images of a camera whose source renders on request.

    scene: what is to be shown. world, case: their names. events: of the world, by time.
    """
    images: RequestedImages = load_plugin_object(plugin_additions(image_sources)[source.kind].open)(
        source, vehicle=vehicle, sensor=sensor, scene=scene, world=world, case=case, events=events
    )
    return images
