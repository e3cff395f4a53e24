"""Measures in flight whether mixtures show the virtual objects where geometry has them."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup
from wil_campaign.campaigns.values.sensor_setups import SensorSetup as Setup
from wil_campaign.installed_plugins import load_plugin_object
from wil_campaign.orchestrator.run.perception.expected_views import ExpectedViews
from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.recipes.pipeline.mixture import MixedReading
from wil_campaign.recipes.pipeline.stages import StageView
from wil_campaign.recipes.steps.transform.geometry import CameraModelParameters
from wil_campaign.recipes.visibility.coverage import VisibilityCoverage
from wil_campaign.recipes.visibility.images import IN_VIEW_SHARE, ImagePair, compare_images
from wil_campaign.recipes.visibility.model import FrameVisibility, VirtualObjects
from wil_campaign.recipes.visibility.ranges import compare_ranges
from wil_campaign.recipes.visibility.sampling import image_samples_of
from wil_campaign.vehicles.readings import Reading
from wil_campaign.vehicles.readings.kinds import traits_named
from wil_campaign.vehicles.sensors.depth import DEPTH_NOISES
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.worlds.frames import IDENTITY, Pose, Quat, quat_multiply

_SHORTEST_S, _LONGEST_S = 0.05, 0.2
"""Time from one mixture that is due to the next. After a wrong one the next is measured too, to
confirm it; that postpones nothing, so that no mixture changes when others are due."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_EARLY_S = 1e-6

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
class VisibilityMeasurement:
    """The parts by which one combination's visibility is measured.

    real, twin: the sensors. body: reference of the real vehicle's pose. is_like: whether the twin's
    images come from the renderer of the expected views. is_judged: whether mixtures count now, as
    they do while the goal is flown. noise: of the twin's sensors, by its profile.
    """

    combination: Combination
    real: Setup
    twin: Setup
    virtual: VirtualObjects
    views: ExpectedViews
    body: BodyPose
    is_like: bool
    is_judged: Callable[[], bool]
    noise: NoiseSetName


@dataclass(frozen=True, slots=True)
class ReadingExposure:
    """A moment at which readings were sampled. t_s: run clock. body: the real vehicle's pose."""

    t_s: float
    body: Pose
    measured: VisibilityMeasurement


class VisibilityProbe:
    """Measures the visibility of virtual objects in one combination's mixtures."""

    def __init__(
        self,
        measured: VisibilityMeasurement,
        *,
        comparison: "VisibilityComparison",
        views: MixtureViews,
    ) -> None:
        self._measured = measured
        self._comparison = comparison
        self._views = views
        self._due_s = 0.0
        self._count = 0
        self.coverage = VisibilityCoverage()

    def begin(self) -> None:
        """Prepare the visibility probe for a mixture."""
        self._views.clear()

    def measure(self, mixed: MixedReading[Reading]) -> FrameVisibility | None:
        """Return the visibility in a mixture made since `begin`; None if unmeasured."""
        t_s = mixed.provenance.real_t_s
        if mixed.reading is None or t_s is None or not self._measured.is_judged():
            return None
        is_early = t_s < self._due_s - _EARLY_S
        if is_early and not self.coverage.is_suspect():
            return None
        if not is_early:
            self._due_s = t_s + _waiting_s(self._count)
            self._count += 1
        real, body = self._views.merged_real(), self._measured.body(t_s)
        if real is None:
            return FrameVisibility(t_s, not_measured="nothing was merged")
        if body is None:
            return FrameVisibility(t_s, not_measured="no reference pose of the exposure")
        compared = self._compare(real, mixed.reading, body, t_s)
        return replace(compared, confirms=True) if is_early else compared

    def why_nothing(self) -> str:
        """Return what the recipe did to an invisible object; "" when unknown."""
        name = self._views.emptied_by()
        return f" ({name} kept nothing)" if name else ""

    def _compare(self, real: Reading, mixed: Reading, body: Pose, t_s: float) -> FrameVisibility:
        compared = None
        if type(real) is type(mixed):
            at = ReadingExposure(t_s, body, self._measured)
            compared = self._comparison.compare(real, mixed, at)
        missing = "the merge changes the shape of the reading"
        return FrameVisibility(t_s, not_measured=missing) if compared is None else compared


class VisibilityComparison(ABC):
    """How mixtures of one class of readings are compared with what geometry expects of them."""

    def obstacle(self, twin: Setup) -> str:
        """Return why mixtures of readings of this sensor of the twin cannot be compared; or ""."""
        del twin
        return ""

    def prepare(self, views: ExpectedViews) -> None:
        """Prepare the expected views before the flight, where their first use takes long."""
        del views

    def warm_up(self) -> None:
        """Load or compile the kernels that the comparison takes, before the flight."""
        return

    @abstractmethod
    def compare(self, real: Any, mixed: Any, at: ReadingExposure) -> FrameVisibility | None:
        """Return the visibility in a mixture; None where the merge changed the reading's shape.

        real: the real reading as it was merged.
        """


class _OfCameras(VisibilityComparison):
    def compare(self, real: Any, mixed: Any, at: ReadingExposure) -> FrameVisibility | None:
        """Compare camera images, where both have one size."""
        if real.image_bgr.shape != mixed.image_bgr.shape:
            return None
        part, measured = image_samples_of(mixed.intrinsics), at.measured
        depth_m = None if real.depth_m is None else real.depth_m[part, part]
        expected = measured.views.image(
            _camera_pose(at),
            mixed.intrinsics,
            at.t_s,
            virtual=measured.virtual.everything(),
            real_depth_m=depth_m,
        )
        return compare_images(
            ImagePair(
                t_s=at.t_s,
                real_bgr=real.image_bgr[part, part],
                mixed_bgr=mixed.image_bgr[part, part],
                expected=expected,
                virtual=measured.virtual,
                limit_px=measured.combination.budget.max_registration_error_px,
                is_like=measured.is_like,
            )
        )


class _OfDepthCameras(VisibilityComparison):
    def compare(self, real: Any, mixed: Any, at: ReadingExposure) -> FrameVisibility | None:
        """Compare depth images, where both have one size."""
        if real.depth_m.shape != mixed.depth_m.shape:
            return None
        part, measured = image_samples_of(mixed.intrinsics), at.measured
        expected = measured.views.depths(_camera_pose(at), mixed.intrinsics, at.t_s)
        noise = DEPTH_NOISES.named(measured.noise)
        return compare_ranges(
            t_s=at.t_s,
            real_m=real.depth_m[part, part].reshape(-1).astype(np.float64),
            mixed_m=mixed.depth_m[part, part].reshape(-1).astype(np.float64),
            expected=expected,
            virtual=measured.virtual,
            reach_m=(noise.range_min_m, noise.range_max_m),
            least=IN_VIEW_SHARE * expected.ids.size,
        )


CAMERA, DEPTH = _OfCameras(), _OfDepthCameras()


def visibility_comparison_of(sensor_type: str) -> VisibilityComparison | None:
    """Return how mixtures of a type of sensors are compared; None where they show no objects."""
    place = traits_named(sensor_type).visibility
    return load_plugin_object(place) if place else None


def _waiting_s(count: int) -> float:
    """Return the time until the next mixture is due, after so many measured ones.

    It is irregular, as the quadratic phases of a number without good fractions are: what is wrong
    in each second or third image could else be in none of the measured ones.
    """
    return _SHORTEST_S + (_LONGEST_S - _SHORTEST_S) * (count * count * _GOLDEN % 1.0)


def _camera_pose(at: ReadingExposure) -> Pose:
    """Return the pose of the real vehicle's camera, turned as the recipe turns its view."""
    camera = at.measured.real
    if not isinstance(camera, CameraSetup | DepthSetup):
        raise TypeError(f"sensor {camera.name} is not a camera")
    pose = camera.mount.camera_pose(at.body)
    turn = _turn_of(at.measured.combination)
    return Pose(pose.position_ned_m, quat_multiply(pose.q_wxyz, turn))


def _turn_of(combination: Combination) -> Quat:
    """Return how the recipe turns the real camera's view, for the visibility probe."""
    turn = IDENTITY
    for step in combination.steps:
        parameters = step.parameters
        if isinstance(parameters, CameraModelParameters) and "real" in parameters.sides():
            turn = quat_multiply(turn, parameters.turn.quaternion())
    return turn
