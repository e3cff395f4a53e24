"""Chooses the clock of a campaign, and refuses one on which it cannot fly."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

from wil_campaign.campaigns.expansion.expansion import Campaign
from wil_campaign.foundation.clocks.virtual_loop import Clock
from wil_campaign.foundation.files.documents import BadInput, Path
from wil_campaign.orchestrator.campaign.resuming.attached_vehicles import (
    flown_vehicles,
    planned_setups,
)

_REAL_TIME = "{} runs in real time: use --clock wall"
_NEEDS_SCALED = (
    "a pace of {:g} times real time needs the scaled clock: leave --clock out, or use --clock "
    "scaled"
)
_CANNOT_FOLLOW = (
    "{} is attached and flies in real time; fly with --clock wall, and without a speedup"
)
_NO_PACE = (
    "--clock scaled needs a pace: `clock: {speed: 4}` here for embedded vehicles, or a speedup "
    "at a launched simulation's link"
)


@dataclass(frozen=True, slots=True)
class ExternalNeeds:
    """An external resource that a campaign needs, which requires the wall clock."""

    case: str
    path: Path
    name: str


def external_needs(campaign: Campaign) -> tuple[ExternalNeeds, ...]:
    """Return the external resources of the campaign's cases that require the wall clock."""
    return tuple(
        ExternalNeeds(case, path, name)
        for case, setup in campaign.setups.items()
        for path, name in setup.needing_wall_clock()
    )


def shared_resources_of(campaign: Campaign) -> tuple[str, ...]:
    """Return the names of external resources that parallel runs would share."""
    return tuple(name for setup in campaign.setups.values() for _, name in setup.shared_by_runs())


def campaign_clock_for(campaign: Campaign, wanted: Clock | None) -> Clock:
    """Return the chosen clock. Raises BadInput when the wanted one is impossible."""
    outside = external_needs(campaign)
    paced = _own_paces(campaign)
    clock = wanted or ("scaled" if paced else "wall" if outside else "virtual")
    if clock != "wall" and outside:
        raise _refuse_clock(campaign, ((one.path, _REAL_TIME.format(one.name)) for one in outside))
    if clock == "scaled":
        _require_scalable(campaign)
    elif paced:
        raise _refuse_clock(campaign, ((path, _NEEDS_SCALED.format(pace)) for path, pace in paced))
    return clock


def _own_paces(campaign: Campaign) -> list[tuple[Path, float]]:
    """Return the launched simulations that do not run in real time: where, and their pace."""
    return [
        ((*flown_vehicle.path, "link"), pace)
        for flown_vehicle in flown_vehicles(campaign)
        if (pace := flown_vehicle.launch_pace) not in {None, 1.0}
    ]


def _require_scalable(campaign: Campaign) -> None:
    """Raise BadInput where a vehicle cannot follow the scaled clock, or no pace is given."""
    attached: list[tuple[Path, str]] = [
        ((*flown_vehicle.path, "link"), _CANNOT_FOLLOW.format(flown_vehicle.name))
        for flown_vehicle in flown_vehicles(campaign)
        if flown_vehicle.attached is not None
    ]
    if attached:
        raise _refuse_clock(campaign, attached)
    if any(setup.pace(mode) is None for setup, mode in planned_setups(campaign)):
        raise _refuse_clock(campaign, [(("clock",), _NO_PACE)])


def _refuse_clock(campaign: Campaign, faults: Iterable[tuple[Path, str]]) -> BadInput:
    problem = partial(campaign.document.problem, key=True)
    return BadInput(dict.fromkeys(problem(path, message) for path, message in faults))
