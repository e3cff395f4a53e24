"""Visibility of virtual objects in mixed scans, beams and point clouds."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wil_campaign.campaigns.values.sensor_setups import (
    OtherSensorSetup,
    SensorSetup,
    sensor_options_of,
)
from wil_campaign.orchestrator.run.perception.expected_views import ExpectedViews
from wil_campaign.orchestrator.run.perception.visibility import (
    ReadingExposure,
    VisibilityComparison,
)
from wil_campaign.plugins.lidar.beams import cone_directions, grid_directions, plane_directions
from wil_campaign.plugins.lidar.lidar_points import POINTS_NOISES, LidarPointsOptions
from wil_campaign.plugins.lidar.rangefinder import RangefinderOptions
from wil_campaign.recipes.visibility.model import ExpectedRanges, FrameVisibility, VirtualObjects
from wil_campaign.recipes.visibility.ranges import (
    LEAST_ELEMENTS,
    ComparedRanges,
    compare_ranges,
    object_visibility,
    range_limits_m,
)
from wil_campaign.vehicles.readings import (
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
)
from wil_campaign.vehicles.sensors.beams import Directions
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.worlds.jit import F64, Int, jit_compiled

_AROUND_RAD = math.radians(2.0)
"""How far outside of a rangefinder's cone a virtual object may be that it shows nevertheless."""
_MOST_BEAMS = 3000
"""Most beams of a 3-D lidar that are cast for the comparison."""


class _ByRays(VisibilityComparison):
    """A comparison with ranges that are cast."""

    def prepare(self, views: ExpectedViews) -> None:
        """Build the tree for rays before the flight: it may take seconds."""
        views.prepare_rays()


class _OfScans(_ByRays):
    def compare(
        self, real: LidarScanReading, mixed: LidarScanReading, at: ReadingExposure
    ) -> FrameVisibility | None:
        """Compare scans beam by beam, where both have as many."""
        if len(real.ranges_m) != len(mixed.ranges_m):
            return None
        directions = plane_directions(mixed.start_angle_rad, mixed.step_rad, len(mixed.ranges_m))
        sensor = at.body.compose(mixed.mount)
        return compare_ranges(
            t_s=at.t_s,
            real_m=real.ranges_m.astype(np.float64),
            mixed_m=mixed.ranges_m.astype(np.float64),
            expected=at.measured.views.ranges(sensor, directions, at.t_s),
            virtual=at.measured.virtual,
            reach_m=(mixed.range_min_m, mixed.range_max_m),
        )


class _OfBeams(_ByRays):
    def compare(
        self, real: RangefinderReading, mixed: RangefinderReading, at: ReadingExposure
    ) -> FrameVisibility | None:
        """Compare ranges of a rangefinder with the nearest surface in its cone."""
        measured = at.measured
        options = sensor_options_of(measured.real, RangefinderOptions)
        half_rad = 0.0 if options is None else options.half_angle_rad
        sensor = at.body.compose(mixed.mount)
        cone = measured.views.ranges(sensor, cone_directions(half_rad, 8), at.t_s)
        around = measured.views.ranges(sensor, cone_directions(half_rad + _AROUND_RAD, 8), at.t_s)
        behind = None if cone.virtual is None else _nearest(cone.virtual)
        return compare_ranges(
            t_s=at.t_s,
            real_m=np.array([real.range_m]),
            mixed_m=np.array([mixed.range_m]),
            expected=replace(_nearest(cone), virtual=behind),
            virtual=measured.virtual,
            reach_m=(mixed.range_min_m, mixed.range_max_m),
            least=1,
            nearest_m=float(around.ranges_m.min()),
        )


def _nearest(cone: ExpectedRanges) -> ExpectedRanges:
    """Return the nearest surface in the beams of a cone."""
    nearest = slice(k := int(cone.ranges_m.argmin()), k + 1)
    return ExpectedRanges(cone.ranges_m[nearest], cone.ids[nearest])


class _OfPoints(_ByRays):
    def obstacle(self, twin: SensorSetup) -> str:
        """Return that points which are made of other readings have no beams to compare with."""
        return (
            "" if twin.kind == "lidar_points" else f"the points are made of a {twin.kind} reading"
        )

    def warm_up(self) -> None:
        """Load the search for the nearest point."""
        nearest_point_distances_m(np.zeros((1, 3)), np.zeros((1, 3), np.float32))

    def compare(
        self, real: LidarPointsReading, mixed: LidarPointsReading, at: ReadingExposure
    ) -> FrameVisibility | None:
        """Compare the points that the mixture has and the real cloud has not."""
        measured = at.measured
        twin = sensor_options_of(measured.twin, LidarPointsOptions)
        if twin is None:
            return None
        directions = _some_beams(twin)
        cast_ranges = measured.views.ranges(at.body.compose(mixed.mount), directions, at.t_s)
        least_m, most_m = lidar_reach_m(measured.twin, measured.noise)
        is_in_reach = (cast_ranges.ranges_m >= least_m) & (cast_ranges.ranges_m <= most_m)
        ids = np.where(is_in_reach, cast_ranges.ids, np.uint8(0))
        met = np.isfinite(cast_ranges.ranges_m)
        return compare_points(
            t_s=at.t_s,
            real_m=real.points_frd_m,
            mixed_m=mixed.points_frd_m,
            expected_m=directions[met] * cast_ranges.ranges_m[met, np.newaxis],
            ids=ids[met],
            virtual=measured.virtual,
        )


SCANS, BEAMS, POINTS = _OfScans(), _OfBeams(), _OfPoints()


def lidar_reach_m(twin: SensorSetup, noise: NoiseSetName) -> tuple[float, float]:
    """Return the least and greatest range, metres, of the twin's 3-D lidar.

    noise: that of the twin's profile. (0, inf) for what the setup leaves out of a lidar with a
    source of its own.
    """
    lidar = sensor_options_of(twin, LidarPointsOptions)
    if lidar is None:
        return 0.0, np.inf
    if isinstance(twin, OtherSensorSetup) and twin.source is None:
        points = lidar.within_reach(POINTS_NOISES.named(noise))
        return points.range_min_m, points.range_max_m
    return lidar.range_min_m or 0.0, np.inf if lidar.range_max_m is None else lidar.range_max_m


def _some_beams(lidar: LidarPointsOptions) -> Directions:
    """Return every n-th column of a 3-D lidar's beams, for measuring visibility."""
    pattern = lidar.pattern
    every = max(1, -(-pattern.columns * pattern.rings // _MOST_BEAMS))
    azimuths = 2.0 * np.pi * np.arange(0, pattern.columns, every) / pattern.columns
    rings = np.linspace(pattern.lowest_rad, pattern.highest_rad, pattern.rings)
    return grid_directions(azimuths, rings)


def compare_points(
    *,
    t_s: float,
    real_m: NDArray[np.float32],
    mixed_m: NDArray[np.float32],
    expected_m: NDArray[np.float64],
    ids: NDArray[np.uint8],
    virtual: VirtualObjects,
) -> FrameVisibility:
    """Return the visibility of virtual objects in a mixed point cloud, by its ranges.

    real_m, mixed_m: (points, 3) in one sensor frame, the real cloud as the merge received it.
    expected_m: (elements, 3), the points expected from geometry, in that frame; ids: (elements,).
    """
    added = _added_points(real_m, mixed_m)
    due = virtual.mask_of(ids)
    distance = np.full(len(expected_m), np.inf)
    if due.any() and len(added):
        distance[due] = nearest_point_distances_m(expected_m[due], added)
    limit = range_limits_m(np.linalg.norm(expected_m, axis=1))
    drawn = np.full(len(expected_m), len(added) >= LEAST_ELEMENTS)
    elements = ComparedRanges(distance, drawn, distance <= limit, limit)
    objects = tuple(
        object_visibility(name, due & (ids == object_id), elements, LEAST_ELEMENTS)
        for object_id, name in virtual.names.items()
    )
    not_mixed = virtual.not_mixed_in(ids, least=LEAST_ELEMENTS)
    changed = len(added) / max(1, len(mixed_m))
    return FrameVisibility(t_s, objects, changed, not_mixed=not_mixed)


def nearest_point_distances_m(
    points_m: NDArray[np.float64], cloud_m: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the distance of each point to the nearest point of a cloud, metres; both (n, 3)."""
    axis = int(np.argmax(np.ptp(cloud_m, axis=0)))
    cloud = cloud_m[np.argsort(cloud_m[:, axis])].astype(np.float64)
    places = np.searchsorted(cloud[:, axis], points_m[:, axis])
    found = np.empty(len(points_m))
    _search_nearest(points_m, cloud, axis, places, found)
    return found


@jit_compiled
def _search_nearest(points: F64, cloud: F64, axis: Int, places: Int, found: F64) -> None:
    """Set the distance of each point to a cloud that is sorted along an axis.

    places: of each point in that order. From there the search goes both ways, until the distance
    along the axis alone is more than the least that was found.
    """
    for index in range(len(points)):
        point = points[index]
        least = np.inf
        for step in (-1, 1):
            place = places[index] + min(step, 0)
            while 0 <= place < len(cloud):
                other = cloud[place]
                if (other[axis] - point[axis]) ** 2 >= least:
                    break
                squared = (point[0] - other[0]) ** 2
                squared += (point[1] - other[1]) ** 2
                squared += (point[2] - other[2]) ** 2
                least = min(least, squared)
                place += step
        found[index] = math.sqrt(least)


def _added_points(real_m: NDArray[np.float32], mixed_m: NDArray[np.float32]) -> NDArray[np.float32]:
    mine = np.ascontiguousarray(mixed_m).view([("", mixed_m.dtype)] * 3).reshape(-1)
    theirs = np.ascontiguousarray(real_m, mixed_m.dtype).view(mine.dtype).reshape(-1)
    return mixed_m[~np.isin(mine, theirs)]
