"""The renderer: pictures of one scene from any pose, from any thread."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from worlds.camera import Intrinsics
from worlds.frames import Pose, matrix_from_quat
from worlds.render.arrays import (
    Buffer,
    Geometry,
    Looks,
    Scratch,
    Shades,
    Target,
    Triangles,
    View,
)
from worlds.render.packing import pack_geometry, pack_looks
from worlds.render.shading import draw
from worlds.scene import NO_EVENTS, Scene

BgrImage = np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]
DepthImage = np.ndarray[tuple[int, int], np.dtype[np.float32]]
IdImage = np.ndarray[tuple[int, int], np.dtype[np.uint8]]

_LAMP_NED = np.array([-0.5, 0.3, -0.81])
_UP_NED = np.array([0.0, 0.0, -1.0])
_NO_DEPTH, _NO_IDS = np.empty(0, np.float32), np.empty(0, np.uint8)
_OPTICAL_FROM_FRD = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A rendered picture; its arrays belong to the caller.

    image_bgr: (height, width, 3) uint8. depth_m: (height, width) float32 metres along the
    optical axis, inf where nothing is. object_ids: (height, width) uint8, 0 where nothing is.
    depth_m and object_ids are None when they were not wanted.
    """

    image_bgr: np.ndarray
    depth_m: np.ndarray | None
    object_ids: np.ndarray | None


class Renderer:
    """Renders one scene. Several threads may call `render` at once; equal calls, equal bits."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._geometry: Geometry = pack_geometry(scene)
        self._looks: Looks = pack_looks(scene)
        self._local = threading.local()

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
    ) -> Picture:
        """Return the picture that a camera sees at a time.

        camera_pose: in the world (NED), FRD axes, x looks out. intrinsics: distortion is
        ignored. events: when each happened, for things that move. only: names of the objects
        to draw; all others are absent, and hide nothing.
        """
        width, height = intrinsics.width_px, intrinsics.height_px
        image = np.empty((height, width, 3), np.uint8)
        depth = np.empty((height, width), np.float32) if want_depth else None
        ids = np.empty((height, width), np.uint8) if want_ids else None
        target = Target(
            image=image.reshape(-1),
            depth=_NO_DEPTH if depth is None else depth.reshape(-1),
            ids=_NO_IDS if ids is None else ids.reshape(-1),
            want_depth=want_depth,
            want_ids=want_ids,
        )
        view = self._view(camera_pose, intrinsics, t_s, events, only)
        while not draw(self._geometry, self._looks, view, self._scratch(width, height), target):
            self._local.triangles *= 2
        return Picture(image, depth, ids)

    def _view(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        events: Mapping[str, float],
        only: frozenset[str] | None,
    ) -> View:
        count = len(self._scene.objects)
        optical_from_ned = _OPTICAL_FROM_FRD @ matrix_from_quat(camera_pose.q_wxyz).T
        camera_ned_m = np.array(camera_pose.position_ned_m)
        rotations, shifts = np.empty((count, 3, 3)), np.empty((count, 3))
        lights, shown = np.empty((count, 2, 3)), np.ones(count, np.uint8)
        for k, thing in enumerate(self._scene.objects):
            if only is not None and thing.name not in only:
                shown[k] = 0
                continue
            pose = thing.pose_at(t_s, events)
            ned_from_body = matrix_from_quat(pose.q_wxyz)
            rotations[k] = optical_from_ned @ ned_from_body
            shifts[k] = optical_from_ned @ (np.array(pose.position_ned_m) - camera_ned_m)
            lights[k, 0] = _LAMP_NED @ ned_from_body
            lights[k, 1] = _UP_NED @ ned_from_body
        return View(
            rotations=rotations,
            shifts=shifts,
            lights=lights,
            up=optical_from_ned @ _UP_NED,
            shown=shown,
            fx=float(intrinsics.fx_px),
            fy=float(intrinsics.fy_px),
            cx=float(intrinsics.cx_px),
            cy=float(intrinsics.cy_px),
            width=intrinsics.width_px,
            height=intrinsics.height_px,
        )

    def _scratch(self, width: int, height: int) -> Scratch:
        """Return this thread's work space, made anew when another size is needed."""
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
