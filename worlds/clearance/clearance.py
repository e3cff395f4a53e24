"""Clearance between a vehicle's body and the objects of a scene, swept between two samples.

No thin object is missed. The distance between two bodies changes by no more than the way that any
of their points goes, so the distances at both ends of a stretch bound those in between, and
stretches are halved until the bound is tight (Schwarzer, Saha and Latombe 2005). A second bound
is tight at once: for convex parts a plane that separates at one end, for triangle surfaces the
distance to the hull of the body at both ends.
"""

import copy
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property

from wil_campaign.worlds.clearance.distance import Body, BodySolid, PartGap, PartSolid
from wil_campaign.worlds.frames import AT_ORIGIN, Pose, Vec3, angle_between
from wil_campaign.worlds.scene.motion import MotionTravel
from wil_campaign.worlds.scene.parts import BoxShape, SphereShape
from wil_campaign.worlds.scene.scene import (
    NO_EVENTS,
    ObjectPlacement,
    RigidBody,
    Scene,
    SceneObject,
)

__all__ = ["GROUND", "Body", "BoxShape", "Clearance", "ClearanceProbe", "SphereShape"]

GROUND = "the ground"
"""The name under which `ClearanceProbe.above` reports the ground, a floor without an end."""

TOLERANCE_M = 2e-4
_SHORTEST = 2.0**-30
"""Fraction of a stretch: shorter parts are not halved again, even if a pose jumps in them."""
_Key = tuple[str, bool]
_GROUND_KEY: _Key = (GROUND, True)
_UP: Vec3 = (0.0, 0.0, -1.0)


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least clearance to an object on a stretch of the flight path, and to which part.

    clearance_m: 0 is contact. at_s: when it was least. is_floor: it is the floor of a room,
    which is reported beside the rest of the room, as touching it is no collision.
    """

    object_name: str
    part_name: str
    clearance_m: float
    at_s: float
    is_floor: bool = False

    @property
    def key(self) -> _Key:
        """Return the key of separately reported clearances: the object, and whether floor."""
        return (self.object_name, self.is_floor)


class ClearanceProbe:
    """Measures the clearance of one body to one scene.

    exclude: names of objects to leave out. floors: whether floors of rooms are measured.
    within_m: objects farther than this are not reported; reported clearances are exact to 1 mm.
    """

    def __init__(
        self,
        scene: Scene,
        body: Body,
        *,
        exclude: Collection[str] = (),
        floors: bool = True,
        within_m: float = 2.0,
    ) -> None:
        self._body = BodySolid(body)
        self.ground_down_m: float | None = None
        self.within_m = within_m
        self._targets = [
            target
            for part in scene.bodies
            if part.scene_object.name not in exclude
            for target in (_Target(part, is_floor=False), _Target(part, is_floor=True))
            if target.parts and (floors or not target.is_floor)
        ]

    def reaching(self, distance_m: float) -> "ClearanceProbe":
        """Return a probe of the same body and scene that reports objects up to a distance at least.

        It is this probe where that suffices.
        """
        if distance_m <= self.within_m:
            return self
        farther = copy.copy(self)
        farther.within_m = distance_m
        return farther

    def above(self, ground_down_m: float) -> "ClearanceProbe":
        """Return a probe of the same body and scene that reports a level ground as well.

        ground_down_m: its height, NED. A floor of a room that is as near is reported in its place.
        """
        grounded = copy.copy(self)
        grounded.ground_down_m = ground_down_m
        return grounded

    def load_kernels(self) -> None:
        """Load or compile the kernels that the scene's parts need, wherever they are.

        A sweep calls only those that its stretch needs.
        """
        for part in (part for target in self._targets for part in target.parts):
            self._body.gap(AT_ORIGIN, part)
            if part.tree is not None:
                self._body.stays_beyond(part.tree, AT_ORIGIN, AT_ORIGIN, 0.0)

    def sweep(
        self,
        pose_0: Pose,
        t_0_s: float,
        pose_1: Pose,
        t_1_s: float,
        events: Mapping[str, float] = NO_EVENTS,
        *,
        below_m: Mapping[_Key, float] | None = None,
        only_least: bool = False,
    ) -> tuple[Clearance, ...]:
        """Return the least clearance to each near object between two samples of the pose.

        The body moves straight and turns evenly from pose_0 to pose_1; objects by their motion.
        below_m: known clearances by `Clearance.key`: only smaller ones are reported, and none
        beyond `within_m` (see `reaching`).
        only_least: whether an object that is farther than one before it may be left out, which is
        quicker; the least of all is reported.
        """
        stretch = _Stretch(pose_0, t_0_s, pose_1, t_1_s, events)
        found: dict[_Key, Clearance] = {}
        within_m, radius_m = self.within_m, self._body.radius_m
        for target in self._targets:
            limit_m = within_m
            if target.is_limb and target.key in found:
                limit_m = found[target.key].clearance_m
            if below_m is not None:
                limit_m = min(limit_m, below_m.get(target.key, limit_m))
            if limit_m > 0.0 and target.is_near(stretch, radius_m, limit_m):
                clearance = _Sweep(self._body, target, stretch).least(limit_m)
                if clearance is not None:
                    found[target.key] = clearance
                    if only_least:
                        within_m = clearance.clearance_m
        if self.ground_down_m is not None:
            known_m = [one.clearance_m for one in found.values() if one.is_floor]
            limit_m = within_m if below_m is None else below_m.get(_GROUND_KEY, within_m)
            ground = self._over_ground(stretch, self.ground_down_m)
            if ground.clearance_m < min(limit_m, within_m, *known_m):
                found[_GROUND_KEY] = ground
        return tuple(found.values())

    def _over_ground(self, stretch: "_Stretch", ground_down_m: float) -> Clearance:
        """Return the least clearance to the level ground on a stretch, which one end has."""
        ends = ((stretch.pose_0, stretch.t_0_s), (stretch.pose_1, stretch.t_1_s))
        clearance_m, at_s = min(
            (max(0.0, ground_down_m + self._body.depth_m(pose, _UP)), t_s) for pose, t_s in ends
        )
        return Clearance(GROUND, "", clearance_m, at_s, is_floor=True)


class _Stretch:
    """The body's path between two pose samples, for a clearance sweep."""

    __slots__ = (
        *("_placed", "_travels", "events", "is_point", "pose_0", "pose_1"),
        *("t_0_s", "t_1_s", "turn_rad", "way_m"),
    )

    def __init__(
        self, pose_0: Pose, t_0_s: float, pose_1: Pose, t_1_s: float, events: Mapping[str, float]
    ) -> None:
        self.pose_0, self.t_0_s = pose_0, t_0_s
        self.pose_1, self.t_1_s = pose_1, t_1_s
        self.events = events
        self.way_m = math.dist(pose_0.position_ned_m, pose_1.position_ned_m)
        self.turn_rad = angle_between(pose_0.q_wxyz, pose_1.q_wxyz)
        self.is_point = t_0_s == t_1_s and pose_0 == pose_1
        self._placed: dict[tuple[int, float], ObjectPlacement] = {}
        self._travels: dict[tuple[int, float, float], MotionTravel] = {}

    def time_s(self, fraction: float) -> float:
        return self.t_0_s + (self.t_1_s - self.t_0_s) * fraction

    def pose_of(self, body: RigidBody, t_s: float) -> Pose:
        """Return a body's pose at a time; limbs of one object share where that is."""
        return body.pose_on(self._placed_at(body.scene_object, t_s))

    def travel_of(self, body: RigidBody, from_fraction: float, to_fraction: float) -> MotionTravel:
        """Return how far a body goes and turns at most between two fractions of the stretch."""
        return body.travel_on(self._travel(body.scene_object, from_fraction, to_fraction))

    def way_of(self, scene_object: SceneObject) -> tuple[Vec3, float]:
        """Return where an object is at the beginning (NED, metres), and how far it goes."""
        begin = self._placed_at(scene_object, self.t_0_s).pose.position_ned_m
        return begin, self._travel(scene_object, 0.0, 1.0).length_m

    def _placed_at(self, scene_object: SceneObject, t_s: float) -> ObjectPlacement:
        key = (scene_object.object_id, t_s)
        placed = self._placed.get(key)
        if placed is None:
            placed = self._placed[key] = scene_object.placed_at(t_s, self.events)
        return placed

    def _travel(
        self, scene_object: SceneObject, from_fraction: float, to_fraction: float
    ) -> MotionTravel:
        key = (scene_object.object_id, from_fraction, to_fraction)
        travel = self._travels.get(key)
        if travel is None:
            first_s, last_s = self.time_s(from_fraction), self.time_s(to_fraction)
            travel = self._travels[key] = scene_object.travel(first_s, last_s, self.events)
        return travel


class _Target:
    """A rigid body (or its floor) with its parts ready for clearance measurement."""

    def __init__(self, body: RigidBody, *, is_floor: bool) -> None:
        scene_object = body.scene_object
        self.body = body
        self.is_floor = is_floor
        self.is_limb = body.joint is not None
        self.key = (scene_object.name, is_floor)
        self.parts = [PartSolid(p) for p in body.shape.parts if p.is_floor is is_floor]
        self.radius_m = body.radius_m
        self.place_m = scene_object.pose.position_ned_m if scene_object.motion is None else None
        self.at_rest = scene_object.pose.inverse() if scene_object.motion is None else None

    def is_near(self, stretch: _Stretch, body_radius_m: float, limit_m: float) -> bool:
        """Return whether the object may come nearer than a limit, by bounding spheres."""
        reach_m = self.radius_m + body_radius_m + limit_m
        way_m, center = stretch.way_m, self.place_m
        if center is None:
            center, moved_m = stretch.way_of(self.body.scene_object)
            way_m += moved_m
        return math.dist(stretch.pose_0.position_ned_m, center) - way_m < reach_m


@dataclass(frozen=True, slots=True)
class _Sample:
    """The body at a fraction of the swept stretch, in the object's frame, and its gap to a part."""

    fraction: float
    pose: Pose
    gap: PartGap


class _Sweep:
    """The clearance sweep of one stretch against one object."""

    def __init__(self, body: BodySolid, target: _Target, stretch: _Stretch) -> None:
        self._body, self._target, self._stretch = body, target, stretch
        self._first = self._seen_at_sample(stretch.pose_0, stretch.t_0_s)

    # Computed when needed: most stretches are far from every part.

    @cached_property
    def _last(self) -> Pose:
        """Return the body's pose at the end of the sweep in the object's frame."""
        return self._seen_at_sample(self._stretch.pose_1, self._stretch.t_1_s)

    @cached_property
    def _straight(self) -> bool:
        """Return whether the object rests or moves evenly during the whole sweep."""
        return self._is_even(0.0, 1.0)

    def _is_straight(self, from_fraction: float, to_fraction: float) -> bool:
        """Return whether the object rests or moves evenly in a part of the sweep."""
        return self._straight or self._is_even(from_fraction, to_fraction)

    def _is_even(self, from_fraction: float, to_fraction: float) -> bool:
        stretch = self._stretch
        first_s, last_s = stretch.time_s(from_fraction), stretch.time_s(to_fraction)
        return self._target.body.is_even(first_s, last_s, stretch.events)

    def least(self, limit_m: float) -> Clearance | None:
        """Return the least clearance over all parts; None when it is not below the limit."""
        best: tuple[_Sample, str] | None = None
        for at_least_m, part in self._nearest_first(limit_m):
            if at_least_m >= limit_m:
                break
            first = self._sample(part, 0.0)
            last = first if self._stretch.is_point else self._sample(part, 1.0)
            sample = self._refine(part, first, last, limit_m)
            if sample is not None:
                limit_m = sample.gap.distance_m
                best = (sample, part.name)
        if best is None:
            return None
        sample, part_name = best
        at_s = self._stretch.time_s(sample.fraction)
        name, is_floor = self._target.key
        return Clearance(name, part_name, sample.gap.distance_m, at_s, is_floor)

    def _nearest_first(self, limit_m: float) -> list[tuple[float, PartSolid]]:
        """Return the parts whose clearance may be below a limit, least lower bound first."""
        motion_m = self._motion_m(0.0, 1.0)
        reach_m = self._body.reach_m(self._first.q_wxyz)
        center = self._first.position_ned_m
        bounds: list[tuple[float, PartSolid]] = []
        for part in self._target.parts:
            at_least_m = part.at_least_m(center, reach_m) - motion_m
            if at_least_m < limit_m:
                bounds.append((at_least_m, part))
        bounds.sort(key=_bound)
        return bounds

    def _refine(
        self, part: PartSolid, first: _Sample, last: _Sample, limit_m: float
    ) -> _Sample | None:
        """Return the sample of least clearance to a part; None when not below the limit."""
        best: _Sample | None = None
        waiting = [(first, last)]
        for sample in (first, last):
            if sample.gap.distance_m < limit_m:
                best, limit_m = sample, sample.gap.distance_m
        while waiting and limit_m > 0.0:
            a, b = waiting.pop()
            enough_m = limit_m - TOLERANCE_M
            if b.fraction - a.fraction < _SHORTEST or self._is_above(part, a, b, enough_m):
                continue
            middle = self._sample(part, (a.fraction + b.fraction) / 2.0)
            if middle.gap.distance_m < limit_m:
                best, limit_m = middle, middle.gap.distance_m
            waiting += [(middle, b), (a, middle)]
        return best

    def _is_above(self, part: PartSolid, a: _Sample, b: _Sample, enough_m: float) -> bool:
        """Return whether the clearance is proven to stay above a value between two samples."""
        both_m = a.gap.distance_m + b.gap.distance_m
        if (both_m - self._motion_m(a.fraction, b.fraction)) / 2.0 >= enough_m:
            return True
        if not self._is_straight(a.fraction, b.fraction):
            return False
        # A point of the body leaves its chord by at most r (1 - cos(turn / 2)).
        turn_rad = self._stretch.turn_rad * (b.fraction - a.fraction)
        enough_m += self._body.radius_m * turn_rad * turn_rad / 8.0
        if part.tree is not None:
            return self._body.stays_beyond(part.tree, a.pose, b.pose, enough_m)
        return self._plane_holds(a, b, enough_m) or self._plane_holds(b, a, enough_m)

    def _plane_holds(self, here: _Sample, there: _Sample, enough_m: float) -> bool:
        """Return whether the separating plane of one sample proves the clearance at both."""
        direction = here.gap.direction
        if direction is None or here.gap.distance_m < enough_m:
            return False
        change_m = self._body.depth_m(there.pose, direction)
        change_m -= self._body.depth_m(here.pose, direction)
        return here.gap.distance_m + change_m >= enough_m

    def _sample(self, part: PartSolid, fraction: float) -> _Sample:
        pose = self._seen_at(fraction)
        return _Sample(fraction, pose, self._body.gap(pose, part))

    def _seen_at(self, fraction: float) -> Pose:
        """Return the body's pose in the object's frame at a fraction of the sweep."""
        if fraction in (0.0, 1.0):
            return self._last if fraction else self._first
        if self._straight:
            return self._first.interpolate(self._last, fraction)
        stretch = self._stretch
        body = stretch.pose_0.interpolate(stretch.pose_1, fraction)
        return self._seen_at_sample(body, stretch.time_s(fraction))

    def _seen_at_sample(self, body: Pose, t_s: float) -> Pose:
        """Return a pose of the swept body in the object's frame."""
        frame = self._target.at_rest
        if frame is None:
            frame = self._stretch.pose_of(self._target.body, t_s).inverse()
        return frame.compose(body)

    def _motion_m(self, from_fraction: float, to_fraction: float) -> float:
        """Return the most that any point of body and object moves, bounding the clearance."""
        share, stretch = to_fraction - from_fraction, self._stretch
        body_m = share * (stretch.way_m + stretch.turn_rad * self._body.radius_m)
        if self._target.at_rest is not None:
            return body_m
        travel = stretch.travel_of(self._target.body, from_fraction, to_fraction)
        return body_m + travel.length_m + travel.turn_rad * self._target.radius_m


def _bound(bounded: tuple[float, PartSolid]) -> float:
    return bounded[0]
