"""How far the virtual objects were drawn from where they belong, in pixels."""

import itertools
import math
from collections.abc import Iterable

from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3
from worlds.scene import SceneObject


def registration_error_px(
    points_ned_m: Iterable[Vec3],
    *,
    intrinsics: Intrinsics,
    drawn_from: Pose,
    reference: Pose,
) -> float | None:
    """Return the RMS distance between points as drawn and as the reference camera would see them.

    points_ned_m: points of virtual objects, world frame. drawn_from, reference: camera poses (FRD
    axes). Only points in front of both cameras and within either picture count; None when there
    is none.
    """
    squares: list[float] = []
    for point in points_ned_m:
        drawn = intrinsics.project(drawn_from.to_local(point))
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
