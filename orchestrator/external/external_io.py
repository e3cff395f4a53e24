"""External I/O of one run: opened before its vehicles, closed after them."""

import asyncio
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from functools import reduce
from typing import Self

from wil_campaign.campaigns.values.external_setups import MocapSetup, SourceSetup
from wil_campaign.campaigns.values.sensor_setups import CameraSetup
from wil_campaign.hooks import image_sources, run_observers
from wil_campaign.installed_plugins import load_plugin_object, plugin_additions
from wil_campaign.orchestrator.external.external_readings import ReadingSources
from wil_campaign.orchestrator.external.external_sources import ExternalSource
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.orchestrator.external.requested_images import RequestedImages, requested_images
from wil_campaign.orchestrator.run_results.result_parts import ExternalResult
from wil_campaign.orchestrator.state.observer import Observer
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState, Stage
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.model.oracle_results import Flag
from wil_campaign.vehicles.readings import Reading, Source
from wil_campaign.vehicles.sources.camera_source import CameraSource

_WATCH_S = 0.1
_STALLED_S = 1.0
"""After so long without an image in flight, the run is INVALID."""
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")

Key = tuple[str, str]
"""A vehicle, and a sensor of it."""


@dataclass(slots=True)
class _Stall:
    """The images that an external camera did not deliver since its last one, and why."""

    since_s: float
    _counts: Counter[str] = field(default_factory=Counter)
    _latest: dict[str, str] = field(default_factory=dict)

    def note(self, reason: str) -> None:
        """Count a reason; reasons that differ only in numbers count as the same."""
        kind = _NUMBER.sub("#", reason)
        self._counts[kind] += 1
        self._latest[kind] = reason

    @property
    def text(self) -> str:
        """Return the most common reason, with its share where there are others."""
        (kind, count), *others = self._counts.most_common()
        share = f" ({count} of {self._counts.total()} images)" if others else ""
        return self._latest[kind] + share


class ExternalIo:
    """External I/O of one run: sources, and observers of plugins; an async context manager.

    cameras: those with external images; simulators: images that another process renders; all by
    vehicle and sensor. readings: of all other external sensors. note: records what happens to an
    input. A run without external I/O is not slowed down.
    """

    def __init__(
        self,
        *,
        setup: RunSetup,
        events: Mapping[str, float],
        note: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._setup = setup
        self._note = note
        self._events = events
        self._stack = AsyncExitStack()
        self._missing: dict[Key, _Stall] = {}
        self._on_stall: Callable[[str], None] = lambda _: None
        self.cameras: dict[Key, ExternalCamera] = {}
        self.simulators: dict[Key, RequestedImages] = {}
        for vehicle in setup.with_sensors:
            for camera in vehicle.cameras:
                self._add_camera(vehicle.name, camera)
        self.readings = ReadingSources(setup)
        captured: dict[Source, MocapSetup] = {
            one.name: one.mocap for one in setup.vehicles if one.mocap is not None
        }
        self.captures = MotionCaptures(captured)
        self._observers = tuple(_observers(setup, events))

    async def __aenter__(self) -> Self:
        """Open all external I/O. Raises SourceError, VehicleError."""
        async with AsyncExitStack() as stack:
            for camera in self.cameras.values():
                await camera.open(stack)
            await self.readings.open(stack)
            for simulator in self.simulators.values():
                await stack.enter_async_context(simulator)
            await self._warm_up_simulators()
            await self.captures.open(stack)
            for observer in self._observers:
                await observer.open(stack)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close all external I/O."""
        await self._stack.aclose()

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Return in words where a simulator shows another world than the judged one."""
        return tuple(
            f"{' '.join(key)} at {text}"
            for key, simulator in self.simulators.items()
            for text in simulator.disagreements
        )

    @property
    def environment(self) -> Mapping[str, str]:
        """Return what the observers add to the environment of programs, once they are open."""
        return {k: v for observer in self._observers for k, v in observer.environment.items()}

    def attach(self, contexts: Iterable[VehicleContext], guard: Guard) -> None:
        """Attach the vehicles, which carry external sensors, and their guard."""
        contexts = tuple(contexts)
        self.readings.attach(contexts)
        for context in contexts:
            for (vehicle, _), camera in self.cameras.items():
                if vehicle == context.name:
                    camera.attach(context)
        for observer in self._observers:
            observer.attach(contexts)
            observer.attach_guard(guard)

    async def before_arming(self, *, unbooted: Mapping[str, frozenset[str]]) -> str:
        """Check that motion capture, images and readings are received, and what observers need.

        Return in words what was checked. unbooted: by vehicle the parameters that were changed
        while it ran. Raises SourceError, VehicleError.
        """
        checked = []
        if self._setup.clock == "wall" and any(vehicle.mocap for vehicle in self._setup.vehicles):
            checked.append("motion capture is received")
        if self._setup.clock == "wall":
            await self.captures.ready()
        if live := [key for key, camera in self.cameras.items() if camera.is_live]:
            since_s = asyncio.get_running_loop().time()
            for key in live:
                await self.cameras[key].ready(since_s=since_s)
            checked.append(f"images of {', '.join(map(' '.join, live))} are received")
        if self.readings:
            checked.append(f"readings of {await self.readings.ready()} are received")
        checked += [await observer.before_arming(unbooted) for observer in self._observers]
        return "; ".join(filter(None, checked)) or "nothing external"

    async def run(self, run_state: RunState) -> None:
        """Run the observers, and watch the sources, until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(run_state.reaching("end"), name="external I/O")
            for observer in self._observers:
                for name, task in observer.tasks(run_state):
                    group.create_task(task, name=name)
            if any(vehicle.mocap is not None for vehicle in self._setup.vehicles):
                group.create_task(self._watch_captures(run_state), name="motion capture watch")
            if self.simulators:
                group.create_task(self._watch_simulators(run_state), name="simulator watch")

    def senses(self, on_stall: Callable[[str], None]) -> bool:
        """Return whether any sensor is external; `on_stall` is called when one stalls."""
        self._on_stall = on_stall
        for camera in self.cameras.values():
            camera.on_stall(on_stall)
        self.readings.on_stall(on_stall)
        return bool(self.cameras or self.simulators or self.readings)

    def missing(self, key: Key, reason: str) -> None:
        """Record that an external camera delivered no image; a short gap is no stall."""
        now_s = asyncio.get_running_loop().time()
        stall = self._missing.setdefault(key, _Stall(now_s))
        stall.note(reason)
        if now_s - stall.since_s > _STALLED_S:
            self._on_stall(f"{' '.join(key)}: {stall.text}")

    def perceived(self, reading: Reading, by: Iterable[str]) -> None:
        """Send out a perceived reading to the observers."""
        if not self._observers:
            return
        receivers = tuple(by)
        for observer in self._observers:
            observer.perceived(reading, receivers)

    def untouched(self, reading: Reading) -> None:
        """Send out a sensor's reading as the vehicle made it."""
        if self._missing:
            self._missing.pop((reading.source, reading.sensor), None)
        for observer in self._observers:
            observer.untouched(reading)

    def contact(self, flag: Flag) -> None:
        """Send out a contact at the moment it is detected."""
        for observer in self._observers:
            observer.contact(flag)

    @property
    def result(self) -> ExternalResult:
        """Return the results of all external I/O."""
        own = ExternalResult(
            sources=(
                *(camera.result for camera in self.cameras.values()),
                *self.readings.results,
                *(simulator.result for simulator in self.simulators.values()),
            ),
            captures=self.captures.results,
        )
        return reduce(
            ExternalResult.__add__, (observer.result for observer in self._observers), own
        )

    async def _watch_captures(self, run_state: RunState) -> None:
        loop, noted = asyncio.get_running_loop(), 0
        while True:
            await asyncio.sleep(_WATCH_S)
            for text in self.captures.others[noted:]:
                self._note(text)
                noted += 1
            flown = run_state.reached("takeoff") and not run_state.reached("landed")
            silent = self.captures.silent(loop.time()) if flown else ""
            if silent:
                run_state.decide("INVALID", silent, source="mocap")
                return

    async def _watch_simulators(self, run_state: RunState) -> None:
        """Decide INVALID when a simulator shows another world than the judged one."""

        def look_back(_: Stage, __: float) -> None:
            if run_state.stage == "goal" or not run_state.reached("goal") or run_state.decisive:
                return
            for key, check in self.simulators.items():
                if problem := check.look_back():
                    text = f"{' '.join(key)}: {problem}"
                    run_state.decide("INVALID", text, source="simulator", ends_flight=False)
                    return

        run_state.on_stage(look_back)
        for check in self.simulators.values():
            check.begin(lambda: run_state.stage == "goal")
        while True:
            await asyncio.sleep(_WATCH_S)
            for key, check in self.simulators.items():
                if check.fault:
                    self._on_stall(f"{' '.join(key)}: {check.fault}")

    async def _warm_up_simulators(self) -> None:
        """Render once with each simulator, from its vehicle's start. Raises SourceError."""
        now_s = asyncio.get_running_loop().time()
        for (name, sensor), simulator in self.simulators.items():
            vehicle = self._setup.vehicle(name)
            camera = next(one for one in vehicle.cameras if one.name == sensor)
            pose = camera.mount.camera_pose(vehicle.start)
            await simulator.warm_up(pose, camera.intrinsics, now_s)

    def _add_camera(self, vehicle: Source, camera: CameraSetup) -> None:
        source, key = camera.source, (str(vehicle), camera.name)
        if source is None:
            return
        if not source.renders_on_request:
            self.cameras[key] = ExternalCamera(camera=camera, source=source, side=vehicle)
            return
        scene = self._setup.real_scene if vehicle == "real" else self._setup.virtual_scene
        self.simulators[key] = requested_images(
            source,
            vehicle=vehicle,
            sensor=camera.name,
            scene=scene,
            world=self._world_name(),
            case=self._setup.order.plan.case,
            events=self._events,
        )

    def _world_name(self) -> str:
        document = self._setup.order.plan.files.world
        return "" if document is None else document.path.stem


def _observers(setup: RunSetup, events: Mapping[str, float]) -> Iterator[Observer]:
    for name, given in setup.case.observers.items():
        observer: Observer = load_plugin_object(plugin_additions(run_observers)[name].observe)(
            setup, given, events
        )
        yield observer


class ExternalCamera(ExternalSource):
    """A vehicle's camera with external images; a Stream of readings."""

    def __init__(self, *, camera: CameraSetup, source: SourceSetup, side: Source) -> None:
        super().__init__(
            sensor=camera.name, shown_as=source.shown_as, side=side, make=self._make_source
        )
        self._camera = camera
        self._setup = source

    @property
    def is_live(self) -> bool:
        """Return whether the camera's images are live."""
        return self._setup.shown_as == "live"

    async def open(self, stack: AsyncExitStack) -> None:
        """Open the external camera; a live one has an image. Raises SourceError."""
        await super().open(stack)
        await self.ready(since_s=-math.inf)

    async def ready(self, *, since_s: float) -> None:
        """Wait for an image of a live camera that arrived after a time. Raises SourceError."""
        if self._source is None or not self.is_live:
            return
        async for reading in self._source:
            if reading.arrived_s >= since_s:
                return

    def _make_source(self) -> CameraSource:
        made: CameraSource = load_plugin_object(
            plugin_additions(image_sources)[self._setup.kind].open
        )(
            self._setup,
            intrinsics=self._camera.intrinsics,
            side=self._side,
            rate_hz=self._camera.rate_hz,
        )
        return made
