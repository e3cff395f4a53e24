"""Whether the vehicles that fly as objects of the world may: where, and beside whom; pure."""

from collections.abc import Iterator

from campaigns.schema import Mode
from campaigns.setup.actor_setups import ActorSetup
from campaigns.setup.case_files import CaseFiles
from campaigns.setup.case_setup import Setup
from campaigns.setup.encounters import encounters
from safety.fence.geofence import Fence
from worlds.files.documents import Path as KeyPath
from worlds.files.documents import Problem
from worlds.frames import Vec3


def actor_problems(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield the problems of a mode's actors: cameras, fences, places, what they could touch."""
    yield from _foreign_cameras(files, setup)
    yield from _unplaced(files, setup, mode)
    for actor in setup.actors_in(mode):
        fence = setup.fences.get(actor.name)
        if fence is not None:
            yield from _way_outside_fence(files, setup, actor, fence)
        if actor.attached is not None:
            yield from _unfit_return(files, actor)
    yield from _near_misses(files, setup, mode)


def _foreign_cameras(files: CaseFiles, setup: Setup) -> Iterator[Problem]:
    """Yield cameras of a simulator that moves a flown object by its world file."""
    if not setup.actors:
        return
    actor = next(iter(setup.actors))
    for vehicle in setup.vehicles.values():
        for camera in vehicle.cameras:
            if camera.source is not None and camera.source.asked:
                said = (
                    f"a simulator is not told where the actor '{actor}' flies; leave out `source`, "
                    "or the actor"
                )
                path = ("vehicles", vehicle.name, "sensors", camera.name, "source")
                yield files.campaign.problem(path, said)


def _unplaced(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield attached actors of a mode in which nothing is to be where their object is."""
    flown = {one.name for one in setup.actors_in(mode)}
    virtual = set(setup.world.scene(mode, "Wv").names)
    for name, actor in setup.actors.items():
        if name in virtual and name not in flown:
            said = (
                f"in mode {mode} '{name}' is virtual, and an attached vehicle is physical; say by "
                "`virtual: embedded` that an embedded one flies it then, or by "
                "`virtual: {place: {north_m: ..., east_m: ...}}` where this one flies instead"
            )
            yield files.campaign.problem((*actor.path, "link"), said)


def _way_outside_fence(
    files: CaseFiles, setup: Setup, actor: ActorSetup, fence: Fence
) -> Iterator[Problem]:
    """Yield where the way of an actor leaves its own fence."""
    path: KeyPath = (*actor.path, "geofence")
    places: list[tuple[str, Vec3, Fence | None]] = [
        ("starts", actor.start.position_ned_m, fence.without_floor()),
        *(
            (f"has waypoint {index}", one.position_ned_m, fence)
            for index, one in enumerate(actor.motion.waypoints)
        ),
    ]
    for what, place, keeping in places:
        if keeping is None:
            continue
        margin_m, keep_m = keeping.margin_m(place), setup.guarding.keep_m
        side = keeping.boundary(place)
        if margin_m < 0.0:
            said = f"'{actor.name}' {what} {-margin_m:.2f} m outside of its geofence's {side}"
        elif margin_m < keep_m:
            said = (
                f"'{actor.name}' {what} {margin_m:.2f} m from its geofence's {side}, nearer than "
                f"keep_m {keep_m:g}"
            )
        else:
            continue
        yield files.campaign.problem(path, said, key=True)


def _unfit_return(files: CaseFiles, actor: ActorSetup) -> Iterator[Problem]:
    """Yield a flight back to the start beside an actor that nobody brings back."""
    if files.campaign.get(("between_runs", "do")) == "fly_back":
        said = (
            f"flies 'real' back, and the attached actor '{actor.name}' has to be put back by a "
            "person; write ask"
        )
        yield files.campaign.problem(("between_runs", "do"), said)


def _near_misses(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield attached actors that could touch another attached vehicle."""
    for one in encounters(setup, mode):
        if one.is_far or (one.may_be_allowed and "separation" in setup.preflight.override):
            continue
        if one.other_fence is None:
            said = (
                f"in mode {mode} '{one.actor.name}' flies beside '{one.other.name}', which is "
                "attached, too, and has no geofence: nothing keeps them apart; give it one"
            )
        else:
            said = (
                f"in mode {mode} its area is {one.apart_m:.2f} m from that of '{one.other.name}', "
                f"which is attached, too: they can touch; leave {one.needed_m:.2f} m between them, "
                f"seen from above, {one.remedy}"
            )
        yield files.campaign.problem((*one.actor.path, "geofence"), said, key=True)
