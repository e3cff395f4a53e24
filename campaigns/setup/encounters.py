"""Encounters: pairs of attached vehicles, one of them an actor, and the distance of their fences.

Pure. Both may be hardware, which only their fences, seen from above, keep apart.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.campaigns.setup.vehicle_setups import FlownSetup, VehicleSetup
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.separation import fence_separation_m, moved_fence


@dataclass(frozen=True, slots=True)
class ActorEncounter:
    """An attached actor beside another attached vehicle in the same run.

    apart_m: between where their fences let them be, seen from above; needed_m: so that their bodies
    do not meet. other_fence: None where the other one has none.
    """

    actor: ActorSetup
    other: FlownSetup
    other_fence: Fence | None
    apart_m: float
    needed_m: float

    @property
    def is_far(self) -> bool:
        """Return whether the two cannot touch while each is inside its fence."""
        return self.other_fence is not None and self.apart_m >= self.needed_m

    @property
    def may_be_allowed(self) -> bool:
        """Return whether a person may take the responsibility that the two can touch.

        Not where the actor flies at another place as its object is virtual: it need not be near.
        """
        return self.actor.place is None and self.other_fence is not None

    @property
    def remedy(self) -> str:
        """Return the remedy other than moving the fences apart."""
        if self.may_be_allowed:
            return "or name the responsible person in `preflight.override: {separation: NAME}`"
        return "by another `place`"

    @property
    def stated_m(self) -> float:
        """Return the horizontal distance of their start places before takeoff, as in the files."""
        ours, theirs = self.actor.standing_pose, self.other.standing_pose
        return math.dist(ours.position_ned_m[:2], theirs.position_ned_m[:2])


def actor_encounters(case: Case, mode: Mode) -> Iterator[ActorEncounter]:
    """Yield each attached actor of a mode with each attached vehicle before it, except the twin.

    A twin is simulated even where it is attached.
    """
    attached = [flown for flown in case.flown_in(mode) if flown.attached and flown.name != "twin"]
    for index, actor in enumerate(attached):
        for other in attached[:index]:
            if isinstance(actor, ActorSetup):
                yield _encounter(case, actor, other)


def _encounter(case: Case, actor: ActorSetup, other: FlownSetup) -> ActorEncounter:
    ours, theirs = _fence(case, actor), _fence(case, other)
    apart_m = 0.0 if ours is None or theirs is None else fence_separation_m(ours, theirs)
    return ActorEncounter(actor, other, theirs, apart_m, actor.reach_m + _reach_m(other))


def _fence(case: Case, vehicle: FlownSetup) -> Fence | None:
    fence = case.fences.get(vehicle.name)
    if fence is None or not isinstance(vehicle, ActorSetup) or vehicle.place is None:
        return fence
    return moved_fence(fence, start=vehicle.start, to=vehicle.place)


def _reach_m(vehicle: FlownSetup) -> float:
    """Return the largest distance of a vehicle's body from its middle."""
    if isinstance(vehicle, ActorSetup):
        return vehicle.reach_m
    return math.hypot(*vehicle.body.half_m) if isinstance(vehicle, VehicleSetup) else 0.0
