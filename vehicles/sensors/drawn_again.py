"""Draws images of a world again, from what they were drawn of: equal to the first bit by bit."""

from dataclasses import replace
from functools import lru_cache

from wil_campaign.vehicles.cameras.camera_effects import NO_STREAK, CameraEffects
from wil_campaign.vehicles.cameras.rendered_cameras import RenderedImage
from wil_campaign.vehicles.readings import Drawing, DrawnEffects
from wil_campaign.vehicles.sensors.lens import LensImage, ThroughLens
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.scene import Scene

_CAMERAS = 8
"""So many cameras have their noise ready, some 3 MB each: every run has noise of its own."""


class ImageRedrawer:
    """Draws images of one scene again, through the same lens and with the same effects."""

    def __init__(self, scene: Scene) -> None:
        self._renderer = Renderer(scene)

    def image(
        self, drawing: Drawing, intrinsics: Intrinsics, *, want_depth: bool, want_ids: bool
    ) -> RenderedImage:
        """Return an image as it was drawn. Raises ValueError for a drawing of another scene."""
        source = ThroughLens(_At(self._renderer, drawing.moving))
        image = source.picture(
            drawing.camera_pose, intrinsics, 0.0, want_depth=want_depth, want_ids=want_ids
        )
        done = drawing.effects
        if done is None:
            return image
        camera = replace(done, streak_px=NO_STREAK, noise_roll_px=(0, 0))
        colors = _effects_of(camera, intrinsics).apply(
            image.image_bgr, streak_px=done.streak_px, noise_roll_px=done.noise_roll_px
        )
        return LensImage(colors, image.depth_m, image.object_ids)


@lru_cache(maxsize=_CAMERAS)
def _effects_of(camera: DrawnEffects, intrinsics: Intrinsics) -> CameraEffects:
    """Return the effects of a camera. camera: of any of its images, but equal for all of them."""
    return CameraEffects.again(camera, intrinsics)


class _At:
    """An ImageSource of a scene whose moving bodies stand where they stood in one image."""

    def __init__(self, renderer: Renderer, moving: tuple[Pose, ...]) -> None:
        self._renderer = renderer
        self._moving = moving

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        """Return the view from a camera's pose (FRD axes, world frame)."""
        return self._renderer.render(
            camera_pose,
            intrinsics,
            t_s,
            want_depth=want_depth,
            want_ids=want_ids,
            moving=self._moving,
        )
