"""What is legal of actors, and has to be known by who reads a result; pure."""

from collections.abc import Iterator

from campaigns.schema import Mode
from campaigns.setup.case_setup import Setup
from worlds.files.documents import Document, Problem


def estimated_actors(
    campaign: Document, setup: Setup, modes: tuple[Mode, ...]
) -> Iterator[Problem]:
    """Yield a warning for an actor whose object is where its own estimate has it."""
    estimated = dict.fromkeys(
        actor.name
        for mode in modes
        for actor in setup.actors_in(mode)
        if actor.pose_source == "mavlink"
    )
    for name in estimated:
        said = (
            f"'{name}' is drawn and judged where it is by its own estimate: no ground truth says "
            "by how much that is off"
        )
        yield campaign.problem(("actors", name), said, key=True)


def simulated_actors(
    campaign: Document, setup: Setup, modes: tuple[Mode, ...]
) -> Iterator[Problem]:
    """Yield a warning for a simulated actor that is to be physical for an attached vehicle."""
    real = setup.vehicles.get("real")
    if real is None or real.attached is None:
        return
    for mode in (one for one in modes if one != "sim"):
        physical = setup.world.scene(mode, "W")
        for actor in setup.actors_in(mode):
            if actor.name in physical and actor.attached is None:
                said = (
                    f"in mode {mode} '{actor.name}' is in the real world, where 'real' is attached "
                    f"and it is {actor.kind}: nothing of it is there; attach it, or say by "
                    "exists_in that it is virtual"
                )
                yield campaign.problem((*actor.path, "link"), said)
