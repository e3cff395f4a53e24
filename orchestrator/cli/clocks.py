"""Which clock a campaign can be flown on."""

from dataclasses import dataclass

from campaigns.expansion import Campaign
from orchestrator.clock import Clock
from worlds.documents import BadInput, Path


@dataclass(frozen=True, slots=True)
class Outside:
    """Something of a campaign that is outside of this process, and so comes in real time."""

    case: str
    path: Path
    name: str


def outside_of(campaign: Campaign) -> tuple[Outside, ...]:
    """Return everything in the campaign's cases that needs the wall clock."""
    return tuple(
        Outside(case, path, name)
        for case, setup in campaign.setups.items()
        for path, name in setup.needing_wall_clock()
    )


def clock_for(campaign: Campaign, wanted: Clock | None) -> Clock:
    """Return the clock to fly on. Raises BadInput when the wanted one cannot be had."""
    outside = outside_of(campaign)
    if wanted is None:
        return "wall" if outside else "virtual"
    if wanted == "virtual" and outside:
        raise BadInput(
            dict.fromkeys(
                campaign.document.problem(
                    one.path, f"{one.name} comes in real time: fly with --clock wall", key=True
                )
                for one in outside
            )
        )
    return wanted
