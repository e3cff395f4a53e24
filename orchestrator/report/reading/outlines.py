"""Outlines of a world's objects from above and from the side; pure.

An opening that is seen edge-on is drawn as floor plans draw a window: as a gap in its wall, with a
line from side to side, so that a path goes through it and not through a lintel or a jamb.
"""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray

from wil_campaign.orchestrator.report.model import ObjectOutline, Point, side_depth_m
from wil_campaign.worlds.frames import Pose, Quat, matrix_from_quat
from wil_campaign.worlds.scene.parts import BoxShape, ObjectOpening, SolidPart, SphereShape
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape

_MOST_FACES = 4000
"""A surface with more faces is drawn as its hull."""
_FINE_M = 0.02
_ROUTE_STEPS = 60
_THICK_M = 0.5
"""An opening is cut out of what is this near to its plane, not out of what stands behind it."""
_RING_CORNERS = 32
_EDGE_ON = 0.1
"""Largest cosine between an opening's axis and the view's for an opening that is seen edge-on."""
_PLAIN_RGB = (128, 128, 128)

Points = NDArray[np.float64]
_View = tuple[tuple[int, int], tuple[float, float]]
"""NED axes to the right and up in a view, and their signs."""
_ABOVE: _View = ((1, 0), (1.0, 1.0))
_BESIDE: tuple[_View, _View] = (((0, 2), (1.0, -1.0)), ((1, 2), (1.0, -1.0)))


def outlines_of(
    judged: Scene,
    physical: frozenset[str],
    *,
    side_axis: str,
    t_s: float,
    events: Mapping[str, float],
    span_s: Point,
) -> tuple[ObjectOutline, ...]:
    """Return the outlines of a scene at t_s.

    physical: names of the objects in W. span_s: the time for which an object's path is drawn.
    """
    return tuple(
        _outline(
            obj,
            is_virtual=obj.name not in physical,
            side=1 if side_axis == "east" else 0,
            pose=obj.pose_at(t_s, events),
            route=_route(obj, events, span_s),
        )
        for obj in judged.objects
    )


def _route(obj: SceneObject, events: Mapping[str, float], span_s: Point) -> Points:
    if obj.motion is None:
        return np.empty((0, 3))
    times = np.linspace(*span_s, _ROUTE_STEPS)
    return np.array([obj.pose_at(float(t), events).position_ned_m for t in times])


def _outline(
    obj: SceneObject, *, is_virtual: bool, side: int, pose: Pose, route: Points
) -> ObjectOutline:
    materials = obj.shape.mesh.materials
    return ObjectOutline(
        name=obj.name,
        is_virtual=is_virtual,
        is_room=obj.is_room,
        rgb=materials[0].rgb if materials else _PLAIN_RGB,
        above_m=_flat_outlines(obj, pose, _ABOVE),
        side_m=_flat_outlines(obj, pose, _BESIDE[side]),
        route_above_m=_as_points(_flat(route, _ABOVE)),
        route_side_m=_as_points(_flat(route, _BESIDE[side])),
        depth_m=_depth_m(obj, pose, "east" if side else "north"),
    )


def _depth_m(obj: SceneObject, pose: Pose, side_axis: str) -> Point:
    moved = _moved(pose, obj.shape.mesh.vertices_m)
    depths = [side_depth_m((n, e, d), side_axis) for n, e, d in moved.tolist()]
    return (min(depths), max(depths)) if depths else (0.0, 0.0)


def _flat_outlines(obj: SceneObject, pose: Pose, view: _View) -> tuple[tuple[Point, ...], ...]:
    """Return the areas of an object's parts as polygons.

    Each part is its own polygon, without a union: an opening between bars stays open. A hole is
    joined to its outline by the shortest line.
    """
    ((right_m, up_m),) = _flat(np.array([pose.position_ned_m]), view).tolist()
    found = _turned_outlines(obj.shape, obj.is_room, pose.q_wxyz, view)
    return tuple(tuple((x + right_m, y + up_m) for x, y in points) for points in found)


@lru_cache(maxsize=512)
def _turned_outlines(
    shape: Shape,
    is_room: bool,
    q_wxyz: Quat,
    view: _View,
) -> tuple[tuple[Point, ...], ...]:
    """Return the outlines of a shape about its origin; cached, as runs share shapes."""
    parts = [part for part in shape.parts if not part.is_floor]
    clouds = [(vertices_of(part), _faces(part)) for part in parts]
    if is_room:
        # A room is seen from inside: draw one line around it instead of its walls.
        clouds = [(shape.mesh.vertices_m, None)]
    turned = Pose((0.0, 0.0, 0.0), q_wxyz)
    cuts = [_cut(opening, turned, view, _THICK_M) for opening in shape.openings]
    cut = shapely.union_all(cuts)
    found: list[tuple[Point, ...]] = []
    for corners, faces in clouds:
        points = _flat(_moved(turned, corners), view)
        flat = shapely.multipoints(points).convex_hull
        if faces is not None:
            triangles = shapely.polygons(points[faces])
            flat = shapely.union_all(triangles[shapely.area(triangles) > 0.0])
        flat = shapely.simplify(shapely.difference(flat, cut), _FINE_M / 4)
        found += [ring_of_outline(one) for one in shapely.get_parts(flat)]
    lines = [_cut(opening, turned, view, 0.0) for opening in shape.openings]
    found += [ring_of_outline(line) for line in lines if not line.is_empty]
    return tuple(points for points in found if len(points) >= 2)


def _cut(opening: ObjectOpening, turned: Pose, view: _View, thick_m: float) -> shapely.Geometry:
    """Return the area of an opening seen edge-on, so deep to both sides; else an empty one."""
    pose = turned.compose(opening.pose)
    axes, _ = view
    (into,) = {0, 1, 2} - set(axes)
    if abs(matrix_from_quat(pose.q_wxyz)[into, 0]) > _EDGE_ON:
        return shapely.Polygon()
    corners = opening.corners_m
    if opening.form == "square":
        half_m = opening.limit_m
        corners = ((half_m, half_m), (-half_m, half_m), (-half_m, -half_m), (half_m, -half_m))
    elif opening.form == "ring":
        turns = np.linspace(0.0, 2.0 * np.pi, _RING_CORNERS, endpoint=False)
        ring = np.stack([np.cos(turns), np.sin(turns)], axis=1) * opening.limit_m
        corners = tuple((right, down) for right, down in ring.tolist())
    ends = [(ahead, *corner) for corner in corners for ahead in (-thick_m, thick_m)]
    points = _flat(_moved(pose, np.array(ends)), view)
    return shapely.multipoints(points).convex_hull


def ring_of_outline(flat: shapely.Geometry) -> tuple[Point, ...]:
    """Return an outline as one ring; its holes are joined to it, there and back."""
    if not isinstance(flat, shapely.Polygon) or not flat.interiors:
        return _as_points(shapely.get_coordinates(flat))
    ring = shapely.get_coordinates(flat.exterior)
    for interior in flat.interiors:
        hole = shapely.get_coordinates(interior)[:-1]
        away = np.linalg.norm(ring[:, None] - hole[None], axis=2)
        at, nearest = np.unravel_index(int(away.argmin()), away.shape)
        hole = np.roll(hole, -int(nearest), axis=0)
        ring = np.concatenate([ring[: at + 1], hole, hole[:1], ring[at:]])
    return _as_points(ring)


def _flat(points: Points, view: _View) -> Points:
    """Return points projected on a view's axes, right and up."""
    (right, up), (sign_right, sign_up) = view
    return np.stack([sign_right * points[:, right], sign_up * points[:, up]], axis=1)


def _moved(pose: Pose, points: Points) -> Points:
    moved: Points = points @ matrix_from_quat(pose.q_wxyz).T + np.array(pose.position_ned_m)
    return moved


def vertices_of(part: SolidPart) -> Points:
    """Return the vertices of a part in its object's frame."""
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


def _faces(part: SolidPart) -> NDArray[np.int32] | None:
    """Return the triangles of a part; None to use its hull."""
    shape = part.shape
    if isinstance(shape, BoxShape | SphereShape) or len(shape.faces) > _MOST_FACES:
        return None
    return shape.faces


def _as_points(points: Points) -> tuple[Point, ...]:
    return tuple((float(x), float(y)) for x, y in points)
