"""Distances over time: to the judged world, to the fence, between the vehicles."""

import bisect
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import itemgetter

from wil_campaign.orchestrator.reading.judged_motion import JudgedMotion
from wil_campaign.orchestrator.report.model import Point
from wil_campaign.orchestrator.report.reading.curves import longest_step_s
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.oracles.contact import CLEAR_AGAIN_M, ContactLimits
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.parts import BoxShape
from wil_campaign.worlds.scene.scene import Scene

SHOWN_WITHIN_M = 2.0
"""Larger clearances are capped at this value."""

_ROUNDING_S = 1e-6
_SWEPT_S = 0.04
"""Time between the poses that the body is swept between; at 10 m/s2 it is 2 mm off its way then."""

TimedPose = tuple[float, Pose]
TimedFences = Sequence[tuple[float, Fence]]
"""Fences of a vehicle, each with the time from which it was in force, oldest first."""


def clearance_values(
    poses: Sequence[TimedPose], body: BoxShape, scene: Scene, motion: JudgedMotion
) -> tuple[Point, ...]:
    """Return the least clearance on each stretch between two poses.

    As `clearance` judges it: the body is swept between the poses, contact is 0, and floors count
    between at_height and land. Here between at most 25 poses in a second.
    """
    probe = ClearanceProbe(scene, body, within_m=SHOWN_WITHIN_M)
    limits = ContactLimits()
    limits.below_m = SHOWN_WITHIN_M
    found: list[Point] = []
    for (begin_s, begin), (end_s, end) in itertools.pairwise(_swept_poses(poses)):
        limits.floors_ignored = motion.near_ground_at(end_s)
        near = probe.sweep(
            begin, begin_s, end, end_s, motion.world_events, below_m=limits, only_least=True
        )
        least_m = min((clearance.clearance_m for clearance in near), default=SHOWN_WITHIN_M)
        found.append((end_s, max(0.0, least_m)))
    return tuple(found)


def _swept_poses(poses: Sequence[TimedPose]) -> Iterator[TimedPose]:
    """Yield the poses that are far enough apart in time, and the last one."""
    due_s = -math.inf
    for t_s, pose in poses[:-1]:
        if t_s >= due_s - _ROUNDING_S:
            due_s = t_s + _SWEPT_S
            yield t_s, pose
    yield from poses[-1:]


def fence_at(fences: Sequence[tuple[float, Fence | None]], t_s: float) -> Fence | None:
    """Return the fence that was in force at a time; None before the first."""
    count = bisect.bisect_right(fences, t_s, key=itemgetter(0))
    return fences[count - 1][1] if count else None


def fence_distance_values(
    poses: Sequence[TimedPose], fences: TimedFences, near_ground_at: Callable[[float], bool]
) -> tuple[Point, ...]:
    """Return the distance to the boundary of the fence of that time, negative outside.

    As the oracle judges: near the ground its floor does not count.
    """
    low = [(t_s, fence.without_floor()) for t_s, fence in fences]
    found = []
    for t_s, pose in poses:
        fence = fence_at(low if near_ground_at(t_s) else fences, t_s)
        if fence is not None and all(map(math.isfinite, pose.position_ned_m)):
            found.append((t_s, fence.margin_m(pose.position_ned_m)))
    return tuple(found)


def height_values(poses: Sequence[TimedPose]) -> tuple[Point, ...]:
    """Return the height over the world's origin."""
    return tuple((t_s, -pose.position_ned_m[2]) for t_s, pose in poses)


def pair_distances(real: Sequence[TimedPose], twin: Sequence[TimedPose]) -> tuple[Point, ...]:
    """Return the distance between the vehicles at the times of real's poses.

    That of the twin is interpolated; where it has no pose, or a gap, there is no distance.
    """
    within_s = longest_step_s([t_s for t_s, _ in twin])
    found = []
    for t_s, pose in real:
        other = pose_at(twin, t_s, within_s=within_s)
        if other is not None:
            found.append((t_s, math.dist(pose.position_ned_m, other.position_ned_m)))
    return tuple(found)


def pose_at(poses: Sequence[TimedPose], t_s: float, *, within_s: float = math.inf) -> Pose | None:
    """Return the interpolated pose at a time; None outside the poses.

    within_s: None also where the poses before and after are farther apart.
    """
    after = bisect.bisect_left(poses, t_s, key=itemgetter(0))
    if after == len(poses) or (after == 0 and poses[0][0] != t_s):
        return None
    if poses[after][0] == t_s:
        return poses[after][1]
    (begin_s, begin), (end_s, end) = poses[after - 1], poses[after]
    if end_s - begin_s > within_s:
        return None
    return begin.interpolate(end, (t_s - begin_s) / (end_s - begin_s))


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
    after = [pose for pose in poses if pose[0] >= touched_s]
    for (begin_s, begin), (end_s, end) in itertools.pairwise(after):
        near = probe.sweep(begin, begin_s, end, end_s, events, only_least=True)
        if min((clearance.clearance_m for clearance in near), default=math.inf) > CLEAR_AGAIN_M:
            return begin_s
    return None
