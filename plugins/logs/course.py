"""The course of a logged flight: its start, waypoints, height, speeds and fence; pure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from wil_campaign.plugins.logs.logged_flight import LoggedFlight, TrackPoint

_FLOWN_M = 0.5
"""From this height above its start on the vehicle flies."""
_ASIDE_M = 0.75
"""A takeoff ends where the vehicle is this far beside its start, or at its greatest height."""
_TOLERANCE_M = 0.3
_MOST_WAYPOINTS = 40
_SLOWEST_M_S, _FASTEST_M_S = 0.3, 12.0
_AROUND_M = 5.0
"""Between the course and its fence."""
_BELOW_M = 2.0
_LOWEST_M = 1.0
_MOST_POINTS = 20_000
_GAP_S = 5.0
_JUMP_M, _JUMP_M_S = 2.0, 40.0
"""No multicopter moves so far, so fast."""
_UNDER_M = 1.0


class CourseWaypoint(NamedTuple):
    """A place of the course, from its start, and the speed of the leg to it."""

    north_m: float
    east_m: float
    up_m: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class FlightCourse:
    """A course in metres from the vehicle's place on the ground before the takeoff.

    start: that place in the log's own frame. yaw_rad: heading there; None where it is unknown.
    altitude_m: at which the takeoff ended. box: north, east and up of a fence around it.
    begin_s: when it left the ground. duration_s: in the air. flights: how many the log has.
    problems: in words, where it is not what was flown.
    """

    start: TrackPoint
    yaw_rad: float | None
    altitude_m: float
    waypoints: tuple[CourseWaypoint, ...]
    box: tuple[tuple[float, float], ...]
    begin_s: float
    duration_s: float
    flights: int
    problems: tuple[str, ...] = ()


def course_of_flight(flight: LoggedFlight) -> FlightCourse | None:
    """Return the course of the longest flight of a log; None where none left the ground."""
    spans = list(_armed_spans(flight)) or [(-math.inf, math.inf)]
    flown = [found for span in spans if (found := _in_the_air(flight.track, span)) is not None]
    if not flown:
        return None
    start, points, landed = max(flown, key=lambda one: one[1][-1].t_s - one[1][0].t_s)
    moved = [_from(start, point) for point in points]
    begin = _end_of_takeoff(moved)
    altitude_m = max(_LOWEST_M, moved[begin].up_m)
    cruise = _simplified(_thinned([*moved[begin:]]))
    under_m = -min(point.up_m - start.up_m for point in (*points, *landed))
    return FlightCourse(
        start=start,
        yaw_rad=start.yaw_rad,
        altitude_m=round(altitude_m, 2),
        waypoints=tuple(_waypoints(cruise)),
        box=_box(moved),
        begin_s=points[0].t_s,
        duration_s=points[-1].t_s - points[0].t_s,
        flights=len(flown),
        problems=(*_breaks(moved), *_unlike(cruise, under_m)),
    )


def _breaks(points: Sequence[TrackPoint]) -> Iterator[str]:
    """Yield where a track in the air has no positions, or positions that nothing flies to."""
    gaps_s = [b.t_s - a.t_s for a, b in pairwise(points) if b.t_s - a.t_s > _GAP_S]
    if gaps_s:
        yield (
            f"gaps in its positions in the air: {len(gaps_s)}, of up to {max(gaps_s):.1f} s, or "
            "its clock jumped: the course goes straight across"
        )
    jumps_m = [
        length_m
        for a, b in pairwise(points)
        if (length_m := math.dist(a[1:4], b[1:4])) > _JUMP_M
        and length_m > _JUMP_M_S * (b.t_s - a.t_s)
    ]
    if jumps_m:
        yield (
            f"jumps of its position: {len(jumps_m)}, of up to {max(jumps_m):.1f} m, as where an "
            "estimator starts anew: the course has them"
        )


def _unlike(cruise: Sequence[TrackPoint], under_m: float) -> Iterator[str]:
    """Yield where the waypoints of a track are other ones. under_m: how deep below its start."""
    fastest_m_s = max(_speeds(cruise), default=0.0)
    if fastest_m_s > _FASTEST_M_S:
        yield f"legs of up to {fastest_m_s:.1f} m/s are flown at {_FASTEST_M_S:g} m/s"
    if under_m > _UNDER_M:
        yield (
            f"it flew down to {under_m:.1f} m below its start: what is lower than {_LOWEST_M:g} m "
            f"above it is flown there, and it ends where it was last {_FLOWN_M:g} m above it"
        )


def _speeds(points: Sequence[TrackPoint]) -> Iterator[float]:
    for before, after in pairwise(points):
        yield math.dist(before[1:4], after[1:4]) / max(1e-3, after.t_s - before.t_s)


def _armed_spans(flight: LoggedFlight) -> Iterator[tuple[float, float]]:
    since: float | None = None
    for t_s, armed in flight.armed:
        if armed and since is None:
            since = t_s
        elif not armed and since is not None:
            yield since, t_s
            since = None
    if since is not None:
        yield since, math.inf


def _in_the_air(
    track: Sequence[TrackPoint], span: tuple[float, float]
) -> tuple[TrackPoint, list[TrackPoint], list[TrackPoint]] | None:
    """Return where the vehicle stood, its track in the air and after it; None without a flight."""
    points = [track_point for track_point in track if span[0] <= track_point.t_s <= span[1]]
    if not points:
        return None
    start = points[0]
    if start.yaw_rad is None:
        known = (point.yaw_rad for point in points if point.yaw_rad is not None)
        start = start._replace(yaw_rad=next(known, None))
    flies = [index for index, point in enumerate(points) if point.up_m - start.up_m > _FLOWN_M]
    if len(flies) < 2:
        return None
    return start, points[flies[0] : flies[-1] + 1], points[flies[-1] + 1 :]


def _from(start: TrackPoint, one: TrackPoint) -> TrackPoint:
    return one._replace(
        north_m=one.north_m - start.north_m,
        east_m=one.east_m - start.east_m,
        up_m=one.up_m - start.up_m,
    )


def _end_of_takeoff(points: Sequence[TrackPoint]) -> int:
    first = points[0]
    for index, point in enumerate(points):
        if math.hypot(point.north_m - first.north_m, point.east_m - first.east_m) > _ASIDE_M:
            return index
    return max(range(len(points)), key=lambda index: points[index].up_m)


def _thinned(points: list[TrackPoint]) -> list[TrackPoint]:
    """Return at most so many points that simplifying them takes a second."""
    every = -(-len(points) // _MOST_POINTS)
    return [*points[::every], points[-1]]


def _simplified(points: Sequence[TrackPoint]) -> list[TrackPoint]:
    """Return few of the points that tell the course, by a tolerance as small as that permits."""
    tolerance_m = _TOLERANCE_M
    while len(found := _peucker(points, tolerance_m)) > _MOST_WAYPOINTS:
        tolerance_m *= 1.5
    return found


def _peucker(points: Sequence[TrackPoint], tolerance_m: float) -> list[TrackPoint]:
    """Return the points from whose lines no other one is farther away (Ramer, Douglas, Peucker)."""
    kept = {0, len(points) - 1}
    pending = [(0, len(points) - 1)]
    while pending:
        begin, end = pending.pop()
        far_m, far = 0.0, -1
        for index in range(begin + 1, end):
            away_m = _distance(points[index], points[begin], points[end])
            if away_m > far_m:
                far_m, far = away_m, index
        if far_m > tolerance_m:
            kept.add(far)
            pending += [(begin, far), (far, end)]
    return [points[index] for index in sorted(kept)]


def _distance(one: TrackPoint, begin: TrackPoint, end: TrackPoint) -> float:
    """Return the distance of a point from a line's stretch, in metres."""
    a = (begin.north_m, begin.east_m, begin.up_m)
    along = (end.north_m - a[0], end.east_m - a[1], end.up_m - a[2])
    to = (one.north_m - a[0], one.east_m - a[1], one.up_m - a[2])
    length2 = sum(value * value for value in along)
    share = 0.0 if length2 == 0.0 else sum(x * y for x, y in zip(to, along, strict=True)) / length2
    share = min(1.0, max(0.0, share))
    return math.dist(to, tuple(share * value for value in along))


def _waypoints(points: Sequence[TrackPoint]) -> Iterator[CourseWaypoint]:
    for flown_m_s, track_point in zip(_speeds(points), points[1:], strict=True):
        speed_m_s = min(_FASTEST_M_S, max(_SLOWEST_M_S, flown_m_s))
        up_m = max(_LOWEST_M, track_point.up_m)
        yield CourseWaypoint(
            *(round(x, 2) for x in (track_point.north_m, track_point.east_m, up_m, speed_m_s))
        )


def _box(points: Sequence[TrackPoint]) -> tuple[tuple[float, float], ...]:
    """Return north, east and up of a box around a course; the start is inside."""
    norths = [0.0, *(point.north_m for point in points)]
    easts = [0.0, *(point.east_m for point in points)]
    top_m = max(point.up_m for point in points)
    return (
        (math.floor(min(norths) - _AROUND_M), math.ceil(max(norths) + _AROUND_M)),
        (math.floor(min(easts) - _AROUND_M), math.ceil(max(easts) + _AROUND_M)),
        (-_BELOW_M, math.ceil(top_m + _AROUND_M)),
    )
