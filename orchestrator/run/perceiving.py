"""What is perceived in a run: cameras of the worlds that fly, mixed by the recipe, delivered."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from campaigns.setup import CameraSetup, VehicleSetup
from orchestrator.run.control import Pilot
from orchestrator.run.course import Course
from orchestrator.run.hangar import vehicle_seed
from orchestrator.run.mixing import Frames, MixingLoop
from orchestrator.run.registration import box_corners, registration_error_px
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from orchestrator.run.statistics import MixingStatistics
from recipes.mixed import Mixed
from recipes.pipeline import Mixer, compile_recipe
from vehicles.camera_effects import CameraQuality
from vehicles.cameras import AskedCamera, Compute, Picture, RenderedCamera, inline
from vehicles.pose_history import PoseHistory
from vehicles.readings import CameraReading
from worlds.camera import Intrinsics
from worlds.frames import Pose, Vec3
from worlds.render.renderer import Renderer
from worlds.scene import Scene

T = TypeVar("T")
Watch = Callable[[Frames], None]

_POSE_WAIT_S = 0.05
"""How long a picture waits for the pose of its exposure, on top of what the camera is late."""
_SILENT_S = 0.3
"""Telemetry comes 50 times a second: a vehicle that says nothing for so long may be dead."""
_STALLED_S = 1.0
"""After how long without a mixed reading in flight the run proves nothing any more."""


class WorldPictures:
    """Pictures of one scene, with what moves in it where it is at the time."""

    def __init__(self, *, scene: Scene, events: Mapping[str, float]) -> None:
        self._renderer = Renderer(scene)
        self._events = events

    def picture(
        self,
        camera_pose: Pose,
        intrinsics: Intrinsics,
        t_s: float,
        *,
        want_depth: bool = False,
        want_ids: bool = False,
    ) -> Picture:
        """Return a picture from a camera's pose (FRD axes, world frame) at a time."""
        return self._renderer.render(
            camera_pose, intrinsics, t_s, self._events, want_depth=want_depth, want_ids=want_ids
        )


async def in_thread(job: Callable[[], T], /) -> T:
    """Run a job in a thread, so that the loop's 50 Hz go on."""
    return await asyncio.to_thread(job)


@dataclass(slots=True)
class Perception:
    """The cameras and mixing of a run, and the pilots that perceive by them."""

    pilots: Mapping[str, Pilot]
    course: Course
    cameras: list[tuple[RenderedCamera, Callable[[CameraReading], None]]] = field(
        default_factory=list
    )
    mixing: MixingLoop | None = None
    _doubt: tuple[float, str] | None = None

    @property
    def statistics(self) -> MixingStatistics | None:
        """Return the figures of the mixing; None where nothing is mixed."""
        return None if self.mixing is None else self.mixing.statistics

    async def run(self) -> None:
        """From the takeoff on, take, mix and deliver pictures until cancelled."""
        await self.course.reaching("takeoff")
        async with asyncio.TaskGroup() as group:
            group.create_task(self.course.reaching("end"), name="perception without cameras")
            for camera, deliver in self.cameras:
                group.create_task(camera.run(deliver), name="camera")
            if self.mixing is not None:
                group.create_task(self.mixing.run(), name="mixing")
                group.create_task(self._watch(self.mixing), name="mixing watch")

    async def _watch(self, mixing: MixingLoop) -> None:
        """Notice when the mixing stands still while the goal is flown; settle what is in doubt."""
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_STALLED_S / 4)
            if self.course.stage == "goal":
                since_s = max(
                    mixing.statistics.last_delivery_s or 0.0, self.course.entered_s["goal"]
                )
                if loop.time() - since_s > _STALLED_S:
                    self.spoiled(f"no mixed picture for more than {_STALLED_S:g} s")
            if self._doubt is None:
                continue
            t_s, reason = self._doubt
            if loop.time() - t_s > 2 * _SILENT_S and not self._someone_is_silent():
                self.course.decide("INVALID", f"mixing: {reason}", t_s=t_s, source="mixing")
                return

    def spoiled(self, reason: str) -> None:
        """Take that what was perceived while the goal was flown proves nothing.

        While a vehicle is silent this may be its death, which is an ERROR that the guard tells;
        it counts as INVALID only once all are heard again.
        """
        if self._doubt is None:
            self._doubt = (asyncio.get_running_loop().time(), reason)

    def _someone_is_silent(self) -> bool:
        now_s = asyncio.get_running_loop().time()
        heard_s = [pilot.station.driver.state.last_heard_s for pilot in self.pilots.values()]
        return any(t_s is None or now_s - t_s > _SILENT_S for t_s in heard_s)


def build_perception(
    setup: RunSetup,
    stations: tuple[Station, ...],
    course: Course,
    events: Mapping[str, float],
    watch: Watch,
) -> Perception:
    """Return the cameras, mixing and pilots of a run, not started yet."""
    pilots = {
        station.name: Pilot(
            autonomy=setup.campaign.under_test.build(setup.seed),
            station=station,
            course=course,
            rate_hz=setup.campaign.under_test.rate_hz,
        )
        for station in stations
    }
    perception = Perception(pilots=pilots, course=course)
    builder = _Builder(setup, {s.name: s for s in stations}, course, events, watch)
    if setup.mode == "wil":
        builder.mixed(perception)
    else:
        builder.direct(perception, setup.subject)
    return perception


@dataclass(frozen=True, slots=True)
class _Builder:
    setup: RunSetup
    stations: Mapping[str, Station]
    course: Course
    events: Mapping[str, float]
    watch: Watch

    @property
    def compute(self) -> Compute:
        return inline if self.setup.clock == "virtual" else in_thread

    def direct(self, perception: Perception, name: str) -> None:
        """Let a vehicle that flies alone perceive its own camera."""
        vehicle = self.setup.vehicle(name)
        if not vehicle.cameras:
            return

        def deliver(reading: CameraReading) -> None:
            self.watch(Frames(reading, None, reading))
            perception.pilots[name].perceive(reading)

        perception.cameras.append((self._camera(vehicle, vehicle.cameras[0]), deliver))

    def mixed(self, perception: Perception) -> None:
        """Let both vehicles perceive the mixture, as the recipe says."""
        real, twin = self.setup.vehicle("real"), self.setup.vehicle("twin")
        mixer = self._mixer()
        if mixer is None:
            return
        real_camera, twin_camera = (_camera_named(one, mixer.sensor) for one in (real, twin))
        asked = AskedCamera(
            source=WorldPictures(scene=self.setup.virtual_scene, events=self.events),
            intrinsics=twin_camera.intrinsics,
            mount=real_camera.mount,
            compute=self.compute,
        )
        receivers = [perception.pilots[name] for name in mixer.publish]

        def deliver(reading: CameraReading) -> None:
            for pilot in receivers:
                pilot.perceive(reading)

        perception.mixing = MixingLoop(
            mixer=mixer,
            twin=asked if mixer.pose_request is not None else None,
            poses=self._asked_poses(mixer),
            wait_s=_POSE_WAIT_S,
            registration=self._registration(real_camera),
            deliver=deliver,
            watch=self.watch,
            trouble=lambda mixed: self._trouble(perception, mixed),
        )
        perception.cameras.append((self._camera(real, real_camera), perception.mixing.real_picture))
        if mixer.pose_request is None:
            perception.cameras.append(
                (self._camera(twin, twin_camera), perception.mixing.twin_picture)
            )

    def _mixer(self) -> Mixer | None:
        if self.setup.campaign.recipe is None:
            return None
        ids = {thing.name: thing.object_id for thing in self.setup.virtual_scene.objects}
        mixers = compile_recipe(self.setup.campaign.recipe, object_ids=ids)
        return next((one for one in mixers if one.combination.sensor.kind == "camera"), None)

    def _asked_poses(self, mixer: Mixer) -> PoseHistory:
        request = mixer.pose_request
        return self.stations["real" if request is None else request.pose].poses

    def _camera(self, vehicle: VehicleSetup, camera: CameraSetup) -> RenderedCamera:
        scene = self.setup.real_scene if vehicle.name == "real" else self.setup.virtual_scene
        return RenderedCamera(
            source=WorldPictures(scene=scene, events=self.events),
            history=self.stations[vehicle.name].truth,
            intrinsics=camera.intrinsics,
            rate_hz=camera.rate_hz,
            side=vehicle.name,
            rng=np.random.default_rng([vehicle_seed(self.setup.seed, vehicle.name), 2]),
            mount=camera.mount,
            quality=CameraQuality.of_profile(self.setup.profiles[vehicle.name].camera),
            compute=self.compute,
            pose_delay_s=0.01,
        )

    def _registration(self, camera: CameraSetup) -> Callable[[CameraReading], float | None]:
        """Return the error of a twin's picture against where the real camera truly was."""
        truth = self.stations["real"].truth
        real = set(self.setup.real_scene.names)
        virtual = [
            (thing, box_corners(thing))
            for thing in self.setup.virtual_scene.objects
            if thing.name not in real
        ]

        def points(t_s: float) -> list[Vec3]:
            return [
                pose.to_parent(corner)
                for thing, corners in virtual
                for pose in (thing.pose_at(t_s, self.events),)
                for corner in corners
            ]

        def error_px(twin: CameraReading) -> float | None:
            found = truth.at(twin.t_s)
            if found.pose is None or twin.camera_pose is None:
                return None
            return registration_error_px(
                points(twin.t_s),
                intrinsics=camera.intrinsics,
                drawn_from=twin.camera_pose,
                reference=camera.mount.camera_pose(found.pose),
            )

        return error_px

    def _trouble(self, perception: Perception, mixed: Mixed) -> None:
        """Take a mixture without its overlay: while the goal is flown it proves nothing."""
        if self.course.stage == "goal":
            perception.spoiled(mixed.provenance.detail or str(mixed.provenance.dropped))


def _camera_named(vehicle: VehicleSetup, name: str) -> CameraSetup:
    return next(camera for camera in vehicle.cameras if camera.name == name)
