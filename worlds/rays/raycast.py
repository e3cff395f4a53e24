"""An exact ray caster over a scene (Embree): for lidar, and to check the renderer against.

Embree finds the triangle in single precision; the range to it is worked out again in double.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.frames import AT_ORIGIN, Pose, Vec3, matrix_from_quat
from wil_campaign.worlds.scene.meshes import FloatArray
from wil_campaign.worlds.scene.scene import NO_EVENTS, RigidBody, Scene


@dataclass(frozen=True, slots=True, eq=False)
class RaycastHits:
    """The first hits of rays. ranges_m: (n,) float64, inf for none. object_ids: (n,), 0 then."""

    ranges_m: FloatArray
    object_ids: NDArray[np.uint8]


class SceneRayCaster:
    """Casts rays at one scene; moving objects are hit where they are at the time.

    Embree builds its trees once: one for all objects at rest, and one for each moving object.
    """

    def __init__(self, scene: Scene) -> None:
        resting = [body for body in scene.bodies if body.scene_object.motion is None]
        poses = [body.scene_object.pose for body in resting]
        self._resting = _Group(resting, poses) if resting else None
        moving = [body for body in scene.bodies if body.scene_object.motion is not None]
        self._moving = [(body, _Group([body], [AT_ORIGIN])) for body in moving]

    def cast(
        self,
        origin_ned_m: Vec3,
        directions_ned: FloatArray,
        t_s: float,
        events: Mapping[str, float] = NO_EVENTS,
    ) -> RaycastHits:
        """Return the first hits of rays from one place at a time. directions_ned: (n, 3), unit."""
        count = len(directions_ned)
        ranges_m, object_ids = np.full(count, np.inf), np.zeros(count, np.uint8)
        groups = [(self._resting, AT_ORIGIN)] if self._resting else []
        groups += [(group, body.pose_at(t_s, events)) for body, group in self._moving]
        for group, pose in groups:
            rotation = matrix_from_quat(pose.q_wxyz)
            hits = group.cast(np.array(pose.to_local(origin_ned_m)), directions_ned @ rotation)
            nearer = hits.ranges_m < ranges_m
            ranges_m[nearer] = hits.ranges_m[nearer]
            object_ids[nearer] = hits.object_ids[nearer]
        return RaycastHits(ranges_m, object_ids)


class RaycastError(Exception):
    """Rays cannot be cast on this machine."""

    def __init__(self) -> None:
        super().__init__(
            "sensors that measure ranges in a world are cast by Embree, which is not installed "
            "here (it has no package for ARM): leave them out, or pip install embreex"
        )


class _Group:
    """Bodies with fixed relative places in one tree for ray casting."""

    def __init__(self, bodies: Sequence[RigidBody], poses: Sequence[Pose]) -> None:
        try:  # only lidars and rangefinders need these
            from embreex.mesh_construction import TriangleMesh  # noqa: PLC0415
            from embreex.rtcore_scene import EmbreeScene  # noqa: PLC0415
        except ModuleNotFoundError as error:
            raise RaycastError from error

        self._scene: Any = EmbreeScene()
        self._ids = np.array([body.scene_object.object_id for body in bodies], np.uint8)
        self._corners: list[FloatArray] = []
        self._meshes: list[Any] = []
        for body, pose in zip(bodies, poses, strict=True):
            mesh = body.shape.mesh.moved(pose)
            corners = mesh.vertices_m[mesh.faces]
            self._corners.append(corners)
            self._meshes.append(TriangleMesh(self._scene, corners.astype(np.float32)))
        # Embree builds the tree at its first ray.
        self._scene.run(np.zeros((1, 3), np.float32), np.eye(1, 3, dtype=np.float32))

    def cast(self, origin_m: FloatArray, directions: FloatArray) -> RaycastHits:
        """Return the rays' first hits; origin and directions in this group's frame."""
        rays = np.ascontiguousarray(directions, np.float32)
        origins = np.ascontiguousarray(np.broadcast_to(origin_m, rays.shape), np.float32)
        found = self._scene.run(origins, rays, output=True)
        met, face = found["geomID"], found["primID"]
        ranges_m, object_ids = np.full(len(rays), np.inf), np.zeros(len(rays), np.uint8)
        for index, corners in enumerate(self._corners):
            here = np.flatnonzero(met == index)
            if here.size:
                met_corners = corners[face[here]]
                ranges_m[here] = _plane_ranges(met_corners, origin_m, directions[here])
                object_ids[here] = self._ids[index]
        return RaycastHits(ranges_m, object_ids)


def _plane_ranges(corners: FloatArray, origin_m: FloatArray, directions: FloatArray) -> FloatArray:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above = np.einsum("ij,ij->i", normals, corners[:, 0] - origin_m)
    slope = np.einsum("ij,ij->i", normals, directions)
    return np.asarray(above / np.where(slope == 0.0, np.nan, slope))
