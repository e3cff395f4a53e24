"""The steps between ready and armed, in a fixed order and one record: configure, check, anchor.

Anchors an autopilot's local frame in the world by motion capture.
"""

import asyncio
import math
from collections.abc import Collection, Iterable

from wil_campaign.orchestrator.external.external_io import ExternalIo
from wil_campaign.orchestrator.run.stages.distinct_vehicles import require_distinct_vehicles
from wil_campaign.orchestrator.run.stages.drop_outs import each_vehicle
from wil_campaign.orchestrator.run.vehicles.arming_record import ArmingRecord
from wil_campaign.orchestrator.run.vehicles.onboard_configuration import OnboardConfiguration
from wil_campaign.orchestrator.run.vehicles.preflight_checks import PreflightChecks
from wil_campaign.orchestrator.run_results.result_parts import ArmingStep
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import FlightError
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.guard.guard import Guard
from wil_campaign.vehicles.errors import AnchorError, VehicleError
from wil_campaign.vehicles.links.udp import RIVAL_REMEDY
from wil_campaign.vehicles.poses.anchor import Anchor, PoseAverage

_SPAN_S = 1.0
_SAMPLE_S = 0.05
_STILL_M = 0.1
"""Motion capture sees a standing vehicle to millimetres."""


async def anchor_by_mocap(context: VehicleContext) -> Anchor:
    """Anchor a vehicle's estimate in motion capture's frame, over a second; return the anchor.

    Raises AnchorError when either source has too few poses, or moves.
    """
    loop = asyncio.get_running_loop()
    local, world = PoseAverage(span_s=_SPAN_S), PoseAverage(span_s=_SPAN_S, still_within_m=_STILL_M)
    until_s = loop.time() + _SPAN_S
    while loop.time() < until_s:
        now_s = loop.time()
        estimate = context.driver.state.local
        if estimate is not None:
            local.add(now_s, estimate.pose)
        # Looked up as late as motion capture arrives, so that no pose is predicted.
        captured = context.poses.at(now_s - 2.0 * _SAMPLE_S)
        if captured.pose is not None and captured.kind == "interpolated":
            world.add(now_s, captured.pose)
        await asyncio.sleep(_SAMPLE_S)
    try:
        anchor = Anchor.of_poses(local=local.mean(), world=world.mean())
    except AnchorError as error:
        raise AnchorError(
            f"{context.name}, anchored by motion capture: {error}; keep it still and in view"
        ) from error
    context.driver.set_anchor(anchor)
    return anchor


_LISTENED_S = 3.2
"""Three heartbeats: so long an attached vehicle is listened to, from its identification on, until
it arms; what else has its ids has been received by then."""


_READY_AGAIN_S = 30.0
"""Less than the watchdog lets the stage of arming last: each was ready before."""
_ANCHORED_S = 0.2
"""After so long the newest pose is by the newest anchor; positions come at 25 Hz at least."""


class BeforeArming:
    """Applies what vehicles need before they arm, and restores it in reverse when they are down.

    The order: actors identified and ready as the pair is; of each vehicle its parameters, then its
    fence, each read back; ready again, for the estimate of the vehicle that was ready first may
    have drifted; external inputs checked, and what observers need; anchors by motion capture; the
    preflight, which checks the result. Before and after all this, no vehicle may have a rival with
    its system id. After an operator's hold on the ground, `check_again`. contexts: of the pair.
    """

    def __init__(
        self,
        *,
        setup: RunSetup,
        guard: Guard,
        contexts: tuple[VehicleContext, ...],
        external_io: ExternalIo,
        preflight: PreflightChecks,
        configuration: OnboardConfiguration,
        record: ArmingRecord,
        actors: tuple[VehicleContext, ...] = (),
    ) -> None:
        self._setup = setup
        self._guard = guard
        self._contexts = contexts
        self._external_io = external_io
        self._preflight = preflight
        self._record = record
        self._actors = actors
        self._reboots: dict[str, int] = {}
        """How often each vehicle had rebooted when it was configured."""
        self.configuration = configuration

    @property
    def steps(self) -> tuple[ArmingStep, ...]:
        """Return what was done, oldest first."""
        return self._record.steps

    async def apply(self) -> None:
        """Run all steps; the first error is raised.

        Raises VehicleError, FlightError with every reason of the preflight, SourceError,
        AnchorError.
        """
        timeout_s = self._setup.case.sync.ready_timeout_s
        flown = (*self._contexts, *self._actors)
        for actor in self._actors:
            with self._record.step("actor", actor.name):
                await actor.driver.identify(self._setup.case.sync.identify_timeout_s)
                await actor.driver.ready(timeout_s)
        require_distinct_vehicles(flown)
        self._refuse_rivals()
        self._reboots = {one.name: one.driver.clock.reboots for one in flown}
        try:
            await each_vehicle(flown, self.configuration.apply)
            await each_vehicle(flown, lambda context: context.driver.ready(timeout_s))
        except VehicleError:
            # Two vehicles that answer each request refuse a fence, for one; and the second may have
            # been switched on a moment ago.
            await self._listen(flown, anew=True)
            raise
        with self._record.step("external") as record:
            unbooted = self.configuration.unbooted
            record(await self._external_io.before_arming(unbooted=unbooted))
        await self._check(self._contexts, self._actors)

    async def check_again(self, contexts: tuple[VehicleContext, ...]) -> None:
        """Check vehicles of the pair once more that stood through an operator's hold, and actors.

        Meanwhile a battery runs down or is changed, and a vehicle is moved. Raises as `apply` does.
        """
        timeout_s = min(_READY_AGAIN_S, self._setup.case.sync.ready_timeout_s)
        standing = (*contexts, *(one for one in self._actors if not one.driver.state.armed))
        anchors = {one.name: one.driver.anchor for one in contexts}
        await each_vehicle(standing, lambda one: one.driver.ready(timeout_s))
        for context in contexts:
            self._refuse_rebooted(context)
            self._refuse_moved(context, anchors[context.name])
        await asyncio.sleep(_ANCHORED_S)
        await self._check(contexts, standing[len(contexts) :])

    async def _check(
        self, contexts: tuple[VehicleContext, ...], actors: tuple[VehicleContext, ...]
    ) -> None:
        """Anchor configured vehicles by motion capture, and run the preflight."""
        captured = [one for one in contexts if self._setup.vehicle(one.name).anchor == "mocap"]
        await asyncio.gather(*map(self._anchor, captured))
        await self._listen((*contexts, *actors))
        with self._record.step("preflight") as record:
            record(await self._preflight.check(contexts, actors))
        for context in (*contexts, *actors):
            self._refuse_rebooted(context)
        self._refuse_rivals()

    async def restore(self, *, at_rest: Collection[str]) -> None:
        """Restore the configuration of the attached vehicles that are confirmed to be at rest.

        A failure, and a vehicle that keeps this run's, decides the run as ERROR.
        """
        await self.configuration.restore(at_rest=at_rest)

    async def _listen(self, flown: Iterable[VehicleContext], *, anew: bool = False) -> None:
        """Listen to attached vehicles for long enough to notice another sender behind each link.

        anew: from now on, and not from their identification on. Raises VehicleError for one.
        """
        attached = [one for one in flown if self._setup.flown(one.name).attached is not None]
        for context in attached:
            context.driver.request_version()
        until_s = asyncio.get_running_loop().time() + _LISTENED_S if anew else 0.0
        for context in attached:
            left_s = until_s - asyncio.get_running_loop().time()
            await asyncio.sleep(max(0.0, left_s, _LISTENED_S - context.driver.received_for_s))
        for context in attached:
            context.driver.require_alone()

    def _refuse_rebooted(self, context: VehicleContext) -> None:
        """Refuse a vehicle that rebooted since it was configured. Raises FlightError."""
        if context.driver.clock.reboots != self._reboots[context.name]:
            raise FlightError(
                f"{context.name} rebooted after its parameters and fence had been set and read "
                "back: start the run again"
            )

    def _refuse_moved(self, context: VehicleContext, before: Anchor | None) -> None:
        """Refuse a vehicle that was moved away from its onboard fence. Raises FlightError.

        before: its anchor when the fence was uploaded. An estimate that drifts is not told apart.
        """
        wider, now = self._setup.case.preflight.fence, context.driver.anchor
        local = context.driver.state.local
        if wider is None or before is None or now is None or local is None:
            return
        if self._setup.case.fences.get(context.name) is None:
            return
        place_m = local.pose.position_ned_m
        moved_m = math.dist(before.position(place_m)[:2], now.position(place_m)[:2])
        if moved_m > wider.margin_m:
            raise FlightError(
                f"{context.name} was moved by {moved_m:.1f} m after its fence had been uploaded: "
                "start the run again"
            )

    def _refuse_rivals(self) -> None:
        """Refuse two vehicles with one system id at one port, and two senders of poses.

        Raises FlightError, SourceError.
        """
        rival = next((event for event in self._guard.events if event.kind == "rival"), None)
        if rival is not None:
            raise FlightError(f"{rival.vehicle}: {rival.text}; {RIVAL_REMEDY}")
        self._external_io.captures.refuse_rivals()

    async def _anchor(self, context: VehicleContext) -> None:
        with self._record.step("anchor", context.name) as record:
            anchor = await anchor_by_mocap(context)
            north_m, east_m, down_m = anchor.origin_ned_m
            record(f"its origin: north {north_m:.3f} m, east {east_m:.3f} m, down {down_m:.3f} m")
