"""Views of a world for sensors: images and ray hits, with moving objects where they are."""

from collections.abc import Mapping

import numpy as np

from wil_campaign.vehicles.cameras.rendered_cameras import RenderedImage
from wil_campaign.vehicles.sensors.beams import Directions, RayHits
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.rays.raycast import SceneRayCaster
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene.scene import Scene


class WorldImages:
    """Views of one scene as images, moving objects where they are at the time."""

    def __init__(self, *, scene: Scene, events: Mapping[str, float]) -> None:
        self._renderer = Renderer(scene)
        self._events = events

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        """Return the view from a camera's pose (FRD axes, world frame) at a time."""
        return self._renderer.render(
            camera_pose, intrinsics, t_s, self._events, want_depth=want_depth, want_ids=want_ids
        )


class WorldRays:
    """Views of one scene by beams; its tree is built by `prepare`, or else at the first cast."""

    def __init__(self, *, scene: Scene, events: Mapping[str, float]) -> None:
        self._scene = scene
        self._events = events
        self._caster: SceneRayCaster | None = None

    def prepare(self) -> None:
        """Build the tree of the scene now, before the flight: it may take seconds."""
        self._load_caster()

    def __call__(self, sensor: Pose, directions_frd: Directions, t_s: float) -> RayHits:
        """Return what beams hit in the world at t_s. sensor: its pose (FRD, world frame)."""
        caster = self._load_caster()
        directions_ned = directions_frd @ matrix_from_quat(sensor.q_wxyz).T
        hits = caster.cast(sensor.position_ned_m, directions_ned, t_s, self._events)
        return RayHits(hits.ranges_m.astype(np.float32), hits.object_ids)

    def _load_caster(self) -> SceneRayCaster:
        if self._caster is None:
            self._caster = SceneRayCaster(self._scene)
        return self._caster
