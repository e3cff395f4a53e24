"""Onboard fences, enforced by the autopilots behind the guard's: uploaded, changed, restored.

Converts a campaign's fence into one that an autopilot enforces: areas and a ceiling; pure.
"""

import asyncio
from collections.abc import Callable, Mapping

from wil_campaign.foundation.tasks import raising_first_task_error
from wil_campaign.orchestrator.run.vehicles.preflight_checks import (
    ceiling_above_home_m,
    lower_return_parameters,
    sets_failsafes,
)
from wil_campaign.orchestrator.run.vehicles.restoration import Restoration
from wil_campaign.orchestrator.state.parameter_backups import parameter_backup_folder
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.fence.areas import Point2
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.onboard_areas import LocalArea, onboard_areas
from wil_campaign.vehicles.driver.onboard.fence_protocol import AutopilotFence
from wil_campaign.vehicles.driver.onboard.onboard_fence import OnboardFence
from wil_campaign.vehicles.driver.onboard.parameter_backup import ParameterValue
from wil_campaign.vehicles.errors import VehicleError
from wil_campaign.vehicles.mavlink.fence_areas import (
    FenceArea,
    FenceCircle,
    FencePlace,
    FencePolygon,
)
from wil_campaign.worlds.frames import Vec3

Locate = Callable[[Point2], FencePlace]
"""Returns the place on Earth of a point of the world; north and east in metres."""


def onboard_fence_of(
    fence: Fence, *, margin_m: float, home_ned_m: Vec3, here_m: Point2, locate: Locate
) -> AutopilotFence:
    """Convert a campaign's fence into an onboard fence, wider by a margin.

    home_ned_m: its ceiling is relative to this. here_m: as in `onboard_areas`. Raises ValueError
    for a ceiling that is not above home.
    """
    areas = tuple(_located(area, locate) for area in onboard_areas(fence, margin_m, here_m))
    ceiling_m = None
    if fence.ceiling_up_m is not None:
        ceiling_m = fence.ceiling_up_m + home_ned_m[2] + margin_m
    return AutopilotFence(areas=areas, ceiling_m=ceiling_m, action="land")


def _located(area: LocalArea, locate: Locate) -> FenceArea:
    if isinstance(area, FenceCircle):
        return FenceCircle(locate(area.centre), area.radius_m, inside=area.inside)
    return FencePolygon(tuple(map(locate, area.corners)), inside=area.inside)


Note = Callable[..., None]

_LOCATION_TIMEOUT_S, _LOCATION_POLL_S = 3.0, 0.05
"""How long to wait for a vehicle's place on Earth: sent twice a second, over a lossy radio."""


class OnboardFences:
    """Uploads onboard fences to a run's autopilots, read back; wider than the guard's.

    note: records events. Does nothing where the campaign uploads none (`preflight.fence: null`).
    """

    def __init__(
        self, *, setup: RunSetup, contexts: tuple[VehicleContext, ...], note: Note
    ) -> None:
        self._setup = setup
        self._contexts = {context.name: context for context in contexts}
        self._note = note
        self._onboard: dict[str, OnboardFence] = {}
        self._ceilings_m: dict[str, float | None] = {}

    @property
    def unsettled(self) -> tuple[str, ...]:
        """Return vehicles whose offered onboard fence is neither confirmed nor undone."""
        return tuple(name for name, onboard in self._onboard.items() if onboard.unsettled)

    async def upload(self, context: VehicleContext, restoration: Restoration) -> str:
        """Upload the campaign's fence to a vehicle on the ground; return in words which.

        restoration: gives an attached vehicle its own fence back. Raises VehicleError.
        """
        if self._setup.case.preflight.fence is None:
            return "none uploaded: preflight.fence is null"
        vehicle = self._setup.flown(context.name)
        attached = vehicle.attached is not None
        onboard = OnboardFence(
            fences=context.driver.onboard.fences,
            parameters=context.driver.parameters,
            autopilot=context.driver.identity.autopilot,
            backup_folder=parameter_backup_folder() if attached else None,
        )
        if attached:
            await restoration.enter(onboard)
        fence = self._setup.case.fences.get(vehicle.name)
        self._ceilings_m[context.name] = ceiling_above_home_m(self._setup, vehicle)
        text = "none: the campaign has no fence for this vehicle"
        if fence is not None:
            await _await_location(context)
            start_m = context.start.position_ned_m
            onboard_fence = self._onboard_fence(context, fence, (start_m[0], start_m[1]))
            await onboard.keep(onboard_fence)
            self._report(context.name, onboard_fence)
            high = (
                ""
                if onboard_fence.ceiling_m is None
                else f", ceiling {onboard_fence.ceiling_m:.2f} m above home"
            )
            text = f"{len(onboard_fence.areas)} areas{high}"
        self._onboard[context.name] = onboard
        return text

    async def offer(self, fences: Mapping[str, Fence]) -> None:
        """Upload other fences to flying vehicles, each read back.

        Raises VehicleError of the first upload that fails; then, and when cancelled, `restore` has
        to be called, otherwise `confirm`.
        """
        if self._setup.case.preflight.fence is None:
            return
        for name in fences:
            if name not in self._onboard:
                raise VehicleError(
                    f"{name} is not ready yet: try again once its first fence is uploaded"
                )
        with raising_first_task_error(VehicleError):
            async with asyncio.TaskGroup() as group:
                for name, fence in fences.items():
                    group.create_task(self._offer(name, fence), name=f"{name} fence")

    async def confirm(self) -> None:
        """Confirm the offered onboard fences: they stay."""
        for name in self.unsettled:
            onboard = self._onboard[name]
            await onboard.confirm()
            if onboard.fence is not None:
                self._report(name, onboard.fence)

    async def restore(self) -> None:
        """Restore the onboard fences from before the offer, of all vehicles.

        Raises VehicleError if one failed; it has to be called again then.
        """
        names = self.unsettled
        results = await asyncio.gather(
            *(self._onboard[name].put_back() for name in names), return_exceptions=True
        )
        for name, result in zip(names, results, strict=True):
            if result is None:
                self._note("fence_put_back", vehicle=name)
        for result in results:
            if result is not None:
                raise result

    async def _offer(self, name: str, fence: Fence) -> None:
        context = self._contexts[name]
        here = context.poses.latest().pose
        place_m = (context.start if here is None else here).position_ned_m
        onboard_fence = self._onboard_fence(context, fence, (place_m[0], place_m[1]))
        also = await self._return_beneath(context, fence)
        await self._onboard[name].offer(onboard_fence, also)

    async def _return_beneath(
        self, context: VehicleContext, fence: Fence
    ) -> Mapping[str, ParameterValue]:
        """Return the parameters that keep the return (RTL) altitude beneath a lowered ceiling.

        Raises VehicleError where these may not be set.
        """
        vehicle = self._setup.flown(context.name)
        before_m = self._ceilings_m.get(context.name)
        ceiling_m = ceiling_above_home_m(self._setup, vehicle, fence)
        if ceiling_m is None or (before_m is not None and ceiling_m >= before_m):
            return {}
        if "return_altitude" in self._setup.case.preflight.override:
            return {}
        driver = context.driver
        lower = await lower_return_parameters(
            driver.identity.autopilot, driver.parameters, ceiling_m=ceiling_m
        )
        if sets_failsafes(self._setup, vehicle) and not lower.keys() & vehicle.params.keys():
            return lower
        for name in lower:
            raise VehicleError(
                f"{context.name} returns (RTL) above the new ceiling; set {name} in the vehicle"
            )
        return {}

    def _onboard_fence(
        self, context: VehicleContext, fence: Fence, here_m: Point2
    ) -> AutopilotFence:
        wider = self._setup.case.preflight.fence

        def locate(point_m: Point2) -> FencePlace:
            place = context.driver.place_of((*point_m, 0.0))
            return FencePlace(place.latitude_deg, place.longitude_deg)

        try:
            return onboard_fence_of(
                fence,
                margin_m=0.0 if wider is None else wider.margin_m,
                home_ned_m=context.start.position_ned_m,
                here_m=here_m,
                locate=locate,
            )
        except ValueError as error:
            raise VehicleError(f"{context.name}: {error}") from error

    def _report(self, name: str, onboard_fence: AutopilotFence) -> None:
        self._note(
            "fence", vehicle=name, areas=len(onboard_fence.areas), ceiling_m=onboard_fence.ceiling_m
        )


async def _await_location(context: VehicleContext) -> None:
    """Wait until a vehicle reports its place on Earth, for its onboard fence."""
    for _ in range(round(_LOCATION_TIMEOUT_S / _LOCATION_POLL_S)):
        if context.driver.place_deg is not None:
            return
        await asyncio.sleep(_LOCATION_POLL_S)
