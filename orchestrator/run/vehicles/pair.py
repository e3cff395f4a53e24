"""Opens the pair: guard, vehicles and drivers, in the order in which they may be closed."""

from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass

from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup
from wil_campaign.orchestrator.external.motion_captures import MotionCaptures
from wil_campaign.orchestrator.run.vehicles.guard_factory import guard_of
from wil_campaign.orchestrator.run.vehicles.simulator_launch import prepare_launches
from wil_campaign.orchestrator.run.vehicles.vehicle_backends import TRUTH_HZ, VehicleFeed
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.core.commands import AnchorAt
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.safety.guard.local_guard import Record
from wil_campaign.vehicles.command_backends import command_backend_of
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.driver.vehicle_state import EstimateSample
from wil_campaign.vehicles.links.tapped import TappedLink
from wil_campaign.vehicles.poses.truth import TruthSample
from wil_campaign.worlds.scene.track import ObjectTrack

_UNJUDGED_TRUTH_HZ = 50.0
"""Rate of a truth that judges nothing: its camera interpolates it, and it is recorded."""
_CLOCK_DRIFT = 2e-4
"""Ten times the drift of the worst crystal in a vehicle's clock; only SITL drifts by more."""
_SIMULATED_CLOCK_DRIFT = 0.02
"""An attached vehicle may be a simulation, whose clock runs as fast as its machine allows."""
_SCALED_CLOCK_DRIFT = 0.1
"""The run clock follows a simulation whose pace varies."""


@dataclass(frozen=True, slots=True)
class VehiclePair:
    """The pair in flight: one vehicle context in modes sim and real, two in wil; and the guard.

    links: to the vehicles through the guard, for programs that use MAVLink beside the drivers.
    actors: the vehicles that fly as objects of the world.
    """

    contexts: tuple[VehicleContext, ...]
    vehicles: Mapping[str, VehicleFeed]
    guard: Guard
    links: Mapping[str, TappedLink]
    actors: tuple[VehicleContext, ...] = ()

    def send_anchors(self) -> None:
        """Send the guard the anchors of all vehicles' local frames, as far as known.

        With them the guard locates vehicles by their own estimates when it gets no other position,
        and limits setpoints, which are in these frames.
        """
        for context in (*self.contexts, *self.actors):
            anchor = context.driver.anchor
            if anchor is not None:
                self.guard.send(AnchorAt(context.name, anchor.origin_ned_m, anchor.turn_rad))

    def notify(self, event: str, t_s: float) -> None:
        """Notify the pair's simulations of an event of the world."""
        for vehicle in self.vehicles.values():
            vehicle.notify(event, t_s)


@asynccontextmanager
async def open_pair(
    setup: RunSetup, *, record: Record, captures: MotionCaptures, tracks: Mapping[str, ObjectTrack]
) -> AsyncIterator[VehiclePair]:
    """Start the guard, then the pair of a run, and connect to it through the guard.

    captures: external motion capture, for vehicles that have it. tracks: positions of the world's
    objects that are flown by actors. Closing stops the vehicles wherever they are: land them
    before. Raises LinkError.
    """
    async with AsyncExitStack() as stack:
        prepared = prepare_launches(setup, stack)
        guard, backend, guarded = guard_of(setup, record=record, prepared=prepared, tracks=tracks)
        links = {name: TappedLink(link) for name, link in guarded.items()}
        contexts = [
            _vehicle_context(setup, vehicle, links[vehicle.name]) for vehicle in setup.vehicles
        ]
        await stack.enter_async_context(guard)
        for vehicle in setup.guarded:
            await backend.begin(stack, vehicle)
        feeds: dict[str, VehicleFeed] = {}
        for vehicle, context in zip(setup.vehicles, contexts, strict=True):
            truth_hz = TRUTH_HZ if vehicle.name == setup.subject else _UNJUDGED_TRUTH_HZ
            feeds[vehicle.name] = feed = await backend.start(stack, vehicle)
            await stack.enter_async_context(context.driver)
            _connect_vehicle(context, feed, guard, truth_hz=truth_hz)
            if vehicle.reports_accuracy and vehicle.name == "real":
                context.driver.request_accuracy()
            if vehicle.requests_truth:
                context.driver.on_truth(context.receive_simulator)
            if not captures.listen(vehicle.name, context.receive_mocap):
                feed.on_mocap(context.receive_mocap)
        actors: list[VehicleContext] = []
        for actor in setup.actors:
            context = _vehicle_context(setup, actor, links[actor.name])
            feed = await backend.start(stack, actor)
            await stack.enter_async_context(context.driver)
            _connect_actor(context, feed, guard)
            if actor.requests_truth:
                context.driver.on_truth(context.receive_simulator)
            actors.append(context)
        backend.all_started()
        yield VehiclePair(tuple(contexts), feeds, guard, links, tuple(actors))


def _vehicle_context(setup: RunSetup, vehicle: FlownSetup, link: TappedLink) -> VehicleContext:
    driver = Driver(
        name=vehicle.name,
        link=link,
        autopilot=vehicle.autopilot,
        system_id=vehicle.system_id,
        start=vehicle.start,
        earth=None if vehicle.has_gps else setup.case.world.frame,
        rates=vehicle.rates,
        backend=command_backend_of(vehicle.driver, name=vehicle.name),
        max_clock_drift=_clock_drift(setup, vehicle),
    )
    return VehicleContext(
        vehicle.name,
        driver,
        vehicle.start,
        vehicle.pose_source,
        may_drop_out=vehicle.name == setup.companion,
        permits_dead_reckoning=vehicle.permits_dead_reckoning,
    )


def _clock_drift(setup: RunSetup, vehicle: FlownSetup) -> float:
    if setup.clock == "scaled":
        return _SCALED_CLOCK_DRIFT
    return _CLOCK_DRIFT if vehicle.embedded else _SIMULATED_CLOCK_DRIFT


def _connect_vehicle(
    context: VehicleContext, feed: VehicleFeed, guard: Guard, *, truth_hz: float
) -> None:
    context.driver.on_estimate(context.receive_estimate)
    feed.on_truth(context.receive_truth, truth_hz)
    context.on_pose(guard.position)


def _connect_actor(context: VehicleContext, feed: VehicleFeed, guard: Guard) -> None:
    """Connect an actor's estimates and its simulation's truth to its context and the guard."""

    def take(truth: TruthSample) -> None:
        t_s = truth.t_s
        context.receive_simulator(EstimateSample(t_s, t_s, t_s, truth.pose, truth.velocity_ned_m_s))

    context.driver.on_estimate(context.receive_estimate)
    feed.on_truth(take, _UNJUDGED_TRUTH_HZ)
    context.on_pose(guard.position)
