"""A scene: the named objects of one world, immutable, and their poses over time."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.scene.gait import CHORD_S, Joint, limb_pose, limb_travel
from wil_campaign.worlds.scene.motion import AT_REST, LegStride, MotionTravel, ObjectMotion
from wil_campaign.worlds.scene.shapes import Shape
from wil_campaign.worlds.scene.track import object_track_of

MAX_OBJECTS = 254
NO_EVENTS: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class ObjectPlacement:
    """Where a scene object is: its pose, and where on its leg; None where it does not walk."""

    pose: Pose
    stride: LegStride | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """A named object of a scene: its shape, and where it is.

    object_id: 1 to 254, the value in id images; 0 is background. pose: in the world (NED),
    at rest and before motion begins. motion: None for an object that never moves.
    """

    object_id: int
    name: str
    shape: Shape
    pose: Pose
    motion: ObjectMotion | None = None

    @property
    def is_room(self) -> bool:
        """Return whether the scene object is a room with vehicles inside."""
        return self.shape.kind == "room"

    def pose_at(self, t_s: float, events: Mapping[str, float] = NO_EVENTS) -> Pose:
        """Return the scene object's pose at a time; events: when each happened.

        In a run in which a vehicle flies it (`RunHistory`): the pose of that vehicle.
        """
        if self.motion is None:
            return self.pose
        if (track := object_track_of(self.name, events)) is not None:
            return track.pose_at(t_s) or self.pose
        return self.motion.pose_at(t_s, events)

    def placed_at(self, t_s: float, events: Mapping[str, float] = NO_EVENTS) -> ObjectPlacement:
        """Return the scene object's pose and stride at a time, which place all its limbs."""
        stride = None if self.motion is None else self.motion.stride_at(t_s, events)
        return ObjectPlacement(self.pose_at(t_s, events), stride)

    def travel(
        self, from_s: float, to_s: float, events: Mapping[str, float] = NO_EVENTS
    ) -> MotionTravel:
        """Return how far the scene object went and turned between two times."""
        if self.motion is None:
            return AT_REST
        if (track := object_track_of(self.name, events)) is not None:
            return track.travel(from_s, to_s)
        return self.motion.travel(from_s, to_s, events)

    def is_even(self, from_s: float, to_s: float, events: Mapping[str, float] = NO_EVENTS) -> bool:
        """Return whether the scene object rests, or moves straight, evenly and unturned."""
        if self.motion is None:
            return True
        if (track := object_track_of(self.name, events)) is not None:
            return track.is_even(from_s, to_s)
        return self.motion.is_even(from_s, to_s, events)

    @property
    def bodies(self) -> tuple["RigidBody", ...]:
        """Return the rigid bodies of the scene object: its limbs where they move, else itself."""
        if self.motion is None or not self.shape.limbs:
            return (RigidBody(self, self.shape),)
        return tuple(RigidBody(self, limb.shape, limb.joint) for limb in self.shape.limbs)


@dataclass(frozen=True, slots=True, eq=False)
class RigidBody:
    """A scene object that does not change its shape, or one limb of an object that does.

    joint: what moves the limb; None for a whole object. Poses are those of the object's frame,
    displaced as the limb is.
    """

    scene_object: SceneObject
    shape: Shape
    joint: Joint | None = None

    @property
    def radius_m(self) -> float:
        """Return the radius of the sphere about the body's origin that holds it at any time."""
        return self.scene_object.shape.radius_m if self.joint else self.shape.radius_m

    def pose_at(self, t_s: float, events: Mapping[str, float] = NO_EVENTS) -> Pose:
        """Return the body's pose at a time; events: when each happened."""
        if self.joint is None:
            return self.scene_object.pose_at(t_s, events)
        return self.pose_on(self.scene_object.placed_at(t_s, events))

    def pose_on(self, placed: ObjectPlacement) -> Pose:
        """Return the body's pose where its object is placed so."""
        if self.joint is None or self.scene_object.motion is None:
            return placed.pose
        return placed.pose.compose(limb_pose(self.joint, placed.stride))

    def travel(
        self, from_s: float, to_s: float, events: Mapping[str, float] = NO_EVENTS
    ) -> MotionTravel:
        """Return how far the body goes and turns at most between two times."""
        return self.travel_on(self.scene_object.travel(from_s, to_s, events))

    def travel_on(self, travel: MotionTravel) -> MotionTravel:
        """Return how far the body goes and turns at most where its object does so."""
        return travel if self.joint is None else limb_travel(self.joint, travel)

    def is_even(self, from_s: float, to_s: float, events: Mapping[str, float] = NO_EVENTS) -> bool:
        """Return whether the body rests, or moves straight, evenly and unturned.

        A limb of a moving object does so for at most CHORD_S.
        """
        if self.joint is None:
            return self.scene_object.is_even(from_s, to_s, events)
        return to_s - from_s <= CHORD_S or self.scene_object.travel(from_s, to_s, events) == AT_REST


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A scene of named objects, each name and id once.

    Raises ValueError when a name or an id occurs twice, or an id is not 1 to 254.
    """

    objects: tuple[SceneObject, ...] = ()
    _by_name: dict[str, SceneObject] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        by_name = {scene_object.name: scene_object for scene_object in self.objects}
        ids = {scene_object.object_id for scene_object in self.objects}
        if len(by_name) != len(self.objects) or len(ids) != len(self.objects):
            raise ValueError("every object of a scene needs a unique name and a unique id")
        if not all(1 <= object_id <= MAX_OBJECTS for object_id in ids):
            raise ValueError(f"object ids are 1 to {MAX_OBJECTS}")
        object.__setattr__(self, "_by_name", by_name)

    @property
    def bodies(self) -> tuple[RigidBody, ...]:
        """Return the rigid bodies of all objects of the scene, in the order of the file."""
        return tuple(body for scene_object in self.objects for body in scene_object.bodies)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the scene's objects in the order of the file."""
        return tuple(scene_object.name for scene_object in self.objects)

    @property
    def floor_down_m(self) -> float | None:
        """Return how far down (NED) the lowest floor of the scene's rooms is; None without one."""
        rooms = [
            (scene_object.pose, scene_object.shape.mesh.vertices_m)
            for scene_object in self.objects
            if scene_object.is_room
        ]
        corners = [corners_m @ matrix_from_quat(pose.q_wxyz)[2] for pose, corners_m in rooms]
        downs_m = [
            pose.position_ned_m[2] + float(each.max())
            for (pose, _), each in zip(rooms, corners, strict=True)
        ]
        return max(downs_m, default=None)

    def __contains__(self, name: str) -> bool:
        return name in self._by_name

    def __getitem__(self, name: str) -> SceneObject:
        """Return the scene's object of a name. Raises KeyError when there is none."""
        return self._by_name[name]


def virtual_only_objects(real: Scene, virtual: Scene) -> dict[int, str]:
    """Return id and name of each object in the virtual world only; rooms do not count."""
    return {
        scene_object.object_id: scene_object.name
        for scene_object in virtual.objects
        if scene_object.name not in real and not scene_object.is_room
    }
