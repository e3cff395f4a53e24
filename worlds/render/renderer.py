"""The renderer: images of one scene from any pose, from any thread."""

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worlds.camera import Intrinsics
from worlds.frames import Pose, matrix_from_quat
from worlds.jit import F64
from worlds.render.arrays import (
    Buffer,
    Geometry,
    Looks,
    Scratch,
    Shades,
    Triangles,
    View,
)
from worlds.render.packing import pack_geometry, pack_looks
from worlds.render.rasterizer import NEAR_M, cover, gather
from worlds.render.shading import clear, shade, write_depth, write_ids, write_image
from worlds.scene.scene import NO_EVENTS, Scene

Bools = NDArray[np.bool]

_UP_NED = np.array([0.0, 0.0, -1.0])
_LIGHTS_NED = np.stack([[-0.5, 0.3, -0.81], _UP_NED])
"""Towards the lamp, and upwards."""
_OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class RenderOutput:
    """A rendered image; its arrays belong to the caller.

    image_bgr: (height, width, 3) uint8. depth_m: (height, width) float32 metres along the
    optical axis, inf where nothing is. object_ids: (height, width) uint8, 0 where nothing is.
    depth_m and object_ids are None when they were not wanted.
    """

    image_bgr: NDArray[np.uint8]
    depth_m: NDArray[np.float32] | None
    object_ids: NDArray[np.uint8] | None


class Renderer:
    """Renders one scene. Several threads may call `render` at once; equal calls, equal bits."""

    def __init__(self, scene: Scene) -> None:
        self._bodies = scene.bodies
        self._geometry: Geometry = pack_geometry(scene)
        self._looks: Looks = pack_looks(scene)
        self._local = threading.local()
        poses = [body.scene_object.pose for body in self._bodies]
        self._closed = np.array([body.shape.mesh.closed for body in self._bodies], bool)
        self._moving = [
            (k, body) for k, body in enumerate(self._bodies) if body.scene_object.motion
        ]
        self._rotations = np.array([matrix_from_quat(pose.q_wxyz) for pose in poses])
        self._rotations = self._rotations.reshape(-1, 3, 3)
        self._positions_m = np.array([pose.position_ned_m for pose in poses]).reshape(-1, 3)

    def render(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        events: Mapping[str, float] = NO_EVENTS,
        *,
        want_depth: bool = True,
        want_ids: bool = True,
        only: frozenset[str] | None = None,
    ) -> RenderOutput:
        """Return the rendered image of a camera at a time.

        camera_pose: in the world (NED), FRD axes, x looks out. intrinsics: distortion is
        ignored. events: when each happened, for objects that move. only: names of the objects
        to draw; all others are absent, and hide nothing.
        """
        width, height = intrinsics.width_px, intrinsics.height_px
        view = self._view(camera_pose, intrinsics, t_s, events, only)
        while (scratch := self._draw(view, self._scratch(width, height))) is None:
            self._local.triangles *= 2
        image = np.empty((height, width, 3), np.uint8)
        write_image(scratch.colors, image.reshape(-1))
        depth = np.empty((height, width), np.float32) if want_depth else None
        if depth is not None:
            write_depth(scratch.buffer.inverse_depth, depth.reshape(-1))
        ids = np.empty((height, width), np.uint8) if want_ids else None
        if ids is not None:
            owner, face = scratch.buffer.triangle, scratch.triangles.face
            write_ids(owner, face, self._geometry.face_id, ids.reshape(-1))
        return RenderOutput(image, depth, ids)

    def _draw(self, view: View, scratch: Scratch) -> Scratch | None:
        """Return the scratch with a frame rendered in it; None when it has too little room."""
        count = gather(self._geometry, view, scratch)
        if count < 0:
            return None
        triangles, buffer = scratch.triangles, scratch.buffer
        clear(buffer.inverse_depth, buffer.triangle, scratch.shades.state)
        cover(
            triangles.corners,
            triangles.bounds,
            triangles.planes,
            triangles.depth_range,
            count,
            buffer,
        )
        shade(self._geometry, self._looks, view, scratch)
        return scratch

    def _view(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        events: Mapping[str, float],
        only: frozenset[str] | None,
    ) -> View:
        optical_from_ned = _OPTICAL_FROM_FRD @ matrix_from_quat(camera_pose.q_wxyz).T
        rotations_ned, positions_ned_m = self._places(t_s, events)
        rotations = optical_from_ned @ rotations_ned
        shifts = (positions_ned_m - np.array(camera_pose.position_ned_m)) @ optical_from_ned.T
        shown, outside = self._show(rotations, shifts, intrinsics)
        if only is not None:
            shown &= np.array([body.scene_object.name in only for body in self._bodies], bool)
        return View(
            rotations=rotations,
            shifts=shifts,
            lights=_LIGHTS_NED @ rotations_ned,
            up=optical_from_ned @ _UP_NED,
            shown=shown.astype(np.uint8),
            one_sided=(outside & self._closed).astype(np.uint8),
            fx=float(intrinsics.fx_px),
            fy=float(intrinsics.fy_px),
            cx=float(intrinsics.cx_px),
            cy=float(intrinsics.cy_px),
            width=intrinsics.width_px,
            height=intrinsics.height_px,
        )

    def _places(self, t_s: float, events: Mapping[str, float]) -> tuple[F64, F64]:
        """Return every rendered body's rotation (n, 3, 3) to NED and position (n, 3)."""
        if not self._moving:
            return self._rotations, self._positions_m
        rotations, positions_m = self._rotations.copy(), self._positions_m.copy()
        for k, body in self._moving:
            pose = body.pose_at(t_s, events)
            rotations[k] = matrix_from_quat(pose.q_wxyz)
            positions_m[k] = pose.position_ned_m
        return rotations, positions_m

    def _show(self, rotations: F64, shifts: F64, camera: Intrinsics) -> tuple[Bools, Bools]:
        """Return which bodies may be in view, and which surely do not contain the camera."""
        spheres = self._geometry.spheres
        centers = np.matmul(rotations, spheres[:, :3, None])[:, :, 0] + shifts
        x, y, z = centers[:, 0], centers[:, 1], centers[:, 2]
        shown: Bools = z + spheres[:, 3] > NEAR_M
        for across, focal, middle, count in (
            (x, camera.fx_px, camera.cx_px, camera.width_px),
            (y, camera.fy_px, camera.cy_px, camera.height_px),
        ):
            for sign, edge in ((1.0, middle + 0.5), (-1.0, count - 0.5 - middle)):
                distance = (sign * focal * across + edge * z) / math.hypot(focal, edge)
                shown &= distance > -spheres[:, 3]
        return shown, np.asarray(np.linalg.norm(centers, axis=1) > spheres[:, 3] + 2.0 * NEAR_M)

    def _scratch(self, width: int, height: int) -> Scratch:
        """Return this thread's render work space, made anew for another image size."""
        local = self._local
        if not hasattr(local, "triangles"):
            local.triangles = len(self._geometry.faces) + 64
        key = (width, height, local.triangles)
        if getattr(local, "key", None) != key:
            local.key = key
            local.scratch = self._new_scratch(width, height, local.triangles)
        scratch: Scratch = local.scratch
        return scratch

    def _new_scratch(self, width: int, height: int, triangles: int) -> Scratch:
        vertices, faces = len(self._geometry.vertices), len(self._geometry.faces)
        return Scratch(
            camera=np.empty((vertices, 3)),
            screen=np.empty((vertices, 2)),
            triangles=Triangles(
                corners=np.empty((triangles, 6), np.int32),
                bounds=np.empty((triangles, 4), np.int32),
                planes=np.empty((triangles, 3)),
                depth_range=np.empty((triangles, 2), np.float32),
                face=np.empty(triangles, np.int32),
            ),
            shades=Shades(
                state=np.empty(faces, np.uint8),
                shade=np.empty(faces, np.int32),
                planes=np.empty((faces, 9)),
            ),
            buffer=Buffer(
                inverse_depth=np.empty(height * width, np.float32),
                triangle=np.empty(height * width, np.int32),
                width=width,
            ),
            colors=np.empty(height * width, np.uint32),
        )
