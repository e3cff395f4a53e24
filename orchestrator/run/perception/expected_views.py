"""Expected views of a sensor: the virtual world rendered or ray-cast from a reference pose.

The renderer and ray caster of wil-campaign compute them whatever made the twin's readings, and from
the reference pose whatever pose these were made from.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wil_campaign.recipes.visibility.images import well_within
from wil_campaign.recipes.visibility.model import (
    ExpectedImage,
    ExpectedRanges,
    Ids,
    Mask,
    VirtualObjects,
)
from wil_campaign.recipes.visibility.sampling import image_samples_of, sampled_intrinsics
from wil_campaign.vehicles.readings import DepthImage
from wil_campaign.vehicles.sensors.beams import Directions
from wil_campaign.vehicles.sensors.lens import ThroughLens
from wil_campaign.vehicles.sensors.world_views import WorldImages, WorldRays
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene

_HIDDEN_M = 0.05


class ExpectedViews:
    """Computes the expected views. real: scene W, virtual: scene Wv, ids as in the world file."""

    def __init__(self, *, real: Scene, virtual: Scene, events: Mapping[str, float]) -> None:
        physical = tuple(thing for thing in real.objects if thing.name not in virtual)
        everything = Scene((*virtual.objects, *physical))
        self._virtual_images = ThroughLens(WorldImages(scene=virtual, events=events))
        self._physical = [thing.object_id for thing in physical]
        self._all_images = self._virtual_images
        if physical:
            self._all_images = ThroughLens(WorldImages(scene=everything, events=events))
        self._all_rays = WorldRays(scene=everything, events=events)
        self._virtual_rays = WorldRays(scene=virtual, events=events)

    def prepare_rays(self) -> None:
        """Prepare for `ranges` before the flight; otherwise its first call takes long."""
        self._all_rays.prepare()
        if self._physical:
            self._virtual_rays.prepare()

    def image(
        self,
        camera: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        virtual: VirtualObjects,
        real_depth_m: DepthImage | None,
    ) -> ExpectedImage:
        """Return an image's expected samples. camera: its pose (FRD axes, world frame).

        real_depth_m: depth of the real camera at these pixels; None when unknown.
        """
        sampled = sampled_intrinsics(intrinsics)
        rendered = self._virtual_images.picture(
            camera, sampled, t_s, want_ids=True, want_depth=real_depth_m is not None
        )
        ids = _require_ids(rendered.object_ids)
        unknown: Mask | None = None
        hidden: Mask | None = None
        if self._physical:
            with_physical = self._all_images.picture(camera, sampled, t_s, want_ids=True)
            seen = _require_ids(with_physical.object_ids)
            unknown = virtual.mask_of(ids) & (seen != ids)
            hidden = unknown & well_within(np.isin(seen, self._physical))
        if real_depth_m is not None and rendered.depth_m is not None:
            nearer = real_depth_m < rendered.depth_m - _HIDDEN_M
            unknown = nearer if unknown is None else unknown | nearer
        step = image_samples_of(intrinsics).step
        return ExpectedImage(ids, rendered.image_bgr, unknown, step, hidden)

    def depths(self, camera: Pose, intrinsics: Intrinsics, t_s: float) -> ExpectedRanges:
        """Return the expected depths along the optical axis at the samples, flat."""
        sampled = sampled_intrinsics(intrinsics)
        everything = _depths(self._all_images, camera, sampled, t_s)
        if not self._physical:
            return everything
        virtual = _depths(self._virtual_images, camera, sampled, t_s)
        return replace(everything, virtual=virtual)

    def ranges(self, sensor: Pose, directions: Directions, t_s: float) -> ExpectedRanges:
        """Return the expected ranges of beams. sensor: its pose (FRD axes, world frame)."""
        everything = _ranges(self._all_rays, sensor, directions, t_s)
        if not self._physical:
            return everything
        virtual = _ranges(self._virtual_rays, sensor, directions, t_s)
        return replace(everything, virtual=virtual)


def _depths(images: ThroughLens, camera: Pose, sampled: Intrinsics, t_s: float) -> ExpectedRanges:
    rendered = images.picture(camera, sampled, t_s, want_ids=True, want_depth=True)
    depth_m = np.asarray(rendered.depth_m, np.float64)
    return ExpectedRanges(depth_m.reshape(-1), _require_ids(rendered.object_ids).reshape(-1))


def _ranges(rays: WorldRays, sensor: Pose, directions: Directions, t_s: float) -> ExpectedRanges:
    hits = rays(sensor, directions, t_s)
    return ExpectedRanges(hits.ranges_m.astype(np.float64), hits.object_ids)


def _require_ids(ids: Ids | None) -> Ids:
    """Return the rendered object ids of an expected view. Raises TypeError for None."""
    if ids is None:
        raise TypeError("the renderer returned no object ids, which were requested")
    return ids
