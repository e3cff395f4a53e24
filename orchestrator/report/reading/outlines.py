"""The things of a world as outlines from above and from the side; pure."""

from collections.abc import Iterable, Mapping

import numpy as np
import shapely
from numpy.typing import NDArray

from orchestrator.report.model import Outline, Point
from worlds.frames import Pose, matrix_from_quat
from worlds.scene.parts import BoxShape, Part, SphereShape
from worlds.scene.scene import Scene, SceneObject

_MOST_FACES = 4000
"""Of a surface that is drawn by its triangles; a larger one by its hull."""
_FINE_M = 0.02
_ROUTE_STEPS = 60
_PLAIN_RGB = (128, 128, 128)

Points = NDArray[np.float64]


def outlines_of(
    judged: Scene,
    physical: frozenset[str],
    *,
    side_axis: str,
    t_s: float,
    events: Mapping[str, float],
    span_s: Point,
) -> tuple[Outline, ...]:
    """Return the outlines of a scene as it stands at t_s.

    physical: names of what stands in W. span_s: the time for which the way of a thing is drawn.
    """
    return tuple(
        _outline(
            thing,
            is_virtual=thing.name not in physical,
            side=1 if side_axis == "east" else 0,
            pose=thing.pose_at(t_s, events),
            route=_route(thing, events, span_s),
        )
        for thing in judged.objects
    )


def _route(thing: SceneObject, events: Mapping[str, float], span_s: Point) -> Points:
    if thing.motion is None:
        return np.empty((0, 3))
    times = np.linspace(*span_s, _ROUTE_STEPS)
    return np.array([thing.pose_at(float(t), events).position_ned_m for t in times])


def _outline(
    thing: SceneObject, *, is_virtual: bool, side: int, pose: Pose, route: Points
) -> Outline:
    # A room is seen from inside: one line round it, not its walls.
    parts = [part for part in thing.shape.parts if not part.is_floor]
    clouds = [(_moved(pose, vertices_of(part)), _faces(part)) for part in parts]
    if thing.is_room:
        clouds = [(_moved(pose, thing.shape.mesh.vertices_m), None)]
    materials = thing.shape.mesh.materials
    return Outline(
        name=thing.name,
        is_virtual=is_virtual,
        is_room=thing.is_room,
        rgb=materials[0].rgb if materials else _PLAIN_RGB,
        above_m=_flat_outlines([(_above(points), faces) for points, faces in clouds]),
        side_m=_flat_outlines([(_beside(points, side), faces) for points, faces in clouds]),
        route_above_m=_as_points(_above(route)),
        route_side_m=_as_points(_beside(route, side)),
    )


def _above(points: Points) -> Points:
    return points[:, [1, 0]]


def _beside(points: Points, side: int) -> Points:
    return np.stack([points[:, side], -points[:, 2]], axis=1)


def _moved(pose: Pose, points: Points) -> Points:
    moved: Points = points @ matrix_from_quat(pose.q_wxyz).T + np.array(pose.position_ned_m)
    return moved


def vertices_of(part: Part) -> Points:
    """Return corners of a part in its thing's frame."""
    match part.shape:
        case BoxShape(half_m):
            signs = np.array([(n, e, d) for n in (-1, 1) for e in (-1, 1) for d in (-1, 1)])
            points = signs * np.array(half_m)
        case SphereShape(radius_m):
            points = _ball(radius_m)
        case shape:
            points = shape.vertices_m
    return _moved(part.pose, points)


def _ball(radius_m: float) -> Points:
    turns = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    ring = np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=1) * radius_m
    return np.concatenate([ring, ring[:, [2, 0, 1]], ring[:, [1, 2, 0]]])


def _faces(part: Part) -> NDArray[np.int32] | None:
    """Return the triangles of a part that is not convex; None for its hull."""
    shape = part.shape
    if isinstance(shape, BoxShape | SphereShape) or len(shape.faces) > _MOST_FACES:
        return None
    return shape.faces


def _flat_outlines(
    clouds: Iterable[tuple[Points, NDArray[np.int32] | None]],
) -> tuple[tuple[Point, ...], ...]:
    """Return what parts cover together, as polygons without their holes' fill.

    A hole would need a rule of filling: bars round an opening stay parts of their own, so that an
    opening stays open.
    """
    found: list[tuple[Point, ...]] = []
    for points, faces in clouds:
        flat = shapely.multipoints(points).convex_hull
        if faces is not None:
            triangles = shapely.polygons(points[faces])
            flat = shapely.union_all(triangles[shapely.area(triangles) > 0.0])
        flat = shapely.simplify(flat, _FINE_M / 4)
        found += [_as_points(shapely.get_coordinates(one)) for one in shapely.get_parts(flat)]
    return tuple(points for points in found if len(points) >= 2)


def _as_points(points: Points) -> tuple[Point, ...]:
    return tuple((float(x), float(y)) for x, y in points)
