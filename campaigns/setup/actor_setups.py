"""Setups of actors, which are vehicles that fly as objects of the world."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, Self

from wil_campaign.campaigns.schema.actors import ActorPart, ElsewherePart
from wil_campaign.campaigns.setup.vehicle_setups import (
    FlownSetup,
    key_source_of,
    telemetry_rates_of,
    unknown_parameters,
    vehicle_link_of,
    vehicle_profile_of,
)
from wil_campaign.foundation.files.documents import Document, Problem, closest_word
from wil_campaign.foundation.files.documents import Path as KeyPath
from wil_campaign.safety.fence.areas import FenceError
from wil_campaign.safety.fence.geofence import Fence, require_few_corners
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.geodesy import LocalFrame
from wil_campaign.worlds.scene.motion import ObjectMotion
from wil_campaign.worlds.scene.scene import SceneObject
from wil_campaign.worlds.world_file.world import World

_FIRST_SYSTEM_ID = 3
_OVER_START_M = 0.05
"""Largest horizontal distance of the first waypoint from the start: a takeoff is vertical."""
_LEAST_CLIMB_M = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class ActorSetup(FlownSetup):
    """The setup of a vehicle that flies as an object of the world, along that object's motion.

    name: the object's. motion: its takeoff leads to the first waypoint. max_offset_m: from its
    path, max_delay_s: behind its motion, and max_silence_s: without a position, beyond which the
    run is INVALID. reach_m: largest distance of its body from its middle. place: where it stands in
    W, if that is not its object's start; virtual: of an attached actor, what flies where its object
    is virtual; None: nothing may.
    """

    motion: ObjectMotion
    max_offset_m: float
    max_delay_s: float
    max_silence_s: float
    reach_m: float
    place: Pose | None = None
    virtual: Self | None = None

    @property
    def path(self) -> KeyPath:
        """Return the actor's place in the campaign file."""
        return "actors", self.name

    @property
    def kind(self) -> Literal["embedded", "launched", "attached"]:
        """Return what kind of vehicle it is."""
        if self.embedded:
            return "embedded"
        return "attached" if self.launch is None else "launched"

    @property
    def requests_truth(self) -> bool:
        """Return whether its true pose is requested by MAVLink; an embedded one never needs it."""
        return not self.embedded and (self.pose_source == "simulator" or self.launch is not None)

    @property
    def standing_pose(self) -> Pose:
        """Return the vehicle's pose in W before it takes off."""
        return self.start if self.place is None else self.place

    def flown_as(self, *, physical: bool) -> Self | None:
        """Return what flies where the object is physical or virtual; None: nothing may."""
        return self if physical or self.attached is None else self.virtual


def actor_setups(
    file: Document,
    parts: Mapping[str, ActorPart],
    world: World,
    taken: Mapping[str, int],
    problems: list[Problem],
) -> dict[str, ActorSetup]:
    """Return the setups of a campaign's actors by name; problems are collected.

    taken: the system ids of the other vehicles.
    """
    objects = {each.scene_object.name: each.scene_object for each in world.placed}
    ids = dict(taken)
    found: dict[str, ActorSetup] = {}
    for index, (name, part) in enumerate(parts.items()):
        at: KeyPath = ("actors", name)
        own_id = part.system_id or _FIRST_SYSTEM_ID + index
        other = next((one for one, system_id in ids.items() if system_id == own_id), None)
        if other is not None:
            message = f"'{other}' also has system id {own_id}; give '{name}' a different one"
            problems.append(file.problem((*at, "system_id"), message))
        ids[name] = own_id
        if part.link == "embedded":
            problems += unknown_parameters(file, at, part.autopilot, part.params)
        profile = vehicle_profile_of(file, at, part.profile, problems)
        link = vehicle_link_of(file, at, part.link, part.params, problems)
        rates = telemetry_rates_of(file, at, part, problems)
        thing = objects.get(name)
        wrong = list(_object_problems(file, at, name, thing, tuple(objects)))
        problems += wrong
        if wrong or thing is None or thing.motion is None:
            continue
        actor = ActorSetup(
            name=name,
            link=link,
            autopilot=part.autopilot,
            profile=profile,
            physics=part.physics,
            start=thing.pose,
            system_id=own_id,
            pose_source=part.poses_from,
            params=dict(part.params),
            signing=key_source_of(file, part.signing),
            rates=rates,
            has_gps=part.gps,
            motion=thing.motion,
            max_offset_m=part.max_offset_m,
            max_delay_s=part.max_delay_s,
            max_silence_s=part.max_silence_s,
            reach_m=max(math.hypot(*map(float, one)) for one in thing.shape.mesh.vertices_m),
        )
        found[name] = replace(actor, virtual=_virtual(actor, part))
    return found


def actor_fences(
    file: Document,
    parts: Mapping[str, ActorPart],
    frame: LocalFrame,
    problems: list[Problem],
) -> dict[str, Fence]:
    """Return the fences of the actors that have one; problems are collected."""
    found: dict[str, Fence] = {}
    for name, part in parts.items():
        if part.geofence is None:
            continue
        try:
            found[name] = require_few_corners(part.geofence.fence(frame))
        except FenceError as error:
            problems.append(file.problem(("actors", name, "geofence"), str(error), key=True))
    return found


def _virtual(actor: ActorSetup, part: ActorPart) -> ActorSetup | None:
    """Return what flies in place of an attached actor where its object is virtual."""
    if isinstance(part.virtual, ElsewherePart):
        return replace(actor, place=part.virtual.place.pose())
    if part.virtual is None:
        return None
    return replace(
        actor, link="embedded", params={}, signing=None, pose_source="simulator", spares=()
    )


def _object_problems(
    file: Document, at: KeyPath, name: str, thing: SceneObject | None, known: tuple[str, ...]
) -> Iterator[Problem]:
    """Yield reasons why no vehicle can fly as an object of the world."""
    if name in {"real", "twin"}:
        message = f"'{name}' is a vehicle of the pair; name an actor after an object of the world"
        yield file.problem(at, message, key=True)
    elif thing is None:
        message = f"the world has no object '{name}'"
        yield file.problem(at, message, closest_word(name, known), key=True)
    elif thing.motion is None:
        message = f"'{name}' has no motion in the world file, which its vehicle needs; add one"
        yield file.problem(at, message, key=True)
    elif thing.shape.limbs:
        message = f"'{name}' is a {thing.shape.kind}; a vehicle flies as an object without limbs"
        yield file.problem(at, message, key=True)
    elif thing.motion.loop:
        message = f"the motion of '{name}' repeats for ever; a vehicle flies a motion that ends"
        yield file.problem(at, message, key=True)
    elif not _takes_off(thing.motion):
        message = (
            f"the first waypoint of '{name}' is not above its start: the vehicle takes off to it; "
            f"give it the same north_m and east_m, and an up_m higher by {_LEAST_CLIMB_M:g} m"
        )
        yield file.problem(at, message, key=True)


def _takes_off(motion: ObjectMotion) -> bool:
    """Return whether an actor's motion begins with a climb straight up."""
    if not motion.waypoints:
        return False
    begin, first = motion.begin.position_ned_m, motion.waypoints[0].position_ned_m
    climb_m = begin[2] - first[2]
    return math.dist(begin[:2], first[:2]) <= _OVER_START_M and climb_m >= _LEAST_CLIMB_M
