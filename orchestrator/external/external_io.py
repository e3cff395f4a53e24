"""External I/O of one run: opened before its vehicles, closed after them."""

import asyncio
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import Self

from campaigns.setup.perceived_cameras import perceived_cameras
from campaigns.values.external_setups import MocapSetup
from campaigns.values.sensor_setups import CameraSetup
from orchestrator.delivery.camera_component import CameraComponent, VideoStream
from orchestrator.external.external_cameras import ExternalCamera
from orchestrator.external.external_readings import ReadingSources
from orchestrator.external.ground_station import GroundStation
from orchestrator.external.image_outlets import Outlet, Outlets, image_delivery
from orchestrator.external.injection_check import InjectionProof, prove_injection
from orchestrator.external.injector import Injector, ScenePoses
from orchestrator.external.motion_captures import MotionCaptures
from orchestrator.external.simulator_check import SimulatorCheck
from orchestrator.model.external_results import ExternalResult, SourceResult
from orchestrator.state.run_setup import RunSetup
from orchestrator.state.run_state import RunState, Stage
from orchestrator.state.vehicle_context import VehicleContext
from safety.model.oracle_results import Flag
from vehicles.links.link_factory import open_link
from vehicles.links.link_strings import parse_link
from vehicles.readings import CameraReading, Reading, Source
from vehicles.sources.simulator.shown_world import asked_world, poses_of_moving
from vehicles.sources.simulator.simulator_camera import ZmqImageSource

_WATCH_S = 0.1
_STALLED_S = 1.0
"""After so long without an image in flight, the run is INVALID."""
_FIRST_CAMERA = 100
"""MAV_COMP_ID_CAMERA; the next ones follow."""
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
    """External I/O of one run: sources, outlets, injections; an async context manager.

    cameras: those with external images; simulators: cameras that another process renders; drawn:
    the same with the check of their images in flight; all by vehicle and sensor. readings: of all
    other external sensors. A run without external I/O is not slowed down.
    """

    def __init__(self, *, setup: RunSetup, events: Mapping[str, float]) -> None:
        self._setup = setup
        self._events = events
        self._injectors: dict[str, Injector] = {}
        self._stack = AsyncExitStack()
        self._missing: dict[Key, _Stall] = {}
        self._on_stall: Callable[[str], None] = lambda _: None
        self._proofs: tuple[InjectionProof, ...] = ()
        self.cameras: dict[Key, ExternalCamera] = {}
        self.simulators: dict[Key, ZmqImageSource] = {}
        self.drawn: dict[Key, SimulatorCheck] = {}
        for vehicle in setup.with_sensors:
            for camera in vehicle.cameras:
                self._add_camera(vehicle.name, camera)
        self.readings = ReadingSources(setup)
        captured: dict[Source, MocapSetup] = {
            one.name: one.mocap for one in setup.vehicles if one.mocap is not None
        }
        self.captures = MotionCaptures(captured)
        self.outlets = Outlets(self._outlets())
        self._ground = self._ground_station()

    async def __aenter__(self) -> Self:
        """Open all external I/O. Raises SourceError, DeliveryError, LinkError."""
        async with AsyncExitStack() as stack:
            for camera in self.cameras.values():
                await camera.open(stack)
            await self.readings.open(stack)
            for simulator in self.simulators.values():
                await stack.enter_async_context(simulator)
            await self._warm_up_simulators()
            await self.captures.open(stack)
            await self.outlets.open(stack)
            if self._ground is not None:
                await stack.enter_async_context(self._ground.link)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close all external I/O."""
        await self._stack.aclose()

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Return in words where a simulator shows another world than the judged one."""
        return tuple(
            f"{' '.join(key)} at {simulator.name}: {text}"
            for key, simulator in self.simulators.items()
            for text in simulator.disagreements
        )

    def attach(self, contexts: Iterable[VehicleContext]) -> None:
        """Attach the vehicles whose autopilots receive injections, and carry external sensors."""
        setup, contexts = self._setup, tuple(contexts)
        self.readings.attach(contexts)
        for context in contexts:
            for (vehicle, _), camera in self.cameras.items():
                if vehicle == context.name:
                    camera.attach(context)
        scene_poses = ScenePoses(
            setup.virtual_scene if setup.mode != "real" else setup.real_scene,
            setup.campaign.world.frame,
            self._events,
        )
        for context in contexts:
            injector = Injector(
                context=context,
                autopilot=setup.vehicle(context.name).autopilot,
                injections=setup.campaign.outside.injections,
                scene_poses=scene_poses,
            )
            if injector.injections:
                self._injectors[context.name] = injector
                context.on_mocap(injector.pose)

    async def before_arming(
        self, contexts: Iterable[VehicleContext], *, unbooted: Mapping[str, frozenset[str]]
    ) -> str:
        """Check that motion capture and readings are received, and that injections are used.

        Return in words what was checked. unbooted: by vehicle the parameters that were changed
        while it ran. Raises SourceError, UnsupportedInjectionError.
        """
        checked = []
        if self._setup.clock == "wall" and any(one.mocap for one in self._setup.vehicles):
            checked.append("motion capture is received")
        if self._setup.clock == "wall":
            await self.captures.ready()
        if self.readings:
            checked.append(f"readings of {await self.readings.ready()} are received")
        if self._injectors:
            checked.append(f"injections into {' and '.join(self._injectors)} are used")
            vehicles = {str(one.name): one for one in self._setup.vehicles}
            injections = self._setup.campaign.outside.injections
            self._proofs = await prove_injection(contexts, vehicles, injections, unbooted=unbooted)
        return "; ".join(checked) or "nothing external"

    async def run(self, run_state: RunState) -> None:
        """Send to autopilots and ground station, and watch the sources, until cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(run_state.reaching("end"), name="external I/O")
            for name, injector in self._injectors.items():
                group.create_task(injector.run(), name=f"injection into {name}")
            if self._ground is not None:
                group.create_task(self._ground.run(), name="ground station")
            if any(one.mocap is not None for one in self._setup.vehicles):
                group.create_task(self._watch_captures(run_state), name="motion capture watch")
            if self._injectors:
                group.create_task(self._watch_injection(run_state), name="injection watch")
            if self.drawn:
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
        """Send out a perceived reading: to outlets and to autopilots."""
        if not self._injectors and not self.outlets:
            return
        receivers = tuple(by)
        for name in receivers:
            if name in self._injectors:
                self._injectors[name].perceived(reading.sensor, reading)
        if isinstance(reading, CameraReading):
            self.outlets.perceived(reading.sensor, reading, receivers)

    def untouched(self, reading: Reading) -> None:
        """Send out a sensor's reading as the vehicle made it."""
        if self._missing:
            self._missing.pop((reading.source, reading.sensor), None)
        if self.outlets and isinstance(reading, CameraReading):
            self.outlets.untouched(reading.sensor, reading)

    def contact(self, flag: Flag) -> None:
        """Send out a contact at the moment it is detected."""
        if self._ground is None:
            return
        objects = self._setup.judged_scene.objects
        ids = (one.object_id for one in objects if one.name in flag.text)
        self._ground.contact(f"{flag.vehicle} {flag.text}", object_id=next(ids, 0))

    @property
    def result(self) -> ExternalResult:
        """Return the results of all external I/O."""
        return ExternalResult(
            sources=(
                *(camera.result for camera in self.cameras.values()),
                *self.readings.results,
                *(
                    _simulated_source_result(*key, one, self.drawn[key])
                    for key, one in self.simulators.items()
                ),
            ),
            captures=self.captures.results,
            outlets=self.outlets.results,
            injected=tuple(r for one in self._injectors.values() for r in one.results),
        )

    async def _watch_captures(self, run_state: RunState) -> None:
        loop = asyncio.get_running_loop()
        while True:
            await asyncio.sleep(_WATCH_S)
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
            for key, check in self.drawn.items():
                if problem := check.look_back():
                    text = f"{' '.join(key)}: {problem}"
                    run_state.decide("INVALID", text, source="simulator", ends_flight=False)
                    return

        run_state.on_stage(look_back)
        for check in self.drawn.values():
            check.begin(lambda: run_state.stage == "goal")
        while True:
            await asyncio.sleep(_WATCH_S)
            for key, check in self.drawn.items():
                if check.fault:
                    self._on_stall(f"{' '.join(key)}: {check.fault}")

    async def _watch_injection(self, run_state: RunState) -> None:
        """End the flight as INVALID when an autopilot ignores its injections.

        Only after two checks in a row: a mode change may be in progress.
        """
        before = ""
        while True:
            await asyncio.sleep(_WATCH_S)
            problems = ""
            if run_state.stage == "goal" and not run_state.decisive:
                broken = ((proof, proof.broken()) for proof in self._proofs)
                problems = "; ".join(proof.text_of(reasons) for proof, reasons in broken if reasons)
            if problems and problems == before:
                text = f"injection was ignored: {problems}"
                run_state.decide("INVALID", text, source="injection")
                return
            before = problems

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
        self.simulators[key] = ZmqImageSource(
            address=source.address,
            timeout_s=source.answer_s,
            open_timeout_s=source.open_s,
            world=asked_world(scene, world=self._world_name(), case=self._setup.order.plan.case),
            events=lambda: dict(self._events),
            moved=lambda t_s: poses_of_moving(scene, t_s, self._events),
        )
        self.drawn[key] = SimulatorCheck(
            simulator=self.simulators[key], scene=scene, events=self._events
        )

    def _world_name(self) -> str:
        document = self._setup.order.plan.files.world
        return "" if document is None else document.path.stem

    def _outlets(self) -> Iterable[Outlet]:
        there = {vehicle.name: vehicle for vehicle in self._setup.with_sensors}
        for outlet in self._setup.campaign.outside.outlets:
            perceived = outlet.of == "perceived"
            name = (outlet.vehicle or self._setup.subject) if perceived else outlet.of
            if name not in there:
                continue
            cameras = {camera.name: camera for camera in there[name].cameras}
            if perceived:
                shown = perceived_cameras(self._setup.campaign, self._setup.mode, name)
                cameras |= {camera.name: camera for camera in shown}
            camera = cameras[outlet.sensor]
            sdp = self._setup.order.folder / f"{outlet.sensor}-{outlet.of}.sdp"
            delivery = image_delivery(outlet, camera, sdp_path=sdp)
            yield Outlet(delivery, outlet.sensor, name, perceived)

    def _ground_station(self) -> GroundStation | None:
        outside = self._setup.campaign.outside
        if outside.ground_station is None:
            return None
        system_id = self._setup.vehicle(self._setup.subject).system_id
        streams = [one for one in outside.outlets if one.kind == "rtp"]
        cameras = self._setup.vehicle(self._setup.subject).cameras
        components = tuple(
            CameraComponent(
                system_id=system_id,
                intrinsics=camera.intrinsics,
                stream=VideoStream(
                    port=int(one.address.rpartition(":")[2]), rate_hz=camera.rate_hz, name=one.topic
                ),
                component_id=_FIRST_CAMERA + number,
            )
            for number, one in enumerate(streams)
            for camera in cameras
            if camera.name == one.sensor
        )
        link = open_link(parse_link(outside.ground_station))
        return GroundStation(link=link, system_id=system_id, cameras=components)


def _simulated_source_result(
    vehicle: str, sensor: str, simulator: ZmqImageSource, check: SimulatorCheck
) -> SourceResult:
    """Return the result of a camera rendered by an external simulator."""
    counts = simulator.counts
    return SourceResult(
        vehicle=vehicle,
        sensor=sensor,
        source="rendered",
        delivered=counts.answered,
        dropped=counts.late,
        missed=counts.timeouts,
        damaged=counts.garbage + counts.refused,
        stalls=0,
        trouble=simulator.trouble,
        measured=check.coverage.frames,
        not_measured=check.not_measured,
    )
