"""Which combinations of a recipe are measured for visibility, against which pose, and why not."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from campaigns.values.sensor_setups import CameraSetup, LidarPointsSetup, SensorSetup
from orchestrator.external.external_io import ExternalIo
from orchestrator.run.perception.expected_views import ExpectedViews
from orchestrator.run.perception.visibility import BodyPose, Measured, MixtureViews, VisibilityProbe
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.vehicle_context import VehicleContext
from recipes.model.recipe import Combination
from recipes.pipeline.pipeline import Mixer
from recipes.steps.filter.isolation import IsolateObjectsParameters
from recipes.visibility.model import Virtual
from worlds.frames import Pose
from worlds.scene.scene import Scene

Reference = Literal["truth", "pose_source"]

_SHOWING = frozenset({"camera", "depth", "lidar", "lidar_points", "rangefinder"})


@dataclass(frozen=True, slots=True)
class NotMeasured:
    """Why the mixtures of a combination cannot be measured, in words."""

    why: str


class VisibilityProbes:
    """Makes the probe of each combination; all share the observer `views` of the mixers."""

    def __init__(
        self,
        *,
        setup: RunSetup,
        contexts: Mapping[str, VehicleContext],
        events: Mapping[str, float],
        outside: ExternalIo,
    ) -> None:
        self.views = MixtureViews()
        self._setup = setup
        self._contexts = contexts
        self._outside = outside
        self._expected = ExpectedViews(
            real=setup.real_scene, virtual=setup.virtual_scene, events=events
        )

    def of(
        self, mixer: Mixer, real: SensorSetup, twin: SensorSetup
    ) -> VisibilityProbe | NotMeasured:
        """Return what measures a combination, or why nothing can."""
        combination = mixer.combination
        virtual = self._virtual(combination)
        why = self._obstacle(combination, virtual, real, twin)
        if why:
            return NotMeasured(why)
        measured = Measured(
            combination=combination,
            real=real,
            twin=twin,
            virtual=virtual,
            views=self._expected,
            body=self._body(real),
            is_like=self._drawn_by_us(twin),
        )
        return VisibilityProbe(measured, views=self.views)

    def _virtual(self, combination: Combination) -> Virtual:
        """Return the objects that the mixture has to show.

        All of them; where the recipe isolates objects by name, these and the gates of the goal.
        """
        things = virtual_only(self._setup.real_scene, self._setup.virtual_scene)
        named: set[str] = set()
        for step in combination.steps:
            if isinstance(step.parameters, IsolateObjectsParameters):
                named |= set(step.parameters.names)
        if named:
            named |= set(self._setup.campaign.goal.gates)
        wanted = {id_: name for id_, name in things.items() if name in named}
        return Virtual(wanted or things)

    def _obstacle(
        self, combination: Combination, virtual: Virtual, real: SensorSetup, twin: SensorSetup
    ) -> str:
        if combination.sensor.kind not in _SHOWING:
            return f"a reading of type {combination.sensor.kind} shows no objects"
        if not virtual.names:
            return "nothing that the recipe mixes in stands in the virtual world alone"
        if isinstance(real, CameraSetup) and _is_file(real):
            return "pictures from a file do not say where they were taken"
        if combination.sensor.kind == "lidar_points" and not isinstance(twin, LidarPointsSetup):
            return f"the points are made of a {twin.kind} reading"
        return ""

    def _body(self, sensor: SensorSetup) -> BodyPose:
        """Return where the real vehicle truly was; by its pose source where nobody knows better.

        The truth of a vehicle of ours is no reference for pictures that come from outside.
        """
        context = self._contexts["real"]
        is_live = isinstance(sensor, CameraSetup) and ("real", sensor.name) in self._outside.cameras

        def body(t_s: float) -> Pose | None:
            truth = None if is_live else context.truth.at(t_s).pose
            return context.poses.at(t_s).pose if truth is None else truth

        return body

    def _drawn_by_us(self, twin: SensorSetup) -> bool:
        key = ("twin", twin.name)
        return key not in self._outside.cameras and key not in self._outside.simulators


def virtual_only(real: Scene, virtual: Scene) -> dict[int, str]:
    """Return id and name of each object that stands in the virtual world alone; rooms enclose."""
    return {
        thing.object_id: thing.name
        for thing in virtual.objects
        if thing.name not in real and not thing.is_room
    }


def _is_file(camera: CameraSetup) -> bool:
    return camera.source is not None and camera.source.shown_as == "file"
