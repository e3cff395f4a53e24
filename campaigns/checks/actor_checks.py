"""Checks of actors, vehicles that fly as objects of the world: fences, places, separation; pure."""

from collections.abc import Iterator

from wil_campaign.campaigns.schema import Mode
from wil_campaign.campaigns.setup.actor_setups import ActorSetup
from wil_campaign.campaigns.setup.case_files import CaseFiles
from wil_campaign.campaigns.setup.case_setup import Setup
from wil_campaign.campaigns.setup.encounters import encounters
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.worlds.figures import distinct_text
from wil_campaign.worlds.files.documents import Path as KeyPath
from wil_campaign.worlds.files.documents import Problem
from wil_campaign.worlds.frames import Vec3


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
    """Yield cameras whose images a simulator renders: it moves an actor's object by itself."""
    if not setup.actors:
        return
    actor = next(iter(setup.actors))
    for vehicle in setup.vehicles.values():
        for camera in vehicle.cameras:
            if camera.source is not None and camera.source.renders_on_request:
                message = (
                    f"the simulator of this camera does not receive the position of the actor "
                    f"'{actor}'; remove `source`, or the actor"
                )
                path = ("vehicles", vehicle.name, "sensors", camera.name, "source")
                yield files.campaign.problem(path, message)


def _unplaced(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield attached actors of a mode in which their object is virtual and nothing may fly it."""
    flown = {one.name for one in setup.actors_in(mode)}
    virtual = set(setup.world.scene(mode, "Wv").names)
    for name, actor in setup.actors.items():
        if name in virtual and name not in flown:
            message = (
                f"in mode {mode} '{name}' is virtual, but an attached vehicle is physical; write "
                "`virtual: embedded` to fly an embedded vehicle instead, or "
                "`virtual: {place: {north_m: ..., east_m: ...}}` to fly this one at another place"
            )
            yield files.campaign.problem((*actor.path, "link"), message)


def _way_outside_fence(
    files: CaseFiles, setup: Setup, actor: ActorSetup, fence: Fence
) -> Iterator[Problem]:
    """Yield the start and the waypoints of an actor that are outside its own fence, or too near."""
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
            message = f"'{actor.name}' {what} {-margin_m:.2f} m outside of its geofence's {side}"
        elif margin_m < keep_m:
            message = (
                f"'{actor.name}' {what} {distinct_text(margin_m, keep_m)} m from its geofence's "
                f"{side}, nearer than keep_m {keep_m:g}"
            )
        else:
            continue
        yield files.campaign.problem(path, message, key=True)


def _unfit_return(files: CaseFiles, actor: ActorSetup) -> Iterator[Problem]:
    """Yield `fly_back` between runs where an attached actor has to be returned by a person."""
    if files.campaign.get(("between_runs", "do")) == "fly_back":
        message = (
            f"flies only 'real' back; a person has to return the attached actor '{actor.name}' to "
            "its start: write ask"
        )
        yield files.campaign.problem(("between_runs", "do"), message)


def _near_misses(files: CaseFiles, setup: Setup, mode: Mode) -> Iterator[Problem]:
    """Yield attached actors that could touch another attached vehicle."""
    for one in encounters(setup, mode):
        if one.is_far or (one.may_be_allowed and "separation" in setup.preflight.override):
            continue
        if one.other_fence is None:
            message = (
                f"in mode {mode} '{one.actor.name}' flies beside '{one.other.name}', which is also "
                "attached and has no geofence: nothing keeps the two apart; give it a geofence"
            )
        else:
            message = (
                f"in mode {mode} this fence is {one.apart_m:.2f} m from that of "
                f"'{one.other.name}', also attached: the two can touch; leave {one.needed_m:.2f} m "
                f"between the fences, seen from above, {one.remedy}"
            )
        yield files.campaign.problem((*one.actor.path, "geofence"), message, key=True)
