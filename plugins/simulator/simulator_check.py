"""Compares the object ids in a simulator's images with the judged world, while it flies.

Without this check only the simulator itself states that it renders the judged world, where its
image is perceived unchanged (mode `sim`), or where a recipe changes the whole image.
"""

from collections.abc import Callable, Mapping
from typing import Self

import numpy as np

from wil_campaign.campaigns.values.external_setups import SourceSetup
from wil_campaign.orchestrator.run_results.result_parts import SourceResult
from wil_campaign.plugins.simulator.shown_world import asked_world, poses_of_moving
from wil_campaign.plugins.simulator.simulator_camera import ZmqImageSource
from wil_campaign.plugins.simulator.visible_ids import compare_ids
from wil_campaign.recipes.visibility.coverage import VisibilityCoverage, uncovered_objects
from wil_campaign.recipes.visibility.model import FrameVisibility, Ids
from wil_campaign.recipes.visibility.sampling import image_samples_of, sampled_intrinsics
from wil_campaign.vehicles.cameras.rendered_cameras import RenderedImage
from wil_campaign.vehicles.readings import DepthImage, Source
from wil_campaign.vehicles.sensors.world_views import WorldImages
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene

PERIOD_S = 0.5
"""How often object ids are requested with the image; they double the rendering time."""
_EARLY_S = 1e-6
_OFF_M, _OFF_SHARE_OF_WIDTH = 0.02, 0.005
"""The allowed offset of an outline: twice the position tolerance of the handshake at the nearest
visible point of an object, or a third of a degree of a 69 degree camera. The resolution of the
comparison is added, a 160th of the image's width."""
_OFF_M_OF = {"person": 0.3, "quadrotor": 0.1}
"""The same for kinds with the engine's own models, whose limbs and rotors differ in position."""


def simulator_images(
    source: SourceSetup,
    *,
    vehicle: Source,
    sensor: str,
    scene: Scene,
    world: str,
    case: str,
    events: Mapping[str, float],
) -> "SimulatorCheck":
    """Return a simulator's images of a camera, with the check of what they show.

    scene: what it is to show. world, case: their names. events: of the world, by time.
    """
    simulator = ZmqImageSource(
        address=source.address,
        timeout_s=source.answer_s,
        open_timeout_s=source.open_s,
        world=asked_world(scene, world=world, case=case),
        events=lambda: dict(events),
        moved=lambda t_s: poses_of_moving(scene, t_s, events),
    )
    return SimulatorCheck(
        simulator=simulator, scene=scene, events=events, vehicle=vehicle, sensor=sensor
    )


class SimulatorCheck:
    """An ImageSource that requests images of a simulator, and measures what they show.

    fault: the first that lasted long enough, in words; empty without one. Thread-safe for requests.
    """

    def __init__(
        self,
        *,
        simulator: ZmqImageSource,
        scene: Scene,
        events: Mapping[str, float],
        vehicle: Source = "twin",
        sensor: str = "camera",
    ) -> None:
        self._simulator = simulator
        self._vehicle = str(vehicle)
        self._sensor = sensor
        self._scene = scene
        self._views = WorldImages(scene=scene, events=events)
        self._is_judged: Callable[[], bool] = lambda: False
        self._due_s = 0.0
        self._shower = f"the simulator at {simulator.name}"
        self.coverage = VisibilityCoverage(self._shower)
        self.fault = ""

    async def __aenter__(self) -> Self:
        """Connect to the simulator. Raises SimulatorError."""
        await self._simulator.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect from the simulator."""
        await self._simulator.__aexit__()

    async def warm_up(self, camera_pose: Pose, intrinsics: Intrinsics, t_s: float) -> None:
        """Request a first image, which is not counted. Raises SimulatorError."""
        await self._simulator.warm_up(camera_pose, intrinsics, t_s)

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Return in words where the simulator shows another world than the judged one."""
        simulator = self._simulator
        return tuple(f"{simulator.name}: {text}" for text in simulator.disagreements)

    @property
    def result(self) -> SourceResult:
        """Return the counts of a simulator's images."""
        counts = self._simulator.counts
        return SourceResult(
            vehicle=self._vehicle,
            sensor=self._sensor,
            source="rendered",
            delivered=counts.answered,
            dropped=counts.late,
            missed=counts.timeouts,
            damaged=counts.garbage + counts.refused,
            stalls=0,
            trouble=self._simulator.trouble,
            measured=self.coverage.frames,
            not_measured=self.not_measured,
        )

    def begin(self, is_judged: Callable[[], bool]) -> None:
        """Begin to measure images while `is_judged` returns True."""
        self._is_judged = is_judged

    @property
    def marked(self) -> Mapping[int, str]:
        """Return the names of the objects that the simulator marks, by id, without rooms."""
        marked = frozenset(self._simulator.welcome.objects)
        objects = (scene_object for scene_object in self._scene.objects if not scene_object.is_room)
        return {
            scene_object.object_id: scene_object.name
            for scene_object in objects
            if scene_object.name in marked
        }

    @property
    def not_measured(self) -> str:
        """Return why nothing, or not all, was measured; "" when all was."""
        there = {
            scene_object.name for scene_object in self._scene.objects if not scene_object.is_room
        }
        missing = sorted(there - set(self.marked.values()))
        if missing:
            return f"it marks no {' and no '.join(missing)} (`objects` of its `welcome`)"
        return "" if self.coverage.frames or not there else "no image was requested in flight"

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> RenderedImage:
        """Return a simulator's image; blocks within its limit. Raises SimulatorError."""
        due = self._is_due(t_s)
        image = self._simulator.picture(
            camera_pose, intrinsics, t_s, want_depth=want_depth, want_ids=want_ids or due
        )
        if due and image.object_ids is not None:
            self._record(self._compare(image.object_ids, camera_pose, intrinsics, t_s))
        return image

    def look_back(self) -> str:
        """Return in words what was never or hardly shown in the whole flight; "" for nothing."""
        fault = self.coverage.never_shown() or uncovered_objects(
            (self.coverage,), shower=self._shower
        )
        return self.fault or (fault.text if fault is not None else "")

    def _is_due(self, t_s: float) -> bool:
        if not self._is_judged() or not self.marked:
            return False
        if t_s < self._due_s - _EARLY_S and not self.coverage.is_suspect():
            return False
        self._due_s = t_s + PERIOD_S
        return True

    def _record(self, frame: FrameVisibility) -> None:
        fault = self.coverage.observe(frame)
        if fault is not None and not self.fault:
            self.fault = fault.text

    def _compare(
        self, ids: Ids, camera_pose: Pose, intrinsics: Intrinsics, t_s: float
    ) -> FrameVisibility:
        part = image_samples_of(intrinsics)
        drawn = self._views.picture(
            camera_pose, sampled_intrinsics(intrinsics), t_s, want_depth=True, want_ids=True
        )
        expected = np.asarray(drawn.object_ids, np.uint8)
        depth_m = np.asarray(drawn.depth_m, np.float32)
        return compare_ids(
            t_s=t_s,
            shown=ids[part, part],
            expected=expected,
            names=self.marked,
            limits_px=self._limits_px(intrinsics, expected, depth_m),
            px_per_sample=part.step,
        )

    def _limits_px(
        self, intrinsics: Intrinsics, expected: Ids, depth_m: DepthImage
    ) -> dict[int, float]:
        """Return the allowed offset of each object in pixels, by id."""
        floor_px, limits_px = _OFF_SHARE_OF_WIDTH * intrinsics.width_px, {}
        for object_id, name in self.marked.items():
            own = depth_m[expected == object_id]
            off_m = _OFF_M_OF.get(self._scene[name].shape.kind, _OFF_M)
            off_px = intrinsics.fx_px * off_m / float(own.min()) if own.size else 0.0
            limits_px[object_id] = max(floor_px, off_px)
        return limits_px
