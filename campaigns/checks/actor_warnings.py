"""Warnings of actors that are valid, but limit what a result proves; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.case_setup import Case
from wil_campaign.foundation.files.documents import Document, Problem


def estimated_actor_warnings(
    file: Document, case: Case, modes: tuple[Mode, ...]
) -> Iterator[Problem]:
    """Yield a warning for an actor whose object is placed by the actor's own position estimate."""
    estimated = dict.fromkeys(
        actor.name
        for mode in modes
        for actor in case.actors_in(mode)
        if actor.pose_source == "mavlink"
    )
    for name in estimated:
        message = (
            f"'{name}' is drawn and judged at its own position estimate: without ground truth the "
            "error of the estimate is unknown"
        )
        yield file.problem(("actors", name), message, key=True)


def simulated_actor_warnings(
    file: Document, case: Case, modes: tuple[Mode, ...]
) -> Iterator[Problem]:
    """Yield a warning for a simulated actor in the real world of an attached vehicle."""
    real = case.vehicles.get("real")
    if real is None or real.attached is None:
        return
    for mode in (one for one in modes if one != "sim"):
        physical = case.world.scene(mode, "W")
        for actor in case.actors_in(mode):
            if actor.name in physical and actor.attached is None:
                message = (
                    f"in mode {mode} '{actor.name}' exists in the real world, where 'real' is "
                    f"attached, but its vehicle is {actor.kind}: nothing is physically there; "
                    "attach it, or make it virtual by exists_in"
                )
                yield file.problem((*actor.path, "link"), message)
