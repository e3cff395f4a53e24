"""The renderer: images of one scene from any pose, from any thread."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.jit import F64
from wil_campaign.worlds.render.arrays import (
    Buffer,
    Geometry,
    Looks,
    Scratch,
    Shades,
    Triangles,
    View,
)
from wil_campaign.worlds.render.packing import pack_geometry, pack_looks
from wil_campaign.worlds.render.placing import place
from wil_campaign.worlds.render.rasterizer import cover, gather
from wil_campaign.worlds.render.shading import clear, shade, write_depth, write_ids, write_image
from wil_campaign.worlds.scene.scene import NO_EVENTS, Scene


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
        self._closed = np.array([body.shape.mesh.closed for body in self._bodies], np.uint8)
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
        rotations_ned, positions_ned_m = self._places(t_s, events)
        view = View(
            **self._view_arrays(),
            fx=float(intrinsics.fx_px),
            fy=float(intrinsics.fy_px),
            cx=float(intrinsics.cx_px),
            cy=float(intrinsics.cy_px),
            width=intrinsics.width_px,
            height=intrinsics.height_px,
        )
        view.one_sided[:] = self._closed
        # Floats: of other numbers Numba would make another kernel.
        q_wxyz = tuple(map(float, camera_pose.q_wxyz))
        at_ned_m = tuple(map(float, camera_pose.position_ned_m))
        place(q_wxyz, at_ned_m, rotations_ned, positions_ned_m, self._geometry.spheres, view)
        if only is not None:
            names = [body.scene_object.name for body in self._bodies]
            view.shown[[name not in only for name in names]] = 0
        return view

    def _view_arrays(self) -> dict[str, Any]:
        """Return this thread's arrays for a view, which the next view of it overwrites."""
        local, count = self._local, len(self._bodies)
        if not hasattr(local, "view"):
            local.view = {
                "rotations": np.empty((count, 3, 3)),
                "shifts": np.empty((count, 3)),
                "lights": np.empty((count, 2, 3)),
                "up": np.empty(3),
                "shown": np.empty(count, np.uint8),
                "one_sided": np.empty(count, np.uint8),
            }
        arrays: dict[str, Any] = local.view
        return arrays

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
