"""The plan of a run: world, fence and paths from above, north up, drawn on a sheet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from wil_campaign.orchestrator.report.model import Point, RunReport, VehicleTrack
from wil_campaign.plugins.run_images.drawing import (
    CARD,
    DIM,
    FENCE,
    RULE,
    SUBJECTS,
    DrawingSheet,
)
from wil_campaign.safety.fence.areas import Circle
from wil_campaign.worlds.frames import Vec3

_PAD_M = 0.4
_REACH = 3.0
_DASH_PX = 5.0


@dataclass(frozen=True, slots=True)
class PlanBox:
    """Where a plan is drawn; pixels."""

    left: float
    top: float
    width: float
    height: float


@dataclass(frozen=True, slots=True)
class _Scale:
    """Maps metres (east, north) to pixels."""

    middle: Point
    scale: float
    width: float
    height: float

    def at(self, point: Point) -> Point:
        x = self.width / 2.0 + (point[0] - self.middle[0]) * self.scale
        y = self.height / 2.0 - (point[1] - self.middle[1]) * self.scale
        return (x, y)


def draw_plan(
    sheet: DrawingSheet, run: RunReport, box: PlanBox, *, until_s: float | None = None
) -> None:
    """Draw the plan. until_s: draw the paths up to a time; None draws all, with the moment."""
    plan = DrawingSheet(round(box.width), round(box.height))
    plan.pen.rectangle((0, 0, plan.width - 1, plan.height - 1), CARD, RULE)
    scale = _scale(run, plan)
    if scale is not None:
        _draw_scene(plan, run, scale, until_s)
    sheet.image.paste(plan.image, (round(box.left), round(box.top)))


def _draw_scene(
    sheet: DrawingSheet, run: RunReport, scale: "_Scale", until_s: float | None
) -> None:
    for area in (area for fence in run.world.fences.values() for area in fence.inclusions):
        corners = _circle(area) if isinstance(area, Circle) else _flipped(area.corners_m)
        _dashed(sheet, [scale.at(p) for p in corners])
    for outline in run.world.outlines:
        for polygon in outline.above_m:
            corners = [scale.at(p) for p in polygon]
            fill = None if outline.is_room else outline.rgb
            if len(corners) > 2:
                sheet.pen.polygon(corners, fill, DIM)
            else:
                sheet.pen.line(corners, fill or DIM, 1)
    at_s = until_s if until_s is not None else None if run.moment is None else run.moment.t_s
    for track in run.tracks:
        _draw_track(sheet, track, scale, until_s, at_s)


def _draw_track(
    sheet: DrawingSheet,
    track: VehicleTrack,
    scale: _Scale,
    until_s: float | None,
    at_s: float | None,
) -> None:
    colour = SUBJECTS.get(track.vehicle, DIM)
    places = track.positions_ned_m
    if until_s is not None:
        places = places[: max(1, int((until_s - track.begin_s) / track.step_s) + 1)]
    line = [scale.at(_flat(p)) for p in places]
    if len(line) > 1:
        sheet.pen.line(line, colour, 2, joint="curve")
    place = None if at_s is None else track.at(at_s)
    if place is not None:
        x, y = scale.at(_flat(place))
        sheet.pen.ellipse((x - 5, y - 5, x + 5, y + 5), colour, CARD, 1)


def _scale(run: RunReport, sheet: DrawingSheet) -> _Scale | None:
    path = [_flat(p) for track in run.tracks for p in track.positions_ned_m]
    if not path:
        return None
    low, high = _bounds(path)
    reach = [_REACH * max(high[axis] - low[axis], 1.0) for axis in (0, 1)]
    near = [
        p
        for outline in run.world.outlines
        if not outline.is_room
        for polygon in outline.above_m
        for p in polygon
        if all(low[axis] - reach[axis] <= p[axis] <= high[axis] + reach[axis] for axis in (0, 1))
    ]
    low, high = _bounds([*path, *near])
    spans = [high[axis] - low[axis] + 2.0 * _PAD_M for axis in (0, 1)]
    middle = ((low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0)
    scale = min(sheet.width / spans[0], sheet.height / spans[1])
    return _Scale(middle, scale, sheet.width, sheet.height)


def _bounds(points: Sequence[Point]) -> tuple[Point, Point]:
    xs, ys = [p[0] for p in points], [p[1] for p in points]
    return (min(xs), min(ys)), (max(xs), max(ys))


def _flat(position_ned_m: Vec3) -> Point:
    return (position_ned_m[1], position_ned_m[0])


def _flipped(corners: Sequence[Point]) -> list[Point]:
    return [(east, north) for north, east in corners]


def _circle(area: Circle) -> list[Point]:
    north, east = area.centre_m
    r = area.radius_m
    return [(east - r, north), (east, north + r), (east + r, north), (east, north - r)]


def _dashed(sheet: DrawingSheet, corners: Sequence[Point]) -> None:
    for begin, end in zip(corners, [*corners[1:], corners[0]], strict=True):
        for dash in _dashes(begin, end):
            sheet.pen.line(dash, FENCE, 1)


def _dashes(begin: Point, end: Point) -> Iterator[tuple[Point, Point]]:
    length = max(abs(end[0] - begin[0]), abs(end[1] - begin[1]), 1e-9)
    count = min(400, int(length / (2.0 * _DASH_PX)) + 1)
    for k in range(count):
        shares = ((2 * k) / (2 * count), (2 * k + 1) / (2 * count))
        a, b = (
            (begin[0] + s * (end[0] - begin[0]), begin[1] + s * (end[1] - begin[1])) for s in shares
        )
        yield a, b
