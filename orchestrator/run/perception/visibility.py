"""Measures in flight whether mixtures show the virtual objects where geometry has them."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup, options_of
from wil_campaign.campaigns.values.sensor_setups import SensorSetup as Setup
from wil_campaign.orchestrator.run.perception.expected_views import ExpectedViews
from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.recipes.pipeline.mixture import Mixed
from wil_campaign.recipes.pipeline.stages import StageView
from wil_campaign.recipes.steps.transform.geometry import CameraModelParameters
from wil_campaign.recipes.visibility.coverage import Coverage
from wil_campaign.recipes.visibility.images import IN_VIEW_SHARE, ImagePair, compare_images
from wil_campaign.recipes.visibility.model import ExpectedRanges, FrameVisibility, Virtual
from wil_campaign.recipes.visibility.ranges import compare_points, compare_ranges
from wil_campaign.recipes.visibility.sampling import samples_of
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
    Reading,
)
from wil_campaign.vehicles.sensors.beams import (
    Directions,
    cone_directions,
    grid_directions,
    plane_directions,
)
from wil_campaign.vehicles.sensors.lidar import LidarPointsOptions, RangefinderOptions
from wil_campaign.worlds.frames import IDENTITY, Pose, Quat, quat_multiply

PERIOD_S = 0.2
"""Period of measuring; after a wrong mixture the next one is measured too, to confirm it."""
_EARLY_S = 1e-6
_AROUND_RAD = math.radians(2.0)
"""How far outside of a rangefinder's cone a virtual object may be that it shows nevertheless."""
_MOST_BEAMS = 3000
"""Most beams of a 3-D lidar that are cast for the comparison."""

BodyPose = Callable[[float], Pose | None]
"""Returns the real vehicle's pose at a time (run clock), by the best reference available."""


class MixtureViews:
    """Stores the steps' outputs of one combination's last mixture; its mixer's observer."""

    def __init__(self) -> None:
        self.views: list[StageView] = []

    def __call__(self, view: StageView) -> None:
        """Store a step's output of the mixture."""
        self.views.append(view)

    def clear(self) -> None:
        """Clear the stored outputs."""
        self.views.clear()

    def merged_real(self) -> Reading | None:
        """Return the real reading as it was merged; None when nothing was."""
        if not self.views or self.views[-1].side is not None:
            return None
        readings = [view.work.reading for view in self.views if view.side == "real"]
        return readings[-1] if readings else None

    def emptied_by(self) -> str:
        """Return the first step that left nothing of the twin visible; "" for none."""
        for view in self.views:
            mask = view.work.mask
            if view.side == "twin" and mask is not None and not mask.any():
                return view.name
        return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The parts by which one combination's visibility is measured.

    real, twin: the sensors. body: reference of the real vehicle's pose. is_like: whether the twin's
    images come from the renderer of the expected views. is_judged: whether mixtures count now, as
    they do while the goal is flown. reach_m: least and greatest range of the twin's depth camera or
    3-D lidar; readings of other sensors have their own.
    """

    combination: Combination
    real: Setup
    twin: Setup
    virtual: Virtual
    views: ExpectedViews
    body: BodyPose
    is_like: bool
    is_judged: Callable[[], bool]
    reach_m: tuple[float, float]


class VisibilityProbe:
    """Measures the visibility of virtual objects in one combination's mixtures."""

    def __init__(self, measured: Measured, *, views: MixtureViews) -> None:
        self._measured = measured
        self._views = views
        self._turn = _turn_of(measured.combination)
        self._due_s = 0.0
        self.coverage = Coverage()

    def begin(self) -> None:
        """Prepare the visibility probe for a mixture."""
        self._views.clear()

    def measure(self, mixed: Mixed[Reading]) -> FrameVisibility | None:
        """Return the visibility in a mixture made since `begin`; None if unmeasured."""
        t_s = mixed.provenance.real_t_s
        if mixed.reading is None or t_s is None or not self._measured.is_judged():
            return None
        if not self._is_due(t_s):
            return None
        real, body = self._views.merged_real(), self._measured.body(t_s)
        if real is None:
            return FrameVisibility(t_s, not_measured="nothing was merged")
        if body is None:
            return FrameVisibility(t_s, not_measured="no reference pose of the exposure")
        return self._compare(real, mixed.reading, body, t_s)

    def why_nothing(self) -> str:
        """Return what the recipe did to an invisible object; "" when unknown."""
        name = self._views.emptied_by()
        return f" ({name} kept nothing)" if name else ""

    def _is_due(self, t_s: float) -> bool:
        if t_s < self._due_s - _EARLY_S and not self.coverage.is_suspect():
            return False
        self._due_s = t_s + PERIOD_S
        return True

    def _compare(self, real: Reading, mixed: Reading, body: Pose, t_s: float) -> FrameVisibility:
        match real, mixed:
            case CameraReading(), CameraReading() if real.image_bgr.shape == mixed.image_bgr.shape:
                return self._camera(real, mixed, body, t_s)
            case DepthReading(), DepthReading() if real.depth_m.shape == mixed.depth_m.shape:
                return self._depth(real, mixed, body, t_s)
            case LidarScanReading(), LidarScanReading() if len(real.ranges_m) == len(
                mixed.ranges_m
            ):
                return self._scan(real, mixed, body, t_s)
            case RangefinderReading(), RangefinderReading():
                return self._beam(real, mixed, body, t_s)
            case LidarPointsReading(), LidarPointsReading() if lidar := options_of(
                self._measured.twin, LidarPointsOptions
            ):
                return self._points(real, mixed, lidar, body, t_s)
        return FrameVisibility(t_s, not_measured="the merge changes the shape of the reading")

    def _camera(
        self, real: CameraReading, mixed: CameraReading, body: Pose, t_s: float
    ) -> FrameVisibility:
        part, measured = samples_of(mixed.intrinsics), self._measured
        depth_m = None if real.depth_m is None else real.depth_m[part, part]
        expected = measured.views.image(
            self._camera_pose(body),
            mixed.intrinsics,
            t_s,
            virtual=measured.virtual.everything(),
            real_depth_m=depth_m,
        )
        return compare_images(
            ImagePair(
                t_s=t_s,
                real_bgr=real.image_bgr[part, part],
                mixed_bgr=mixed.image_bgr[part, part],
                expected=expected,
                virtual=measured.virtual,
                limit_px=measured.combination.budget.max_registration_error_px,
                is_like=measured.is_like,
            )
        )

    def _depth(
        self, real: DepthReading, mixed: DepthReading, body: Pose, t_s: float
    ) -> FrameVisibility:
        part, measured = samples_of(mixed.intrinsics), self._measured
        expected = measured.views.depths(self._camera_pose(body), mixed.intrinsics, t_s)
        return compare_ranges(
            t_s=t_s,
            real_m=real.depth_m[part, part].reshape(-1).astype(np.float64),
            mixed_m=mixed.depth_m[part, part].reshape(-1).astype(np.float64),
            expected=expected,
            virtual=measured.virtual,
            reach_m=measured.reach_m,
            least=IN_VIEW_SHARE * expected.ids.size,
        )

    def _scan(
        self, real: LidarScanReading, mixed: LidarScanReading, body: Pose, t_s: float
    ) -> FrameVisibility:
        directions = plane_directions(mixed.start_angle_rad, mixed.step_rad, len(mixed.ranges_m))
        sensor = body.compose(mixed.mount)
        return compare_ranges(
            t_s=t_s,
            real_m=real.ranges_m.astype(np.float64),
            mixed_m=mixed.ranges_m.astype(np.float64),
            expected=self._measured.views.ranges(sensor, directions, t_s),
            virtual=self._measured.virtual,
            reach_m=(mixed.range_min_m, mixed.range_max_m),
        )

    def _beam(
        self, real: RangefinderReading, mixed: RangefinderReading, body: Pose, t_s: float
    ) -> FrameVisibility:
        options = options_of(self._measured.real, RangefinderOptions)
        half_rad = 0.0 if options is None else options.half_angle_rad
        sensor = body.compose(mixed.mount)
        cone = self._measured.views.ranges(sensor, cone_directions(half_rad, 8), t_s)
        around = self._measured.views.ranges(
            sensor, cone_directions(half_rad + _AROUND_RAD, 8), t_s
        )
        nearest = slice(k := int(cone.ranges_m.argmin()), k + 1)
        return compare_ranges(
            t_s=t_s,
            real_m=np.array([real.range_m]),
            mixed_m=np.array([mixed.range_m]),
            expected=ExpectedRanges(cone.ranges_m[nearest], cone.ids[nearest]),
            virtual=self._measured.virtual,
            reach_m=(mixed.range_min_m, mixed.range_max_m),
            least=1,
            nearest_m=float(around.ranges_m.min()),
        )

    def _points(
        self,
        real: LidarPointsReading,
        mixed: LidarPointsReading,
        twin: LidarPointsOptions,
        body: Pose,
        t_s: float,
    ) -> FrameVisibility:
        directions = _some_beams(twin)
        cast_ranges = self._measured.views.ranges(body.compose(mixed.mount), directions, t_s)
        least_m, most_m = self._measured.reach_m
        is_in_reach = (cast_ranges.ranges_m >= least_m) & (cast_ranges.ranges_m <= most_m)
        ids = np.where(is_in_reach, cast_ranges.ids, np.uint8(0))
        met = np.isfinite(cast_ranges.ranges_m)
        return compare_points(
            t_s=t_s,
            real_m=real.points_frd_m,
            mixed_m=mixed.points_frd_m,
            expected_m=directions[met] * cast_ranges.ranges_m[met, np.newaxis],
            ids=ids[met],
            virtual=self._measured.virtual,
        )

    def _camera_pose(self, body: Pose) -> Pose:
        camera = self._measured.real
        if not isinstance(camera, CameraSetup | DepthSetup):
            raise TypeError(f"sensor {camera.name} is not a camera")
        pose = camera.mount.camera_pose(body)
        return Pose(pose.position_ned_m, quat_multiply(pose.q_wxyz, self._turn))


def _some_beams(lidar: LidarPointsOptions) -> Directions:
    """Return every n-th column of a 3-D lidar's beams, for measuring visibility."""
    pattern = lidar.pattern
    every = max(1, -(-pattern.columns * pattern.rings // _MOST_BEAMS))
    azimuths = 2.0 * np.pi * np.arange(0, pattern.columns, every) / pattern.columns
    rings = np.linspace(pattern.lowest_rad, pattern.highest_rad, pattern.rings)
    return grid_directions(azimuths, rings)


def _turn_of(combination: Combination) -> Quat:
    """Return how the recipe turns the real camera's view, for the visibility probe."""
    turn = IDENTITY
    for step in combination.steps:
        parameters = step.parameters
        if isinstance(parameters, CameraModelParameters) and "real" in parameters.sides():
            turn = quat_multiply(turn, parameters.turn.quaternion())
    return turn
