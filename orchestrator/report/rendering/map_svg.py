"""Maps of the vehicles' paths from above and the side, with world, fence, setpoints; SVG."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup

from wil_campaign.orchestrator.reading.model import CommandedState
from wil_campaign.orchestrator.report.model import (
    DrawnWorld,
    ObjectOutline,
    Point,
    RunReport,
    VehicleTrack,
    side_depth_m,
)
from wil_campaign.orchestrator.report.rendering.map_labels import LabelBox, PlacedName, place_names
from wil_campaign.orchestrator.report.rendering.markup import points_text, svg_element
from wil_campaign.orchestrator.report.rendering.scales import ticks_within
from wil_campaign.safety.fence.areas import Area, Circle
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.frames import Vec3

View = Literal["above", "side"]

_WIDTH = 420.0
_HEIGHTS = (150.0, 460.0)
_MARGIN = 24.0
_PAD_M = 0.4
_NAME_ROOM = 60.0
"""Free space at the right end of the lower axis, for its name."""
_REACH = 6.0
"""How many times farther than the path the world and the fence may widen a map."""
_ARROW_S = 0.5
"""A velocity setpoint is drawn as the distance covered in this time."""


@dataclass(frozen=True, slots=True)
class _Canvas:
    """Maps metres to units of the drawing. low, high: corners of the drawn area, metres."""

    low: Point
    high: Point
    scale: float

    @property
    def height(self) -> float:
        wanted = (self.high[1] - self.low[1]) * self.scale + 2 * _MARGIN
        return max(_HEIGHTS[0], min(_HEIGHTS[1], wanted))

    def at(self, point: Point) -> Point:
        x = _MARGIN + (point[0] - self.low[0]) * self.scale
        y = self.height - _MARGIN - (point[1] - self.low[1]) * self.scale
        return (x, y)

    def points(self, points: Iterable[Point]) -> str:
        return points_text(self.at(point) for point in points)


def map_svg(run: RunReport, view: View) -> Markup | None:
    """Return a map of a run; None where no vehicle's path is known."""
    if not any(track.positions_ned_m for track in run.tracks):
        return None
    side_axis = 1 if run.world.side_axis == "east" else 0
    canvas = _canvas(run, view, side_axis)
    at_s = None if run.moment is None else run.moment.t_s
    children = [
        *_grid(canvas),
        *_outlines(run, view, canvas),
        *_fences(run.world, view, side_axis, canvas),
        *(_setpoint(command, run.tracks, view, side_axis, canvas) for command in run.commands),
        *(_track(track, view, side_axis, canvas) for track in run.tracks),
        *_labels(run, view, side_axis, canvas),
        *_markers(run.tracks, at_s, view, side_axis, canvas),
        *_axis_names(run, view, canvas),
    ]
    box = f"0 0 {_WIDTH:g} {canvas.height:g}"
    what = "above" if view == "above" else f"the side, {run.world.side_axis} to the right"
    label = f"path of the vehicles from {what}"
    return svg_element(
        "svg", {"class": "map", "viewBox": box, "role": "img", "aria-label": label}, children
    )


def _flat(position_ned_m: Vec3, view: View, side_axis: int) -> Point:
    north_m, east_m, down_m = position_ned_m
    return (east_m, north_m) if view == "above" else (position_ned_m[side_axis], -down_m)


def _canvas(run: RunReport, view: View, side_axis: int) -> _Canvas:
    path = [_flat(p, view, side_axis) for track in run.tracks for p in track.positions_ned_m]
    low, high = _bounds(path)
    reach = [_REACH * max(high[axis] - low[axis], 1.0) for axis in (0, 1)]
    more = [*_fence_corners(run.world, view, side_axis)]
    for outline in run.world.outlines:
        more += [p for polygon in _polygons(outline, view) for p in polygon]
    near = [
        p
        for p in more
        if all(low[axis] - reach[axis] <= p[axis] <= high[axis] + reach[axis] for axis in (0, 1))
    ]
    low, high = _bounds([*path, *near])
    low, high = (low[0] - _PAD_M, low[1] - _PAD_M), (high[0] + _PAD_M, high[1] + _PAD_M)
    spans = (high[0] - low[0], high[1] - low[1])
    room = (_WIDTH - 2 * _MARGIN, _HEIGHTS[1] - 2 * _MARGIN)
    scale = min(room[0] / spans[0], room[1] / spans[1])
    # Centre content that is narrower than the drawing.
    spare = (room[0] / scale - spans[0]) / 2.0
    return _Canvas((low[0] - spare, low[1]), (high[0] + spare, high[1]), scale)


def _bounds(points: Sequence[Point]) -> tuple[Point, Point]:
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    return (min(xs), min(ys)), (max(xs), max(ys))


def _grid(canvas: _Canvas) -> Iterator[Markup]:
    for x in ticks_within(canvas.low[0], canvas.high[0], 7):
        low, high = canvas.at((x, canvas.low[1])), canvas.at((x, canvas.high[1]))
        yield _line("grid", low, high)
        if low[0] < _WIDTH - _NAME_ROOM:
            yield _text(f"{x:g}", (low[0], canvas.height - 8), anchor="middle", kind="tick")
    for y in ticks_within(canvas.low[1], canvas.high[1], 5):
        low, high = canvas.at((canvas.low[0], y)), canvas.at((canvas.high[0], y))
        yield _line("grid", low, high)
        yield _text(f"{y:g}", (20.0, low[1] + 3), anchor="end", kind="tick")


def _line(kind: str, begin: Point, end: Point) -> Markup:
    ends = {"x1": begin[0], "y1": begin[1], "x2": end[0], "y2": end[1]}
    return svg_element("line", {"class": kind, **ends})


def _text(text: str, at: Point, *, anchor: str, kind: str) -> Markup:
    place = {"class": kind, "x": at[0], "y": at[1], "text-anchor": anchor}
    return svg_element("text", place, [text])


def _polygons(outline: ObjectOutline, view: View) -> tuple[tuple[Point, ...], ...]:
    return outline.above_m if view == "above" else outline.side_m


def _outlines(run: RunReport, view: View, canvas: _Canvas) -> Iterator[Markup]:
    """Yield the objects; from the side the farthest first, pale behind the path, open before it."""
    outlines = run.world.outlines
    if view == "above":
        yield from (_outline(outline, view, canvas, "") for outline in outlines)
        return
    near_m, far_m = _path_depth_m(run)
    for one in sorted(outlines, key=lambda one: -one.depth_m[1]):
        place = "behind" if one.depth_m[0] > far_m else "before" if one.depth_m[1] < near_m else ""
        yield _outline(one, view, canvas, place)


def _path_depth_m(run: RunReport) -> Point:
    """Return how far the paths extend away from who looks from the side, least and most."""
    depths = [
        side_depth_m(place, run.world.side_axis)
        for track in run.tracks
        for place in track.positions_ned_m
    ]
    return min(depths), max(depths)


def _outline(outline: ObjectOutline, view: View, canvas: _Canvas, place: str) -> Markup:
    worlds = "virtual" if outline.is_virtual else "physical"
    kind = f"thing room {worlds}" if outline.is_room else f"thing {worlds} {place}".rstrip()
    fill = None if outline.is_room else "rgb({},{},{})".format(*outline.rgb)
    shapes = [
        svg_element("polygon", {"points": canvas.points(polygon), "fill": fill})
        for polygon in _polygons(outline, view)
    ]
    route = outline.route_above_m if view == "above" else outline.route_side_m
    if route:
        shapes.append(svg_element("polyline", {"class": "route", "points": canvas.points(route)}))
    where = "only in the virtual world" if outline.is_virtual else "in the real world"
    shapes.append(svg_element("title", {}, [f"{outline.name}: {where}"]))
    return svg_element("g", {"class": kind}, shapes)


def _labels(run: RunReport, view: View, side_axis: int, canvas: _Canvas) -> Iterator[Markup]:
    """Yield the names of the objects, clear of each other, of the markers and of the axes."""
    area = LabelBox(0.0, 0.0, _WIDTH, canvas.height - _MARGIN / 2.0)
    wanted = []
    for outline in run.world.outlines:
        corners = [canvas.at(p) for polygon in _polygons(outline, view) for p in polygon]
        if not outline.is_room and corners:
            (left, top), (right, bottom) = _bounds(corners)
            if left < area.right and right > area.left and top < area.bottom and bottom > 0.0:
                wanted.append((outline.name, LabelBox(left, top, right, bottom)))
    for placed in place_names(wanted, list(_taken(run, view, side_axis, canvas)), area):
        if placed.leader is not None:
            yield _line("leader", _led_from(placed), placed.leader)
        yield _text(placed.name, placed.at, anchor=placed.anchor, kind="name")


def _led_from(placed: PlacedName) -> Point:
    x, y = placed.at
    return (x, y + 2.0) if placed.leader is not None and placed.leader[1] > y else (x, y - 9.0)


def _taken(run: RunReport, view: View, side_axis: int, canvas: _Canvas) -> Iterator[LabelBox]:
    """Yield where no name may stand: axis names, and the markers of starts and of the moment."""
    yield LabelBox(0.0, 0.0, 60.0, 14.0)
    yield LabelBox(_WIDTH - _NAME_ROOM, canvas.height - 18.0, _WIDTH, canvas.height)
    for track in run.tracks:
        at_moment = None if run.moment is None else track.at(run.moment.t_s)
        for place in (*track.positions_ned_m[:1], at_moment):
            if place is not None:
                x, y = canvas.at(_flat(place, view, side_axis))
                yield LabelBox(x - 7.0, y - 7.0, x + 7.0, y + 7.0)


def _fence_corners(world: DrawnWorld, view: View, side_axis: int) -> Iterator[Point]:
    for fence in world.fences.values():
        for area in fence.inclusions:
            (south, west), (north, east) = _area_bounds(area)
            if view == "above":
                yield from ((west, south), (east, north))
                continue
            flat = (west, east) if side_axis == 1 else (south, north)
            heights = [h for h in (fence.floor_up_m, fence.ceiling_up_m) if h is not None]
            yield from ((x, h) for x in flat for h in heights)


def _area_bounds(area: Area) -> tuple[Point, Point]:
    if isinstance(area, Circle):
        (north, east), r = area.centre_m, area.radius_m
        return (north - r, east - r), (north + r, east + r)
    return _bounds(area.corners_m)


def _fences(world: DrawnWorld, view: View, side_axis: int, canvas: _Canvas) -> Iterator[Markup]:
    drawn: set[str] = set()
    for vehicle, fence in world.fences.items():
        shapes = Markup("").join(
            _fence_above(fence, canvas)
            if view == "above"
            else _fence_beside(fence, side_axis, canvas)
        )
        if shapes and shapes not in drawn:  # both vehicles often have the same fence
            drawn.add(shapes)
            title = svg_element("title", {}, [f"geofence of {vehicle}"])
            yield svg_element("g", {"class": "fence"}, [shapes, title])


def _fence_above(fence: Fence, canvas: _Canvas) -> Iterator[Markup]:
    for kind, areas in (("in", fence.inclusions), ("out", fence.exclusions)):
        for area in areas:
            if isinstance(area, Circle):
                x, y = canvas.at((area.centre_m[1], area.centre_m[0]))
                radius = area.radius_m * canvas.scale
                yield svg_element("circle", {"class": kind, "cx": x, "cy": y, "r": radius})
            else:
                corners = [(east, north) for north, east in area.corners_m]
                yield svg_element("polygon", {"class": kind, "points": canvas.points(corners)})


def _fence_beside(fence: Fence, side_axis: int, canvas: _Canvas) -> Iterator[Markup]:
    low = canvas.low[1] - 1.0 if fence.floor_up_m is None else fence.floor_up_m
    high = canvas.high[1] + 1.0 if fence.ceiling_up_m is None else fence.ceiling_up_m
    bounds = [_area_bounds(area) for area in fence.inclusions]
    spans = [(begin[side_axis], end[side_axis]) for begin, end in bounds]
    for left, right in spans or [(canvas.low[0] - 1.0, canvas.high[0] + 1.0)]:
        corners = [(left, low), (right, low), (right, high), (left, high)]
        yield svg_element("polygon", {"class": "in", "points": canvas.points(corners)})


def _track(track: VehicleTrack, view: View, side_axis: int, canvas: _Canvas) -> Markup:
    flat = [_flat(p, view, side_axis) for p in track.positions_ned_m]
    return svg_element(
        "polyline",
        {
            "class": f"track {_vehicle_class(track.vehicle)}",
            "points": canvas.points(flat),
            "data-begin": repr(track.begin_s),
            "data-step": repr(track.step_s),
            "data-name": track.vehicle,
        },
    )


def _vehicle_class(vehicle: str) -> str:
    return vehicle if vehicle in {"real", "twin"} else "other"


def _setpoint(
    row: CommandedState, tracks: Sequence[VehicleTrack], view: View, side_axis: int, canvas: _Canvas
) -> Markup:
    track = next((one for one in tracks if one.vehicle == row.vehicle), None)
    place = None if track is None else track.at(row.t_s)
    if row.setpoint is None or place is None:
        return Markup("")
    kind = f"setpoint {_vehicle_class(row.vehicle)}"
    if row.setpoint_kind == "position":
        x, y = canvas.at(_flat(row.setpoint, view, side_axis))
        return svg_element("path", {"class": kind, "d": f"M{x - 3:.1f} {y:.1f}h6m-3 -3v6"})
    north, east, down = (p + _ARROW_S * v for p, v in zip(place, row.setpoint, strict=True))
    begin = canvas.at(_flat(place, view, side_axis))
    end = canvas.at(_flat((north, east, down), view, side_axis))
    return _arrow(kind, begin, end)


def _arrow(kind: str, begin: Point, end: Point) -> Markup:
    length = math.dist(begin, end)
    if length < 2.0:
        return Markup("")
    ux, uy = (end[0] - begin[0]) / length, (end[1] - begin[1]) / length
    left = (end[0] - 4 * ux - 2.5 * uy, end[1] - 4 * uy + 2.5 * ux)
    right = (end[0] - 4 * ux + 2.5 * uy, end[1] - 4 * uy - 2.5 * ux)
    d = f"M{points_text([begin])} L{points_text([end])}"
    d += f" M{points_text([left])} L{points_text([end])} L{points_text([right])}"
    return svg_element("path", {"class": kind, "d": d})


def _markers(
    tracks: Iterable[VehicleTrack], at_s: float | None, view: View, side_axis: int, canvas: _Canvas
) -> Iterator[Markup]:
    for track in tracks:
        kind = _vehicle_class(track.vehicle)
        if not track.positions_ned_m:
            continue
        x, y = canvas.at(_flat(track.positions_ned_m[0], view, side_axis))
        start = {"class": f"start {kind}", "x": x - 3, "y": y - 3, "width": 6, "height": 6}
        yield svg_element("rect", start, [svg_element("title", {}, [f"start of {track.vehicle}"])])
        place = None if at_s is None else track.at(at_s)
        if place is not None:
            x, y = canvas.at(_flat(place, view, side_axis))
            spot = {"class": f"moment {kind}", "cx": x, "cy": y, "r": 6}
            yield svg_element("circle", spot, [svg_element("title", {}, [f"{track.vehicle} then"])])
        yield svg_element("circle", {"class": f"spot {kind}", "r": 4, "cx": -20, "cy": -20})


def _axis_names(run: RunReport, view: View, canvas: _Canvas) -> Iterator[Markup]:
    right = "east m" if view == "above" else f"{run.world.side_axis} m"
    up = "north m" if view == "above" else "up m"
    yield _text(f"{right} →", (_WIDTH - 4, canvas.height - 8), anchor="end", kind="axis-name")
    yield _text(f"↑ {up}", (4.0, 12.0), anchor="start", kind="axis-name")
