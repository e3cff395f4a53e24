"""What geometry says that a sensor shows: the virtual world drawn or cast from a reference pose.

Our own renderer and ray caster draw it, whoever made the twin's readings, and from the reference
pose, whatever pose these were made from.
"""

from collections.abc import Mapping

import numpy as np

from recipes.visibility.model import ExpectedImage, ExpectedRanges, Ids, Mask, Virtual
from recipes.visibility.sampling import sampled_intrinsics, samples_of
from vehicles.readings import DepthImage
from vehicles.sensors.beams import Directions
from vehicles.sensors.lens import ThroughLens
from vehicles.sensors.world_views import WorldImages, WorldRays
from worlds.camera import Intrinsics
from worlds.frames import Pose
from worlds.scene.scene import Scene

_HIDDEN_M = 0.05


class ExpectedViews:
    """Computes the expected views of real and virtual scene. real: W, virtual: Wv.

    Ids are those of the world file, in both.
    """

    def __init__(self, *, real: Scene, virtual: Scene, events: Mapping[str, float]) -> None:
        physical = tuple(thing for thing in real.objects if thing.name not in virtual)
        everything = Scene((*virtual.objects, *physical))
        self._pictures = ThroughLens(WorldImages(scene=virtual, events=events))
        self._has_physical = bool(physical)
        self._hiding = self._pictures
        if physical:
            self._hiding = ThroughLens(WorldImages(scene=everything, events=events))
        self._rays = WorldRays(scene=everything, events=events)

    def picture(
        self,
        camera: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        virtual: Virtual,
        real_depth_m: DepthImage | None,
    ) -> ExpectedImage:
        """Return an image's expected samples. camera: its pose (FRD axes, world frame).

        real_depth_m: how far the real camera saw, at these pixels; None when unknown.
        """
        small = sampled_intrinsics(intrinsics)
        drawn = self._pictures.picture(
            camera, small, t_s, want_ids=True, want_depth=real_depth_m is not None
        )
        ids = _require_ids(drawn.object_ids)
        unknown: Mask | None = None
        if self._has_physical:
            hidden = self._hiding.picture(camera, small, t_s, want_ids=True)
            unknown = virtual.mask_of(ids) & (_require_ids(hidden.object_ids) != ids)
        if real_depth_m is not None and drawn.depth_m is not None:
            nearer = real_depth_m < drawn.depth_m - _HIDDEN_M
            unknown = nearer if unknown is None else unknown | nearer
        step = samples_of(intrinsics).step
        return ExpectedImage(ids, drawn.image_bgr, unknown, step)

    def depths(self, camera: Pose, intrinsics: Intrinsics, t_s: float) -> ExpectedRanges:
        """Return the expected depths along the optical axis at the samples, flat."""
        small = sampled_intrinsics(intrinsics)
        drawn = self._hiding.picture(camera, small, t_s, want_ids=True, want_depth=True)
        depth_m = np.asarray(drawn.depth_m, np.float64)
        return ExpectedRanges(depth_m.reshape(-1), _require_ids(drawn.object_ids).reshape(-1))

    def ranges(self, sensor: Pose, directions: Directions, t_s: float) -> ExpectedRanges:
        """Return the expected ranges of beams. sensor: its pose (FRD axes, world frame)."""
        hits = self._rays(sensor, directions, t_s)
        return ExpectedRanges(hits.ranges_m.astype(np.float64), hits.object_ids)


def _require_ids(ids: Ids | None) -> Ids:
    """Return the rendered object ids of an expected view. Raises TypeError for None."""
    if ids is None:
        raise TypeError("our renderer returns ids where they are requested")
    return ids
