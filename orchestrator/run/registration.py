"""How far the virtual objects were drawn from where they belong, in pixels."""

import itertools
import math
from collections.abc import Iterable, Mapping

from campaigns.sensor_setups import CameraSetup, DepthSetup
from orchestrator.run.mixing import Registration
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from vehicles.readings import CameraReading, DepthReading, Reading
from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3
from worlds.scene import SceneObject


class Registrar:
    """Measures registration errors against where the real camera truly was."""

    def __init__(
        self, *, setup: RunSetup, stations: Mapping[str, Station], events: Mapping[str, float]
    ) -> None:
        real = set(setup.real_scene.names)
        self._virtual = [
            (thing, box_corners(thing))
            for thing in setup.virtual_scene.objects
            if thing.name not in real
        ]
        self._stations = stations
        self._events = events

    def of(self, camera: CameraSetup | DepthSetup) -> Registration:
        """Return what gives the error of a twin's picture over one of a real camera.

        It gives None for a picture of unknown place, and where nothing virtual is in sight.
        """
        truth = self._stations["real"].truth

        def error_px(twin: Reading, exposed_s: float) -> float | None:
            if not isinstance(twin, CameraReading | DepthReading) or twin.camera_pose is None:
                return None
            found = truth.at(exposed_s)
            if found.pose is None:
                return None
            return registration_error_px(
                zip(self._corners(twin.t_s), self._corners(exposed_s), strict=True),
                intrinsics=camera.intrinsics,
                drawn_from=twin.camera_pose,
                reference=camera.mount.camera_pose(found.pose),
            )

        return error_px

    def _corners(self, t_s: float) -> list[Vec3]:
        return [
            pose.to_parent(corner)
            for thing, corners in self._virtual
            for pose in (thing.pose_at(t_s, self._events),)
            for corner in corners
        ]


def registration_error_px(
    points_ned_m: Iterable[tuple[Vec3, Vec3]],
    *,
    intrinsics: Intrinsics,
    drawn_from: Pose,
    reference: Pose,
) -> float | None:
    """Return the RMS distance between points as drawn and as the reference camera would see them.

    points_ned_m: points of virtual objects, world frame, each where it was drawn and where it
    was at the exposure of the real picture. drawn_from, reference: camera poses (FRD axes). Only
    points in front of both cameras and within either picture count; None when there is none.
    """
    squares: list[float] = []
    for shown, point in points_ned_m:
        drawn = intrinsics.project(drawn_from.to_local(shown))
        right = intrinsics.project(reference.to_local(point))
        if drawn is None or right is None:
            continue
        if _inside(drawn, intrinsics) or _inside(right, intrinsics):
            squares.append((drawn[0] - right[0]) ** 2 + (drawn[1] - right[1]) ** 2)
    if not squares:
        return None
    return math.sqrt(math.fsum(squares) / len(squares))


def box_corners(thing: SceneObject) -> tuple[Vec3, ...]:
    """Return the eight corners of the box round a thing, in its own frame (FRD metres)."""
    low = [float(value) for value in thing.shape.mesh.vertices_m.min(axis=0)]
    high = [float(value) for value in thing.shape.mesh.vertices_m.max(axis=0)]
    sides = zip(low, high, strict=True)
    return tuple((north, east, down) for north, east, down in itertools.product(*sides))


def _inside(pixel: tuple[float, float], intrinsics: Intrinsics) -> bool:
    return (
        -0.5 <= pixel[0] <= intrinsics.width_px - 0.5
        and -0.5 <= pixel[1] <= intrinsics.height_px - 0.5
    )
