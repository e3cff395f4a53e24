"""Builds the perception of a run: connects sensors, mixing loops and runners by the recipe."""

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup, DepthSetup, SensorSetup
from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.run.perception.mixing_budget import MixingBudgetWatch
from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop, Registration
from wil_campaign.orchestrator.run.perception.perception import PerceivedSensor, Perception, Take
from wil_campaign.orchestrator.run.perception.registration_error import Registrar
from wil_campaign.orchestrator.run.perception.runner_factory import AnyRunner
from wil_campaign.orchestrator.run.perception.sensor_factory import SensorFactory, is_image
from wil_campaign.orchestrator.run.perception.visibility import VisibilityProbe
from wil_campaign.orchestrator.run.perception.visibility_probes import VisibilityProbes
from wil_campaign.orchestrator.run.vehicles.pair import VehiclePair
from wil_campaign.orchestrator.state.mixtures import MixedFrame, PreviewImages
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState
from wil_campaign.orchestrator.state.signal_faults import SignalFaults
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext, is_any_silent
from wil_campaign.recipes.pipeline.autonomy_readings import without_ground_truth
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.vehicles.readings import CameraReading, Reading
from wil_campaign.vehicles.readings.checks import reading_fault
from wil_campaign.vehicles.readings.copies import restamp_reading

_POSE_WAIT_S = 0.05
"""How long an image waits for the pose of its exposure, beyond the latency of the camera."""
_MOCAP_HZ = 100.0
"""Rate of motion capture where a campaign does not state it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PerceptionWatchers:
    """Watchers that a built perception reports readings and mixtures to.

    reading: called with each reading of a source, of real or twin. frame: with each mixture.
    perceived: with each reading that autonomies perceive, and the names of their vehicles. shown:
    with the images for people. images_ended: with the topics whose images have ended.
    """

    reading: Callable[[Reading], None]
    frame: Callable[[MixedFrame], None]
    perceived: Callable[[Reading, tuple[str, ...]], None]
    shown: Callable[[PreviewImages], None]
    images_ended: Callable[[tuple[str, ...]], None]


def build_perception(
    setup: RunSetup,
    *,
    pair: VehiclePair,
    runners: Mapping[str, AnyRunner],
    external_io: ExternalIo,
    run_state: RunState,
    events: Mapping[str, float],
    watchers: PerceptionWatchers,
    faults: SignalFaults,
) -> Perception:
    """Build a run's sensors and mixing loops for its runners, not started yet."""
    budgets = MixingBudgetWatch(
        run_state=run_state,
        is_any_silent=lambda now_s: is_any_silent(pair.contexts, run_state.dropped_out, now_s),
    )
    perception = Perception(runners, run_state, budgets, images_ended=watchers.images_ended)
    contexts = {context.name: context for context in pair.contexts}
    if setup.placed is not None:
        contexts[setup.placed.name] = contexts[setup.subject]
    sensor_factory = SensorFactory(
        setup=setup,
        contexts=contexts,
        feeds=pair.vehicles,
        events=events,
        external_io=external_io,
        faults=faults,
    )
    perception.has_external_sensors = external_io.senses(budgets.note_doubt)
    builder = _PerceptionBuilder(
        setup=setup,
        contexts=contexts,
        sensor_factory=sensor_factory,
        events=events,
        watchers=watchers,
        perception=perception,
        probes=VisibilityProbes(
            setup=setup,
            contexts=contexts,
            events=events,
            external_io=external_io,
            run_state=run_state,
        ),
        faults=faults,
    )
    builder.build()
    return perception


class _PerceptionBuilder:
    def __init__(
        self,
        *,
        setup: RunSetup,
        contexts: Mapping[str, VehicleContext],
        sensor_factory: SensorFactory,
        events: Mapping[str, float],
        watchers: PerceptionWatchers,
        perception: Perception,
        probes: VisibilityProbes,
        faults: SignalFaults,
    ) -> None:
        self._probes = probes
        self._faults = faults
        self._setup = setup
        self._contexts = contexts
        self._sensor_factory = sensor_factory
        self._watchers = watchers
        self._perception = perception
        self._registrar = Registrar(setup=setup, contexts=contexts, events=events)
        self._sources: dict[tuple[str, str], PerceivedSensor] = {}
        self._video: str | None = None

    def build(self) -> None:
        """Build mixing loops for what the recipe mixes; deliver other sensors directly."""
        mixed: set[tuple[str, str]] = set()
        mixers = self._mixers() if self._setup.mode == "wil" else ()
        combined = Counter(mixer.sensor for mixer in mixers)
        for mixer in mixers:
            if not self._receivers(mixer):
                continue
            name = mixer.sensor
            if combined[name] > 1:
                name = f"{name}.{'_'.join(mixer.publish)}"
            self._mix(mixer, name)
            mixed |= {(vehicle, mixer.sensor) for vehicle in mixer.publish}
        for vehicle in self._setup.vehicles:
            for sensor in vehicle.sensors:
                if (vehicle.name, sensor.name) not in mixed:
                    self._direct(vehicle, sensor)
        self._perception.sources.extend(self._sources.values())

    def _mixers(self) -> tuple[Mixer, ...]:
        if self._setup.case.recipe is None:
            return ()
        # An object that exists in another case only is in no reading: it isolates nothing.
        ids = self._setup.case.world.object_ids
        watch = asyncio.get_running_loop().time if self._setup.clock != "virtual" else None
        return compile_recipe(self._setup.case.recipe, object_ids=ids, stopwatch=watch)

    def _mix(self, mixer: Mixer, name: str) -> None:
        real = _sensor_setup(self._setup.vehicle("real"), mixer.sensor)
        twin = _sensor_setup(self._setup.vehicle("twin"), mixer.sensor)
        request, perception = mixer.pose_request, self._perception
        rate_hz = mixer.combination.sensor.rate_hz
        period_s = 1.0 / _rate_hz(real)
        probe = self._probes.of(mixer, real, twin)
        mixing = MixingLoop(
            name=name,
            mixer=mixer,
            twin=None if request is None else self._sensor_factory.on_demand(twin, like=real),
            poses=self._contexts["real" if request is None else request.pose].poses,
            wait_s=_POSE_WAIT_S,
            period_s=period_s,
            rate_hz=rate_hz,
            registration=self._registration(real),
            probe=probe if isinstance(probe, VisibilityProbe) else None,
            unmeasured="" if isinstance(probe, VisibilityProbe) else probe.why,
            on_mixture=perception.report_mixture,
            on_fault=lambda reason: perception.budgets.note_breach(name, reason),
        )
        perception.budgets.watch(mixing, max(period_s, 1.0 / rate_hz if rate_hz else 0.0))
        if is_image(real) or is_image(twin):
            on_demand = () if request is None else (f"/twin/{twin.name}",)
            perception.of_images[name] = (f"/mixed/{name}", *on_demand)
        self._source("real", real).takers.append(mixing.real_reading)
        if request is None:
            self._source("twin", twin).takers.append(mixing.twin_reading)
        perception.listeners.append(self._delivery(mixer, name, on_demand=request is not None))

    def _delivery(
        self, mixer: Mixer, name: str, *, on_demand: bool
    ) -> Callable[[MixedFrame], None]:
        """Return the listener that records a mixture and delivers it to its runners."""
        receivers = self._receivers(mixer)
        runners = [self._perception.runners[vehicle] for vehicle in receivers]
        raw = mixer.combination.publish_raw
        subject = self._setup.subject in mixer.publish
        is_filmed = subject and mixer.combination.sensor.kind == "camera" and self._is_filmed(name)

        def deliver(frame: MixedFrame) -> None:
            if frame.name != name:
                return
            if on_demand and frame.twin is not None:
                self._watchers.reading(frame.twin)
            self._watchers.frame(frame)
            if frame.mixed.reading is not None:
                self._watchers.perceived(frame.mixed.reading, receivers)
            if is_filmed:
                self._show(frame)
            for runner in runners:
                _hand_over(runner, frame, raw=raw)

        return deliver

    def _receivers(self, mixer: Mixer) -> tuple[str, ...]:
        """Return the vehicles whose runners perceive a mixture; a placed twin has none."""
        return tuple(one for one in mixer.publish if one in self._perception.runners)

    def _is_filmed(self, name: str) -> bool:
        """Return whether the run's video shows this image stream: the subject's first one."""
        self._video = self._video or name
        return self._video == name

    def _show(self, frame: MixedFrame) -> None:
        if isinstance(frame.mixed.reading, CameraReading):
            self._watchers.shown(
                PreviewImages(
                    frame.mixed.reading,
                    f"/mixed/{frame.name}",
                    _camera(frame.real),
                    _camera(frame.twin),
                    alone=frame.mixed.provenance.dropped or "",
                )
            )

    def _direct(self, vehicle: VehicleSetup, sensor: SensorSetup) -> None:
        """Build the direct delivery of a vehicle's own sensor to its runner."""
        subject = vehicle.name == self._setup.subject
        is_filmed = subject and isinstance(sensor, CameraSetup) and self._is_filmed(sensor.name)
        self._source(vehicle.name, sensor).takers.append(
            _perception_users(
                self._perception.runners[vehicle.name],
                self._watchers,
                self._perception.run_state,
                is_filmed=is_filmed,
            )
        )

    def _source(self, vehicle: str, sensor: SensorSetup) -> PerceivedSensor:
        key = (vehicle, sensor.name)
        if key not in self._sources:
            stream = self._sensor_factory.stream(self._setup.vehicle(vehicle), sensor)
            fault = self._faults.signal(vehicle, sensor.name, restamp_reading)
            source = PerceivedSensor(
                vehicle,
                sensor.name,
                stream,
                [self._watchers.reading],
                fault,
                is_drawn=self._sensor_factory.draws(self._setup.vehicle(vehicle), sensor),
            )
            self._sources[key] = source
        return self._sources[key]

    def _registration(self, real: SensorSetup) -> Registration | None:
        if not isinstance(real, CameraSetup | DepthSetup):
            return None
        return self._registrar.of(real)


def _perception_users(
    runner: AnyRunner, watchers: PerceptionWatchers, run_state: RunState, *, is_filmed: bool
) -> Take:
    """Return what gives a runner a sensor's own readings, as they are; INVALID for a faulty one."""
    receivers = (runner.context.name,)

    def receive(reading: Reading) -> None:
        if (fault := reading_fault(reading)) is not None:
            reason = (
                f"{reading.sensor} of {reading.source}: {fault.detail}; no autonomy is given it"
            )
            run_state.decide("INVALID", reason, source=f"evidence/{reading.source}")
            return
        reading = without_ground_truth(reading)
        watchers.perceived(reading, receivers)
        if is_filmed and isinstance(reading, CameraReading):
            topic = f"/{reading.source}/{reading.sensor}"
            real = reading if reading.source == "real" else None
            watchers.shown(PreviewImages(reading, topic, real))
        runner.perceive(reading)

    return receive


def _hand_over(runner: AnyRunner, frame: MixedFrame, *, raw: bool) -> None:
    """Deliver a mixture, and on request its inputs, to an autonomy runner."""
    if raw:
        for reading in (frame.real, frame.twin):
            if reading is not None:
                runner.perceive_raw(without_ground_truth(reading))
    if frame.mixed.reading is not None:
        runner.perceive(frame.mixed.reading)


def _camera(reading: Reading | None) -> CameraReading | None:
    """Return the reading if it is a camera image; else None."""
    return reading if isinstance(reading, CameraReading) else None


def _sensor_setup(vehicle: VehicleSetup, name: str) -> SensorSetup:
    return next(sensor for sensor in vehicle.sensors if sensor.name == name)


def _rate_hz(sensor: SensorSetup) -> float:
    return sensor.rate_hz or _MOCAP_HZ
