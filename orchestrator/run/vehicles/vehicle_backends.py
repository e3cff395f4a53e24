"""Vehicle backends: start vehicles in this process (virtual time) or in separate processes."""

import math
import zlib
from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack
from typing import Literal, Protocol

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.run.vehicles.simulator_launch import start_simulators
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.evaluation.judge import ground_objects
from wil_campaign.safety.guard.process.remote_guard import RemoteGuard
from wil_campaign.vehicles.autopilots.registry import autopilot_named
from wil_campaign.vehicles.embedded.physics.config import EmbeddedConfig
from wil_campaign.vehicles.embedded.physics.contact_world import (
    SceneContactWorld,
    contact_world_argument,
)
from wil_campaign.vehicles.embedded.process.embedded_launch import FeedClient
from wil_campaign.vehicles.embedded.process.process_settings import (
    ContactWorldSettings,
    ProcessSettings,
    Start,
)
from wil_campaign.vehicles.embedded.vehicle import EmbeddedVehicle
from wil_campaign.vehicles.launch import ReservedLaunch
from wil_campaign.vehicles.links.link import Link
from wil_campaign.vehicles.links.memory import memory_pair
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.vehicles.readings import PoseReading
from wil_campaign.vehicles.vehicle_server_process import vehicle_program
from wil_campaign.worlds.scene.track import ObjectTrack

_LINK_LATENCY_S = 0.003
"""One way, as measured between processes over the loopback interface, rounded up."""
_FIRST_MESSAGE_S = 20.0
"""How long a process may take to import, build its physics and send its first datagram."""
_RUNNING_S = 60.0
"""Simulated uptime of an embedded vehicle at its start, so that its filters have converged."""
TRUTH_HZ = 125.0
_ACTOR_SEEDS = 1 << 62
"""Separates the seeds of actors from those of the pair; within 64 bits."""


class VehicleFeed(Protocol):
    """What a vehicle backend provides beside MAVLink: truth, motion capture (protocol)."""

    def on_truth(self, callback: Callable[[TruthSample], None], rate_hz: float) -> None:
        """Call `callback` with the backend's truth at a rate."""

    def on_mocap(self, callback: Callable[[PoseReading], None]) -> None:
        """Call `callback` with the backend's motion capture readings."""

    def notify(self, event: str, t_s: float) -> None:
        """Pass an event of the world to the backend's vehicle."""


class VehicleBackend(Protocol):
    """Starts the vehicles of a run, once the guard holds their links (protocol)."""

    async def begin(self, stack: AsyncExitStack, vehicle: FlownSetup) -> None:
        """Begin to start a vehicle, concurrently with others. Raises LinkError."""

    async def start(self, stack: AsyncExitStack, vehicle: FlownSetup) -> VehicleFeed:
        """Start a vehicle whose link is open; the stack stops it. Raises LinkError."""

    def all_started(self) -> None:
        """Tell the backend that all vehicles have started: the clock may scale from now on."""


class InProcessBackend:
    """Vehicles in this event loop, at the far end of links in memory.

    tracks: positions of the world's objects that are flown by actors.
    """

    def __init__(self, setup: RunSetup, tracks: Mapping[str, ObjectTrack]) -> None:
        self._setup = setup
        self._tracks = tracks
        self._far: dict[str, Link] = {}

    def link(self, vehicle: FlownSetup) -> Link:
        """Return the near end of a vehicle's link in memory."""
        far, near = memory_pair(latency_s=_LINK_LATENCY_S, name=vehicle.name)
        self._far[vehicle.name] = far
        return near

    async def begin(self, stack: AsyncExitStack, vehicle: FlownSetup) -> None:
        """Do nothing: a vehicle in this loop starts at once."""

    async def start(self, stack: AsyncExitStack, vehicle: FlownSetup) -> EmbeddedVehicle:
        """Start the vehicle in this loop."""
        setup, frame = self._setup, self._setup.case.world.frame
        embedded = EmbeddedVehicle(
            config=EmbeddedConfig(
                autopilot=vehicle.autopilot,
                physics=vehicle.physics,
                profile=setup.profiles[vehicle.name],
                source=_source_of(vehicle),
                system_id=vehicle.system_id,
                start=vehicle.start,
                latitude_deg=frame.latitude_deg,
                longitude_deg=frame.longitude_deg,
                altitude_m=frame.altitude_m,
                parameters=_parameters(vehicle),
            ),
            link=self._far[vehicle.name],
            seed=vehicle_seed(setup.seed, vehicle.name),
            contact_world=self._contact_world() if vehicle.name == "real" else None,
        )
        await stack.enter_async_context(embedded)
        return embedded

    def _contact_world(self) -> SceneContactWorld:
        """Return the contact world of the real vehicle."""
        setup = self._setup
        return SceneContactWorld(
            scene=setup.real_scene,
            body=setup.vehicle("real").body,
            tracks=self._tracks,
            without=ground_objects(setup.case.oracles),
        )

    def all_started(self) -> None:
        """Do nothing: virtual time has no pace."""


class NoFeed:
    """The feed of a launched or attached vehicle: nothing beside MAVLink."""

    def on_truth(self, callback: Callable[[TruthSample], None], rate_hz: float) -> None:
        """Ignore the callback: this vehicle backend knows no truth."""

    def on_mocap(self, callback: Callable[[PoseReading], None]) -> None:
        """Ignore the callback: this vehicle backend has no motion capture."""

    def notify(self, event: str, t_s: float) -> None:
        """Ignore the event: such a vehicle does not simulate this world."""


class SubprocessBackend:
    """Vehicles in separate processes, children of the guard; or attached vehicles."""

    def __init__(
        self, setup: RunSetup, guard: RemoteGuard, prepared: Mapping[str, ReservedLaunch]
    ) -> None:
        self._setup = setup
        self._guard = guard
        self._prepared = prepared
        self._begun: dict[str, FeedClient] = {}

    async def begin(self, stack: AsyncExitStack, vehicle: FlownSetup) -> None:
        """Have the guard start an embedded vehicle's process, and read the socket of its feed."""
        if not vehicle.embedded:
            return
        client = FeedClient(source=_source_of(vehicle), end=self._guard.feed(vehicle.name))
        feed = await stack.enter_async_context(client)
        settings = self._settings(vehicle)
        program = (*vehicle_program(), settings.model_dump_json())
        await self._guard.start(vehicle.name, program)
        self._begun[vehicle.name] = feed

    async def start(self, _: AsyncExitStack, vehicle: FlownSetup) -> VehicleFeed:
        """Wait for an embedded vehicle's process, or launch a simulator; attached ones run."""
        if vehicle.name in self._begun:
            return await self._await_first_message(vehicle.name)
        if vehicle.name in self._prepared:
            await start_simulators(vehicle.name, self._prepared[vehicle.name], self._guard)
        return NoFeed()

    def all_started(self) -> None:
        """Have the guard control the scaled clock from now on."""
        self._guard.follow()

    async def _await_first_message(self, name: str) -> VehicleFeed:
        """Wait for the first message of an embedded vehicle's process."""
        feed = self._begun[name]
        first_message = start_task(feed.connected.wait(), name=f"first message of {name}")
        try:
            await self._guard.ended_or(name, first_message, _FIRST_MESSAGE_S)
        finally:
            await stop_tasks(first_message)
        return feed

    def _settings(self, vehicle: FlownSetup) -> ProcessSettings:
        setup, frame = self._setup, self._setup.case.world.frame
        north_m, east_m, down_m = vehicle.start.position_ned_m
        return ProcessSettings(
            autopilot=vehicle.autopilot,
            physics=vehicle.physics,
            link=f"udpout://127.0.0.1:{self._guard.port(vehicle.name)}",
            seed=vehicle_seed(setup.seed, vehicle.name),
            profile=vehicle.profile,
            source=_source_of(vehicle),
            system_id=vehicle.system_id,
            start=Start(
                north_m=north_m,
                east_m=east_m,
                up_m=-down_m,
                yaw_deg=math.degrees(vehicle.start.yaw_rad),
            ),
            latitude_deg=frame.latitude_deg,
            longitude_deg=frame.longitude_deg,
            altitude_m=frame.altitude_m,
            parameters=_parameters(vehicle),
            truth_hz=TRUTH_HZ,
            running_s=_RUNNING_S,
            end_with_stdin=True,
            end_with_parent=False,
            contact_world=self._contact_settings() if vehicle.name == "real" else None,
        )

    def _contact_settings(self) -> ContactWorldSettings | None:
        """Return the settings of the real vehicle's contact world; None without a world file."""
        setup = self._setup
        world = setup.order.plan.files.world
        if world is None:
            return None
        # That process does not know the actors' poses; the oracles judge contacts with them.
        actors = [actor.name for actor in setup.actors]
        return ContactWorldSettings(
            use="wil_campaign.vehicles.embedded.physics.contact_world:from_argument",
            argument=contact_world_argument(
                world,
                setup.mode,
                "W",
                body=setup.vehicle("real").body,
                without=[*actors, *ground_objects(setup.case.oracles)],
            ),
        )


def vehicle_seed(seed: int, name: str) -> int:
    """Return the seed of one vehicle: no two vehicles of a run share their noise."""
    if name in {"real", "twin"}:
        return seed * 2 + (1 if name == "twin" else 0)
    return seed * 2 ^ (_ACTOR_SEEDS + zlib.crc32(name.encode()))


def _source_of(vehicle: FlownSetup) -> Literal["real", "twin"]:
    """Return the source named in an embedded vehicle's readings; those of an actor are unused."""
    return "real" if vehicle.name == "real" else "twin"


def _parameters(vehicle: FlownSetup) -> dict[str, float]:
    """Return an embedded vehicle's parameters: it lands on link loss, unless the campaign's say."""
    return {**autopilot_named(vehicle.autopilot).failsafes.on_silence, **vehicle.params}
