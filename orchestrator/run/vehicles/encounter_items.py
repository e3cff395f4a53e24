"""Preflight items of an attached actor and another attached vehicle: fences and distance."""

from collections.abc import Iterable, Iterator

from wil_campaign.campaigns.setup.encounters import actor_encounters
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.vehicle_context import VehicleContext
from wil_campaign.safety.preflight import PreflightItem, distance_item, separation_item
from wil_campaign.worlds.frames import norm
from wil_campaign.worlds.geodesy import LocalFrame


def encounter_items(setup: RunSetup, contexts: Iterable[VehicleContext]) -> Iterator[PreflightItem]:
    """Yield for each encounter whether fences separate the two, and whether they stand as stated.

    contexts: of all vehicles that fly, or of those that stand.
    """
    places_deg = {context.name: context.driver.place_deg for context in contexts}
    for encounter in actor_encounters(setup.case, setup.mode):
        name, other = encounter.actor.name, encounter.other.name
        if not {name, other} <= places_deg.keys():
            continue
        yield separation_item(name, other, encounter.apart_m, encounter.needed_m)
        measured_m = distance_m(places_deg[name], places_deg[other])
        yield distance_item(name, other, measured_m, stated_m=encounter.stated_m)


def distance_m(one: tuple[float, float] | None, other: tuple[float, float] | None) -> float | None:
    """Return the horizontal distance of two places on Earth; None where one is unknown."""
    if one is None or other is None:
        return None
    frame = LocalFrame(*other, 0.0)
    north_m, east_m, _ = frame.to_ned(*one, 0.0)
    return norm((north_m, east_m, 0.0))
