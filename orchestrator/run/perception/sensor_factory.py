"""Builds the sensors of a run's vehicles, by campaign, with the noise of their profile."""

import asyncio
import zlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar

import numpy as np

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    OtherSensorSetup,
    SensorSetup,
    sensor_options_of,
)
from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.run.vehicles.vehicle_backends import VehicleFeed, vehicle_seed
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.signal_faults import FaultyOnDemand, SignalFaults
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.vehicles.cameras.camera_effects import CameraQuality
from wil_campaign.vehicles.cameras.rendered_cameras import (
    CameraCompute,
    ImageSource,
    OnDemandCamera,
    RenderedCamera,
    compute_inline,
)
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings.copies import restamp_reading
from wil_campaign.vehicles.readings.kinds import sensor_specs, traits_named
from wil_campaign.vehicles.sensors.depth import DEPTH_NOISES, DepthSensor
from wil_campaign.vehicles.sensors.lens import ThroughLens
from wil_campaign.vehicles.sensors.sensor_spec import (
    MountedOptions,
    NamedSensor,
    Sensor,
    SensorSite,
    SensorSpec,
)
from wil_campaign.vehicles.sensors.sensor_streams import (
    OnDemandSensor,
    PoseStream,
    ReadingStream,
    RenderedDepth,
    SensesOnDemand,
    SensorStream,
)
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth_history import TruthHistory
from wil_campaign.vehicles.sensors.world_views import WorldImages, WorldRays
from wil_campaign.worlds.scene.scene import Scene

T = TypeVar("T")

TRUTH_HZ = 250.0
"""Rate of the truth that sensors sample: the step rate of the physics."""
POSE_DELAY_S = 0.01
"""How long after an exposure its pose is looked up: by then the samples around it have arrived."""
_TELEMETRY_DELAY_S = 0.06
"""The same for poses that come by telemetry."""


async def run_sensor_in_thread(job: Callable[[], T], /) -> T:
    """Run a sensor's job in a thread, so that it does not block the event loop."""
    return await asyncio.to_thread(job)


class SensorFactory:
    """Makes the sensors of a run's vehicles, each with noise of its own.

    events: of the world, with their times. external_io: sensors whose readings come from external
    sources, and simulators that render images. A sensor's noise depends only on the run's seed, its
    vehicle and its name, so that a further sensor changes nothing for the others.
    """

    def __init__(
        self,
        *,
        setup: RunSetup,
        contexts: Mapping[str, VehicleContext],
        feeds: Mapping[str, VehicleFeed],
        events: Mapping[str, float],
        external_io: ExternalIo,
        faults: SignalFaults,
    ) -> None:
        self._external_io = external_io
        self._faults = faults
        self._setup = setup
        self._contexts = contexts
        self._feeds = feeds
        self._events = events
        self._tracks: dict[str, TruthHistory] = {}
        self._rays: dict[str, WorldRays] = {}
        self._on_demand: dict[str, SensesOnDemand] = {}

    def stream(self, vehicle: VehicleSetup, sensor: SensorSetup) -> ReadingStream:
        """Return a vehicle's sensor that streams readings by itself."""
        if isinstance(sensor, CameraSetup):
            return self._camera(vehicle, sensor)
        external = self._external_io.readings.get(vehicle.name, sensor.name)
        if external is not None:
            return external
        if sensor.kind == "pose":
            context = self._contexts[vehicle.name]
            return PoseStream(listen=context.on_mocap, rate_hz=sensor.rate_hz)
        return SensorStream(
            sensor=self._model(vehicle, sensor, like=sensor),
            track=self._track(vehicle.name),
            rate_hz=sensor.rate_hz or TRUTH_HZ,
            rng=self._rng(vehicle, sensor),
            compute=self._compute(sensor),
            truth_delay_s=self._pose_delay_s(vehicle),
        )

    def draws(self, vehicle: VehicleSetup, sensor: SensorSetup) -> bool:
        """Return whether a vehicle's sensor streams images that are drawn for it."""
        if isinstance(sensor, CameraSetup):
            return (vehicle.name, sensor.name) not in self._external_io.cameras
        is_external = self._external_io.readings.get(vehicle.name, sensor.name) is not None
        return is_image(sensor) and not is_external

    def on_demand(self, sensor: SensorSetup, *, like: SensorSetup) -> SensesOnDemand:
        """Return the twin's sensor that senses at a requested pose, mounted like the real one.

        Only for sensors whose readings depend on a pose. Repeated calls return the same object, so
        that readings are numbered once.
        """
        if sensor.name not in self._on_demand:
            on_demand = self._build_on_demand(sensor, like)
            fault = self._faults.signal("twin", sensor.name, restamp_reading)
            self._on_demand[sensor.name] = (
                on_demand if fault is None else FaultyOnDemand(on_demand, fault)
            )
        return self._on_demand[sensor.name]

    def _build_on_demand(self, sensor: SensorSetup, like: SensorSetup) -> SensesOnDemand:
        twin = self._setup.vehicle("twin")
        if isinstance(sensor, CameraSetup) and isinstance(like, CameraSetup):
            return OnDemandCamera(
                source=self._image_source("twin", sensor.name),
                intrinsics=sensor.intrinsics,
                mount=like.mount,
                compute=self._compute(sensor),
            )
        return OnDemandSensor(
            sensor=self._model(twin, sensor, like=like),
            rng=self._rng(twin, sensor),
            compute=self._compute(sensor),
        )

    def _camera(self, vehicle: VehicleSetup, camera: CameraSetup) -> ReadingStream:
        key = (vehicle.name, camera.name)
        if key in self._external_io.cameras:
            return self._external_io.cameras[key]
        context = self._contexts[vehicle.name]
        return RenderedCamera(
            source=self._image_source(*key),
            on_missing=lambda reason: self._external_io.missing(key, reason),
            # Without a truth the pose source says where the vehicle is.
            history=context.truth if self._has_truth(vehicle) else context.poses,
            intrinsics=camera.intrinsics,
            rate_hz=camera.rate_hz,
            side=vehicle.name,
            rng=self._rng(vehicle, camera),
            mount=camera.mount,
            quality=CameraQuality.of_profile(self._setup.profiles[vehicle.name].camera),
            compute=self._compute(camera),
            pose_delay_s=self._pose_delay_s(vehicle),
        )

    def _model(self, vehicle: VehicleSetup, sensor: SensorSetup, *, like: SensorSetup) -> Sensor:
        """Return a sensor's model. like: the sensor whose mount it has."""
        noise = self._setup.profiles[vehicle.name].sensors
        if isinstance(sensor, DepthSetup):
            camera = self._setup.profiles[vehicle.name].camera
            return RenderedDepth(
                source=self._image_source(vehicle.name, sensor.name),
                intrinsics=sensor.intrinsics,
                mount=like.mount if isinstance(like, DepthSetup | CameraSetup) else sensor.mount,
                side=vehicle.name,
                sensor=DepthSensor(noise=DEPTH_NOISES.named(noise)),
                timing=Timing(sensor.rate_hz, camera.latency_s, camera.jitter_s),
            )
        spec: SensorSpec = sensor_specs()[sensor.kind]
        if spec.model is None or not isinstance(sensor, OtherSensorSetup):
            raise TypeError(f"no sensor model for the {sensor.kind} of {vehicle.name}")
        site = SensorSite(
            side=vehicle.name,
            frame=self._setup.case.world.frame,
            noise=noise,
            mount=(sensor_options_of(like, MountedOptions) or sensor.options).mounted,
            caster=partial(self._caster, vehicle.name),
        )
        name = f"{sensor.kind} {sensor.name} of {vehicle.name}"
        return NamedSensor(name, spec, site.side, partial(spec.model, sensor.options, site))

    def _has_truth(self, vehicle: VehicleSetup) -> bool:
        """Return whether a vehicle is an embedded simulation that flies; a placed twin does not."""
        return vehicle.embedded and vehicle != self._setup.placed

    def _pose_delay_s(self, vehicle: VehicleSetup) -> float:
        """Return how long after a moment a vehicle's pose of it is looked up for its sensors."""
        return POSE_DELAY_S if self._has_truth(vehicle) else _TELEMETRY_DELAY_S

    def _scene(self, name: str) -> Scene:
        return self._setup.real_scene if name == "real" else self._setup.virtual_scene

    def _image_source(self, name: str, sensor: str) -> ImageSource:
        """Return the renderer of a sensor's images: a simulator, or the built-in one."""
        simulator = self._external_io.simulators.get((name, sensor))
        if simulator is not None:
            return ThroughLens(simulator)
        return ThroughLens(WorldImages(scene=self._scene(name), events=self._events))

    def _caster(self, name: str) -> WorldRays:
        """Return the ray caster of a vehicle's world, ready: none is built in the air."""
        if name not in self._rays:
            rays = self._rays[name] = WorldRays(scene=self._scene(name), events=self._events)
            rays.prepare()
        return self._rays[name]

    def _track(self, name: str) -> TruthHistory:
        if name not in self._tracks:
            self._tracks[name] = TruthHistory()
            if self._has_truth(self._setup.vehicle(name)):
                self._feeds[name].on_truth(self._tracks[name].add, TRUTH_HZ)
            else:
                self._contexts[name].on_pose(partial(_add_pose_as_truth, self._tracks[name]))
        return self._tracks[name]

    def _rng(self, vehicle: VehicleSetup, sensor: SensorSetup) -> np.random.Generator:
        seed = vehicle_seed(self._setup.seed, vehicle.name)
        return np.random.default_rng([seed, zlib.crc32(sensor.name.encode())])

    def _compute(self, sensor: SensorSetup) -> CameraCompute:
        """Return where a sensor's readings are computed: slow ones in a thread."""
        return (
            run_sensor_in_thread
            if is_image(sensor) and self._setup.clock != "virtual"
            else compute_inline
        )


def is_image(sensor: SensorSetup) -> bool:
    """Return whether a sensor's readings are images or point clouds, which take long to make.

    None of them goes to an autopilot: those that do are of use until the vehicle has landed.
    """
    return traits_named(sensor.kind).is_large


def _add_pose_as_truth(track: TruthHistory, sample: PoseSample) -> None:
    """Take a pose as the truth for sensors, where there is no better source."""
    track.add(
        TruthSample(
            sample.t_s,
            sample.pose,
            sample.velocity_ned_m_s,
            on_ground=False,
            motors_stopped=False,
        )
    )
