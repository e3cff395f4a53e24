"""Warnings of `validate`: limits of oracles and gates that no flight of a case exceeds; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.documents import Document, Path, Problem
from wil_campaign.safety.fence.fence_schema import FencePart
from wil_campaign.safety.oracles.area import AltitudeParameters, AreaParameters
from wil_campaign.safety.oracles.limit_oracle import BandParameters
from wil_campaign.safety.oracles.vehicle_health import LinkParameters
from wil_campaign.worlds.scene.scene import Scene

_PER_ROOM = 10.0
_WIDE_M = 100.0
"""An area that exceeds both, the room's width so many times and this width, limits nothing; it was
probably typed in another unit."""


def limit_warnings(file: Document, case: Case) -> Iterator[Problem]:
    """Yield warnings for limits that no flight exceeds, in whatever mode and world."""
    sync = case.sync
    longest_s = sync.takeoff_timeout_s + sync.goal_timeout_s + sync.landing_timeout_s
    for use in case.oracles:
        path: Path = ("oracles", use.name)
        given = use.parameters
        if isinstance(given, BandParameters) and not isinstance(given, AltitudeParameters):
            if given.low == 0.0 and given.high is None:
                yield file.problem(path, "nothing is less than 0: it cannot fail", key=True)
        elif isinstance(given, LinkParameters) and given.max_gap_s >= longest_s:
            message = f"the time-outs of `sync` end each flight after {longest_s:g} s"
            yield file.problem((*path, "max_gap_s"), f"{message}: it cannot fail")


def room_warnings(file: Document, case: Case, scene: Scene) -> Iterator[Problem]:
    """Yield warnings for limits of place that are beyond the room of a judged world."""
    for use in case.oracles:
        given = use.parameters
        if isinstance(given, AltitudeParameters) and given.max_m is not None:
            ceiling_m = _ceiling_m(scene)
            if ceiling_m is not None and given.max_m >= ceiling_m:
                message = f"the ceiling is {ceiling_m:g} m up: it cannot fail below that"
                yield file.problem(("oracles", use.name, "max_m"), message)
        elif isinstance(given, AreaParameters):
            yield from _wide_area(file, ("oracles", use.name, "keep"), given.keep, scene)


def _wide_area(file: Document, path: Path, keep: FencePart, scene: Scene) -> Iterator[Problem]:
    """Yield a warning for an area's box in metres that is far wider than the room."""
    room_m = max((max(size) for size, _ in room_sizes(scene)), default=None)
    if room_m is None or keep.box is None or keep.box.north_m is None or keep.box.east_m is None:
        return
    wide_m = max(high - low for low, high in (keep.box.north_m, keep.box.east_m))
    if exceeds_room(wide_m, room_m):
        message = f"the area is {wide_m:g} m wide, and the room {room_m:g} m: it cannot fail"
        yield file.problem((*path, "box"), message, key=True)


def exceeds_room(wide_m: float, room_m: float) -> bool:
    """Return whether an area is so much wider than the room that it limits nothing."""
    return wide_m > max(_WIDE_M, _PER_ROOM * room_m)


def _ceiling_m(scene: Scene) -> float | None:
    """Return how high the highest room's ceiling limits flight; None where one has no ceiling."""
    heights = [height_m for _, height_m in room_sizes(scene)]
    if not heights or any(height_m is None for height_m in heights):
        return None
    return max(height_m for height_m in heights if height_m is not None)


def room_sizes(scene: Scene) -> Iterator[tuple[tuple[float, float], float | None]]:
    """Yield north and east size of each room, and how far up its ceiling limits flight, if any."""
    for thing in scene.objects:
        if thing.is_room:
            vertices_m = thing.shape.mesh.vertices_m
            low, high = vertices_m.min(axis=0), vertices_m.max(axis=0)
            ceiled = any(part.name == "ceiling" for part in thing.shape.parts)
            up_m = float(-thing.pose.position_ned_m[2] + high[2] - low[2])
            size_m = (float(high[0] - low[0]), float(high[1] - low[1]))
            yield size_m, up_m if ceiled else None
