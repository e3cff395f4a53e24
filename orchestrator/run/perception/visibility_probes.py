"""Builds the visibility probe of each combination of a recipe, or says why it has none."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from wil_campaign.campaigns.setup.named_objects import named_objects
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    SensorSetup,
)
from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.run.perception.expected_views import ExpectedViews
from wil_campaign.orchestrator.run.perception.visibility import (
    BodyPose,
    MixtureViews,
    VisibilityMeasurement,
    VisibilityProbe,
    visibility_comparison_of,
)
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.vehicle_context import HISTORY_S, VehicleContext
from wil_campaign.recipes.model.recipe import Combination
from wil_campaign.recipes.pipeline.pipeline import Mixer
from wil_campaign.recipes.visibility.model import VirtualObjects
from wil_campaign.vehicles.cameras.rendered_cameras import MAX_POSE_AGE_S
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import virtual_only_objects


@dataclass(frozen=True, slots=True)
class NotMeasured:
    """Why no visibility probe can measure a combination, in words."""

    why: str


class VisibilityProbes:
    """Builds the visibility probe of each combination that can be measured."""

    def __init__(
        self,
        *,
        setup: RunSetup,
        contexts: Mapping[str, VehicleContext],
        events: Mapping[str, float],
        external_io: ExternalIo,
        run_state: RunState,
    ) -> None:
        self._run_state = run_state
        self._setup = setup
        self._contexts = contexts
        self._external_io = external_io
        self._captured = PoseHistory(HISTORY_S)
        self._expected: ExpectedViews | None = None
        real = contexts.get("real")
        if real is not None and real.pose_source != "mocap":
            real.on_mocap(self._capture)
        self._events = events

    def of(
        self, mixer: Mixer, real: SensorSetup, twin: SensorSetup
    ) -> VisibilityProbe | NotMeasured:
        """Return the visibility probe of a combination, or why it has none.

        The probe observes the mixer; without one nothing of a mixture is stored.
        """
        combination = mixer.combination
        setup = self._setup
        things = virtual_only_objects(setup.real_scene, setup.virtual_scene)
        virtual = sought_objects(combination, things, named_objects(setup.case))
        comparison = visibility_comparison_of(combination.sensor.kind)
        if comparison is None:
            kind = combination.sensor.kind
            return NotMeasured(f"a reading of type {kind} shows no objects")
        why = _obstacle(combination, virtual, real) or comparison.obstacle(twin)
        if why:
            return NotMeasured(why)
        views = self._views_of_geometry()
        comparison.prepare(views)
        measured = VisibilityMeasurement(
            combination=combination,
            real=real,
            twin=twin,
            virtual=virtual,
            views=views,
            body=self._body(real),
            is_like=self._drawn_by_us(twin),
            is_judged=lambda: self._run_state.stage == "goal",
            noise=setup.profiles["twin"].sensors,
        )
        mixer.observer = mixture_views = MixtureViews()
        return VisibilityProbe(measured, comparison=comparison, views=mixture_views)

    def _capture(self, reading: PoseReading) -> None:
        self._captured.add(reading.t_s, reading.pose)

    def _views_of_geometry(self) -> ExpectedViews:
        """Return the expected views for the probes; built when first needed."""
        if self._expected is None:
            self._expected = ExpectedViews(
                real=self._setup.real_scene,
                virtual=self._setup.virtual_scene,
                events=self._events,
            )
        return self._expected

    def _body(self, sensor: SensorSetup) -> BodyPose:
        """Return the real vehicle's pose for probes: truth, motion capture or pose source.

        The truth of an embedded vehicle is no reference for external images.
        """
        context = self._contexts["real"]
        is_live = (
            isinstance(sensor, CameraSetup | DepthSetup)
            and sensor.source is not None
            and sensor.source.shown_as == "live"
        )
        histories = [*(() if is_live else (context.truth,)), self._captured, context.poses]

        def body(t_s: float) -> Pose | None:
            nearest = (history.at(t_s) for history in histories)
            fresh = (one.pose for one in nearest if one.gap_s <= MAX_POSE_AGE_S)
            return next((pose for pose in fresh if pose is not None), None)

        return body

    def _drawn_by_us(self, twin: SensorSetup) -> bool:
        key = ("twin", twin.name)
        return key not in self._external_io.cameras and key not in self._external_io.simulators


def _obstacle(combination: Combination, virtual: VirtualObjects, real: SensorSetup) -> str:
    """Return why the visibility in mixtures of a combination cannot be measured; or ""."""
    if not virtual.names:
        obstacle = (
            "the recipe mixes in no object" if combination.shows is None else "shows names none"
        )
        return f"{obstacle} that exists in the virtual world only"
    if isinstance(real, CameraSetup | DepthSetup) and _is_file(real):
        return "images from a file have no camera pose"
    return ""


def sought_objects(
    combination: Combination, things: Mapping[int, str], named: Iterable[str]
) -> VirtualObjects:
    """Return the virtual objects that a probe looks for. things: all of them, by id.

    Those that `shows` of the recipe names; without it all of them, or, where the recipe isolates
    objects by name, these and those that the goal and the required oracles name (`named`). The
    others are left out, and counted.
    """
    isolated = combination.isolated()
    if combination.shows is not None:
        shown = {i: name for i, name in things.items() if name in combination.shows}
        others = {i: name for i, name in things.items() if i not in shown}
        beside = (i for i, name in others.items() if name in isolated or not isolated)
        return VirtualObjects(shown, others, frozenset(beside))
    if isolated:
        isolated |= set(named)
    wanted = {i: name for i, name in things.items() if name in isolated}
    if not wanted:
        return VirtualObjects(dict(things))
    return VirtualObjects(wanted, {i: name for i, name in things.items() if i not in wanted})


def _is_file(camera: CameraSetup | DepthSetup) -> bool:
    return camera.source is not None and camera.source.shown_as == "file"
