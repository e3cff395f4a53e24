"""Who perceives what in a run: sources, mixings and pilots put together by campaign and recipe."""

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from campaigns.sensor_setups import CameraSetup, DepthSetup, SensorSetup
from campaigns.setup import VehicleSetup
from orchestrator.outside.outside import Outside
from orchestrator.run.budgeting import BudgetWatch
from orchestrator.run.course import Course
from orchestrator.run.mixing import MixingLoop, Registration
from orchestrator.run.mixtures import Frame, Shown
from orchestrator.run.opening import Pair
from orchestrator.run.perceiving import Perception, SensorSource, Take
from orchestrator.run.pilots import AnyPilot
from orchestrator.run.registration import Registrar
from orchestrator.run.sensing import Senses
from orchestrator.run.setup import RunSetup
from orchestrator.run.station import Station
from orchestrator.run.visibility import VisibilityProbe
from orchestrator.run.visibility_probes import VisibilityProbes
from recipes.perceived import without_knowledge
from recipes.pipeline import Mixer, compile_recipe
from vehicles.readings import CameraReading, Reading

_POSE_WAIT_S = 0.05
"""How long a picture waits for the pose of its exposure, on top of what the camera is late."""
_SILENT_S = 0.3
"""Telemetry comes 50 times a second: a vehicle that says nothing for so long may be dead."""
_MOCAP_HZ = 100.0
"""Where a campaign does not say how often motion capture comes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Watchers:
    """Who looks on.

    reading: each of a source, of real or twin. frame: each mixture. perceived: each reading that
    an autonomy perceives, with the vehicles whose autonomies do.
    """

    reading: Callable[[Reading], None]
    frame: Callable[[Frame], None]
    perceived: Callable[[Reading, tuple[str, ...]], None]
    shown: Callable[[Shown], None]


def build_perception(
    setup: RunSetup,
    *,
    pair: Pair,
    pilots: Mapping[str, AnyPilot],
    outside: Outside,
    course: Course,
    events: Mapping[str, float],
    watchers: Watchers,
) -> Perception:
    """Return the sensors and mixings of a run, not started yet, for its pilots."""

    def someone_is_silent() -> bool:
        now_s = asyncio.get_running_loop().time()
        heard_s = [station.driver.state.last_heard_s for station in pair.stations]
        return any(t_s is None or now_s - t_s > _SILENT_S for t_s in heard_s)

    budgets = BudgetWatch(course=course, someone_is_silent=someone_is_silent)
    perception = Perception(pilots, course, budgets)
    stations = {station.name: station for station in pair.stations}
    senses = Senses(
        setup=setup, stations=stations, feeds=pair.vehicles, events=events, outside=outside
    )
    perception.from_outside = outside.senses(budgets.doubted)
    arranger = _Arranger(
        setup=setup,
        stations=stations,
        senses=senses,
        events=events,
        watchers=watchers,
        perception=perception,
        probes=VisibilityProbes(
            setup=setup, stations=stations, events=events, outside=outside, course=course
        ),
    )
    arranger.arrange()
    return perception


class _Arranger:
    def __init__(
        self,
        *,
        setup: RunSetup,
        stations: Mapping[str, Station],
        senses: Senses,
        events: Mapping[str, float],
        watchers: Watchers,
        perception: Perception,
        probes: VisibilityProbes,
    ) -> None:
        self._probes = probes
        self._setup = setup
        self._stations = stations
        self._senses = senses
        self._watchers = watchers
        self._perception = perception
        self._registrar = Registrar(setup=setup, stations=stations, events=events)
        self._sources: dict[tuple[str, str], SensorSource] = {}
        self._video: str | None = None

    def arrange(self) -> None:
        """Mix what the recipe mixes; what is not mixed for a vehicle, it perceives as it is."""
        mixed: set[tuple[str, str]] = set()
        mixers = self._mixers() if self._setup.mode == "wil" else ()
        combined = Counter(mixer.sensor for mixer in mixers)
        for mixer in mixers:
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
        if self._setup.campaign.recipe is None:
            return ()
        ids = {thing.name: thing.object_id for thing in self._setup.virtual_scene.objects}
        watch = asyncio.get_running_loop().time if self._setup.clock != "virtual" else None
        return compile_recipe(
            self._setup.campaign.recipe,
            object_ids=ids,
            stopwatch=watch,
            observer=self._probes.views,
        )

    def _mix(self, mixer: Mixer, name: str) -> None:
        real = _named(self._setup.vehicle("real"), mixer.sensor)
        twin = _named(self._setup.vehicle("twin"), mixer.sensor)
        request, perception = mixer.pose_request, self._perception
        rate_hz = mixer.combination.sensor.rate_hz
        period_s = 1.0 / _rate_hz(real)
        probe = self._probes.of(mixer, real, twin)
        mixing = MixingLoop(
            name=name,
            mixer=mixer,
            twin=None if request is None else self._senses.asked(twin, like=real),
            poses=self._stations["real" if request is None else request.pose].poses,
            wait_s=_POSE_WAIT_S,
            period_s=period_s,
            rate_hz=rate_hz,
            registration=self._registration(real),
            probe=probe if isinstance(probe, VisibilityProbe) else None,
            unmeasured="" if isinstance(probe, VisibilityProbe) else probe.why,
            tell=perception.tell,
            trouble=lambda reason: perception.budgets.spoiled(name, reason),
        )
        perception.budgets.watch(mixing, max(period_s, 1.0 / rate_hz if rate_hz else 0.0))
        self._source("real", real).takers.append(mixing.real_reading)
        if request is None:
            self._source("twin", twin).takers.append(mixing.twin_reading)
        perception.listeners.append(self._delivery(mixer, name, asked=request is not None))

    def _delivery(self, mixer: Mixer, name: str, *, asked: bool) -> Callable[[Frame], None]:
        """Return who records a mixture and hands it to the autonomies that it is for."""
        pilots = [self._perception.pilots[vehicle] for vehicle in mixer.publish]
        raw = mixer.combination.publish_raw
        subject = self._setup.subject in mixer.publish
        filmed = subject and mixer.combination.sensor.kind == "camera" and self._film(name)

        def deliver(frame: Frame) -> None:
            if frame.name != name:
                return
            if asked and frame.twin is not None:
                self._watchers.reading(frame.twin)
            self._watchers.frame(frame)
            if frame.mixed.reading is not None:
                self._watchers.perceived(frame.mixed.reading, mixer.publish)
            if filmed:
                self._show(frame)
            for pilot in pilots:
                _hand_over(pilot, frame, raw=raw)

        return deliver

    def _film(self, name: str) -> bool:
        """Return whether this is what the run's video shows: the first picture of the subject."""
        self._video = self._video or name
        return self._video == name

    def _show(self, frame: Frame) -> None:
        if isinstance(frame.mixed.reading, CameraReading):
            self._watchers.shown(
                Shown(frame.mixed.reading, _picture(frame.real), _picture(frame.twin))
            )

    def _direct(self, vehicle: VehicleSetup, sensor: SensorSetup) -> None:
        """Let a vehicle perceive its own sensor."""
        subject = vehicle.name == self._setup.subject
        filmed = subject and isinstance(sensor, CameraSetup) and self._film(sensor.name)
        self._source(vehicle.name, sensor).takers.append(
            _perceiving(self._perception.pilots[vehicle.name], self._watchers, filmed=filmed)
        )

    def _source(self, vehicle: str, sensor: SensorSetup) -> SensorSource:
        key = (vehicle, sensor.name)
        if key not in self._sources:
            stream = self._senses.stream(self._setup.vehicle(vehicle), sensor)
            source = SensorSource(vehicle, sensor.name, stream, [self._watchers.reading])
            self._sources[key] = source
        return self._sources[key]

    def _registration(self, real: SensorSetup) -> Registration | None:
        if not isinstance(real, CameraSetup | DepthSetup):
            return None
        return self._registrar.of(real)


def _perceiving(pilot: AnyPilot, watchers: Watchers, *, filmed: bool) -> Take:
    receivers = (pilot.station.name,)

    def take(reading: Reading) -> None:
        reading = without_knowledge(reading)
        watchers.perceived(reading, receivers)
        if filmed and isinstance(reading, CameraReading):
            watchers.shown(Shown(reading, reading if reading.source == "real" else None))
        pilot.perceive(reading)

    return take


def _hand_over(pilot: AnyPilot, frame: Frame, *, raw: bool) -> None:
    if raw:
        for reading in (frame.real, frame.twin):
            if reading is not None:
                pilot.perceive_raw(without_knowledge(reading))
    if frame.mixed.reading is not None:
        pilot.perceive(frame.mixed.reading)


def _picture(reading: Reading | None) -> CameraReading | None:
    return reading if isinstance(reading, CameraReading) else None


def _named(vehicle: VehicleSetup, name: str) -> SensorSetup:
    return next(sensor for sensor in vehicle.sensors if sensor.name == name)


def _rate_hz(sensor: SensorSetup) -> float:
    return sensor.rate_hz or _MOCAP_HZ
