"""Distances over time: to the judged world, to the fence, between the vehicles."""

import bisect
import itertools
import math
from collections.abc import Mapping, Sequence
from operator import itemgetter

from orchestrator.report.model import Point
from safety.fence.geofence import Fence
from safety.oracles.contact import CLEAR_AGAIN_M
from worlds.clearance.clearance import ClearanceProbe
from worlds.frames import Pose
from worlds.scene.parts import BoxShape
from worlds.scene.scene import Scene

SHOWN_WITHIN_M = 2.0
"""Larger clearances are capped at this value."""

_EVERY = 2
"""Poses of a track per sweep; a sweep covers all that is between two poses."""

TimedPose = tuple[float, Pose]
TimedFences = Sequence[tuple[float, Fence]]
"""Fences of a vehicle, each with the time from which it was in force, oldest first."""


def clearances(
    poses: Sequence[TimedPose], body: BoxShape, scene: Scene, events: Mapping[str, float]
) -> tuple[Point, ...]:
    """Return the least clearance on each stretch between two poses, floors left out.

    As `collision` judges it: the body is swept between the poses, and contact is 0.
    """
    probe = ClearanceProbe(scene, body, floors=False, within_m=SHOWN_WITHIN_M)
    found: list[Point] = []
    for (begin_s, begin), (end_s, end) in itertools.pairwise(poses[::_EVERY]):
        near = probe.sweep(begin, begin_s, end, end_s, events, only_least=True)
        least_m = min((one.clearance_m for one in near), default=SHOWN_WITHIN_M)
        found.append((end_s, max(0.0, least_m)))
    return tuple(found)


def fence_at(fences: TimedFences, t_s: float) -> Fence | None:
    """Return the fence that was in force at a time; None before the first."""
    count = bisect.bisect_right(fences, t_s, key=itemgetter(0))
    return fences[count - 1][1] if count else None


def fence_margins(poses: Sequence[TimedPose], fences: TimedFences) -> tuple[Point, ...]:
    """Return the distance to the boundary of the fence of that time, negative outside."""
    return tuple(
        (t_s, fence.margin_m(pose.position_ned_m))
        for t_s, pose in poses
        if all(map(math.isfinite, pose.position_ned_m))
        and (fence := fence_at(fences, t_s)) is not None
    )


def heights(poses: Sequence[TimedPose]) -> tuple[Point, ...]:
    """Return the height over the world's origin."""
    return tuple((t_s, -pose.position_ned_m[2]) for t_s, pose in poses)


def separations(real: Sequence[TimedPose], twin: Sequence[TimedPose]) -> tuple[Point, ...]:
    """Return the distance between the vehicles at equal indexes."""
    return tuple(
        (t_s, math.dist(a.position_ned_m, b.position_ned_m))
        for (t_s, a), (_, b) in zip(real, twin, strict=False)
    )


def contact_until_s(
    poses: Sequence[TimedPose],
    body: BoxShape,
    scene: Scene,
    events: Mapping[str, float],
    touched_s: float,
) -> float | None:
    """Return the end of a contact that began at touched_s; None if it did not end.

    As for `collision`, a contact ends when the clearance exceeds 2 cm. Floors are left out.
    """
    probe = ClearanceProbe(scene, body, floors=False, within_m=2.0 * CLEAR_AGAIN_M)
    after = [one for one in poses if one[0] >= touched_s]
    for (begin_s, begin), (end_s, end) in itertools.pairwise(after):
        near = probe.sweep(begin, begin_s, end, end_s, events, only_least=True)
        if min((one.clearance_m for one in near), default=math.inf) > CLEAR_AGAIN_M:
            return begin_s
    return None
