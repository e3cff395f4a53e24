"""The schema of a world file, with units in its keys."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.foundation.files.documents import Part as FilePart
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.motion import Moment

Which = Literal["W", "Wv"]
Mode = Literal["sim", "wil", "real"]
Existence = Literal["W", "Wv", "both", "none"]
SMALLEST_M = 1e-4
"""Of a length: a tenth of a millimetre. Numbers near zero have no normals."""
LARGEST_M = 10_000.0

Length = Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M)]
Coordinate = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]
Seconds = Annotated[float, Field(ge=0.0)]
Speed = Annotated[float, Field(gt=0.0, le=1000.0)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Color = str | list[int]


class OriginModel(FilePart):
    """The world file's `origin` of the local frame on Earth (WGS-84).

    latitude_deg, longitude_deg: of the world's origin, the point whose north, east and up are 0.
    altitude_m: of the world's origin above mean sea level. undulation_m: of the geoid above the
    ellipsoid there, which the fixes of `gps` sensors have on top.
    """

    latitude_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    altitude_m: Annotated[float, Field(ge=-1000.0, le=20_000.0)] = 0.0
    undulation_m: Annotated[float, Field(ge=-150.0, le=150.0)] = 0.0


class PoseModel(FilePart):
    """An object's pose in the world file.

    north_m, east_m, up_m: from the world's origin. yaw_deg: clockwise from north, seen from above.
    pitch_deg: positive nose up. roll_deg: positive right side down.
    """

    north_m: Coordinate = 0.0
    east_m: Coordinate = 0.0
    up_m: Coordinate = 0.0
    yaw_deg: Degrees = 0.0
    pitch_deg: Degrees = 0.0
    roll_deg: Degrees = 0.0

    def pose(self) -> Pose:
        """Return the world file's pose in NED and radians."""
        return Pose.of(
            self.north_m,
            self.east_m,
            self.up_m,
            roll_rad=math.radians(self.roll_deg),
            pitch_rad=math.radians(self.pitch_deg),
            yaw_rad=math.radians(self.yaw_deg),
        )


class GateModel(FilePart):
    """A gate in a world file; inner_size_m: free edge of a square, free diameter of a ring.

    form: the shape of the opening. bar_m: thickness of the frame round the opening.
    """

    form: Literal["square", "ring"] = "square"
    inner_size_m: Length
    bar_m: Length = 0.1


class RoomModel(FilePart):
    """A room in a world file; its pose is the middle of its floor.

    size_north_m, size_east_m: inner length along the room's forward and right. height_m: from floor
    to ceiling. ceiling: whether the room has one, closed, or is open above. seed: of the textures
    on the room's walls.
    """

    size_north_m: Length
    size_east_m: Length
    height_m: Length
    ceiling: Literal["closed", "open"] = "closed"
    seed: Annotated[int, Field(ge=0, le=1_000_000)] = 0


class BoxModel(FilePart):
    """A box in a world file about its pose: size along forward, right and up.

    size_m: [forward, right, up], whole lengths.
    """

    size_m: tuple[Length, Length, Length]


class PersonModel(FilePart):
    """A standing person of 1.75 m in a world file; the pose is on the ground."""


class QuadrotorModel(FilePart):
    """A quadrotor in a world file; size is the width over the rotors.

    size_m: the width over the rotors.
    """

    size_m: Length = 0.3


Corner = tuple[Coordinate, Coordinate, Coordinate]


class OpeningModel(FilePart):
    """An opening of a world file's mesh; lengths forward, right and up in the object's frame.

    at_m: a point in it, within its depth: its outline is that of the mesh round this point.
    polygon_m: or its corners, in their order round it. through: the way to fly through it.
    """

    at_m: Corner | None = None
    polygon_m: Annotated[list[Corner], Field(min_length=3, max_length=200)] | None = None
    through: Literal["forward", "right", "up"] = "forward"

    @model_validator(mode="after")
    def _one_of_both(self) -> "OpeningModel":
        """Require exactly one way to state the opening of a world file's mesh."""
        if (self.at_m is None) == (self.polygon_m is None):
            raise ValueError("needs exactly one of 'at_m' and 'polygon_m'")
        return self


class MeshModel(FilePart):
    """A mesh of a world file, from a file beside it.

    unit: None takes what the file states (.dae), else metres. up, forward: which axes of the file
    point up and forward; None takes what the file states, else its format's custom (.glb, .gltf,
    .dae: y up, z forward; .obj, .stl, .ply: z up, x forward). file: one beside this one, .obj,
    .stl, .ply, .glb, .gltf or .dae. scale: the factor by which all lengths of the file are
    multiplied. opening: where it can be flown through, as a gate of a goal. transparent: opaque has
    surfaces drawn as opaque that the file has transparent or with cut-outs; they are refused
    without it.
    """

    file: str
    transparent: Literal["opaque"] | None = None
    unit: Literal["m", "cm", "mm", "in", "ft"] | None = None
    scale: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.0
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    forward: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    opening: OpeningModel | None = None

    @model_validator(mode="after")
    def _axes_differ(self) -> "MeshModel":
        """Require up and forward of a world file's mesh together, along different axes."""
        if (self.up is None) != (self.forward is None):
            raise KeyFaultError(
                "up" if self.up else "forward", "'up' and 'forward' must be given together"
            )
        if self.up and self.forward and self.up[-1] == self.forward[-1]:
            raise KeyFaultError("forward", "'up' and 'forward' must be different axes")
        return self


class ShapeModel(FilePart):
    """The shape of a world file's object: exactly one of the known ones."""

    gate: GateModel | None = None
    room: RoomModel | None = None
    box: BoxModel | None = None
    person: PersonModel | None = None
    quadrotor: QuadrotorModel | None = None
    mesh: MeshModel | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> "ShapeModel":
        """Require exactly one shape of a world file's object."""
        given = sorted(self.model_fields_set)
        if len(given) != 1 or getattr(self, given[0]) is None:
            names = ", ".join(type(self).model_fields)
            raise ValueError(f"a shape is exactly one of {names}; here: {', '.join(given) or '-'}")
        return self

    @property
    def kind(self) -> str:
        """Return which shape the world file's object has."""
        return next(iter(self.model_fields_set))


class ExistsModel(FilePart):
    """In which world (real or virtual) an object of the world file exists, by mode.

    sim: in runs of mode sim. wil: of mode wil. real: of mode real; W is the real world, Wv the
    virtual one.
    """

    sim: Existence = "Wv"
    wil: Existence = "Wv"
    real: Existence = "W"


class WaypointModel(FilePart):
    """A waypoint of a motion in a world file; speed and yaw of the way there.

    north_m, east_m, up_m: from the world's origin. speed_m_s: the speed on the way there. yaw_deg:
    the heading to turn to on the way, clockwise from north; it keeps its attitude without.
    """

    north_m: Coordinate
    east_m: Coordinate
    up_m: Coordinate = 0.0
    speed_m_s: Speed
    yaw_deg: Degrees | None = None


class StartModel(FilePart):
    """A motion's `start` in a world file: a time after t0, or an event (and a delay).

    at_s: when it begins, counted from t0, when the goal is given. on: the event of the run that
    starts it. delay_s: how long after the event `on` it begins.
    """

    at_s: Seconds | None = None
    on: Moment | None = None
    delay_s: Seconds = 0.0

    @model_validator(mode="after")
    def _one_of_both(self) -> "StartModel":
        """Require either a time or an event for a world file's motion start."""
        if (self.at_s is None) == (self.on is None):
            raise ValueError("a motion's start needs either 'at_s' or 'on'")
        if self.at_s is not None and "delay_s" in self.model_fields_set:
            raise KeyFaultError("delay_s", "counts from an event; at_s is given already")
        return self


class MotionModel(FilePart):
    """An object's `motion` in a world file: waypoints from its pose.

    acceleration_m_s2: with it each way begins and ends at rest. speed_sd_m_s: the standard
    deviation with which the speed of each way is drawn. waypoints: the places that it moves to, one
    after another. start: when it begins; at t0 without. loop: whether it goes back to its pose
    after the last waypoint and begins again, for ever.
    """

    waypoints: Annotated[tuple[WaypointModel, ...], Field(min_length=1, max_length=1000)]
    start: StartModel = StartModel(at_s=0.0)
    loop: bool = False
    acceleration_m_s2: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    speed_sd_m_s: Annotated[float, Field(ge=0.0, le=100.0)] = 0.0


class ObjectModel(FilePart):
    """An object of a world file; shapes that need no sizes may be given by name alone.

    color: a name, "#rrggbb" or [red, green, blue] of 0 to 255. texture: an image file beside this
    one. exists_in: in which world it stands, by mode; a room in both.
    """

    written_shape: Annotated[ShapeModel | Literal["person", "quadrotor"], Field(alias="shape")]
    pose: PoseModel = PoseModel()
    color: Color | None = None
    texture: str | None = None
    exists_in: ExistsModel | None = None
    motion: MotionModel | None = None

    @property
    def shape(self) -> ShapeModel:
        """Return the shape of the world file's object, however it was written."""
        if self.written_shape == "person":
            return ShapeModel(person=PersonModel())
        if self.written_shape == "quadrotor":
            return ShapeModel(quadrotor=QuadrotorModel())
        return self.written_shape


class WorldModel(FilePart):
    """A world file. seed: of the speeds that are drawn; a run without one in the file has its own.

    Without a seed everything moves at the speeds of the file. schema: the kind and version of the
    file. description: for people. ground_up_m: the height of the open ground over the world's
    origin; without it, where each vehicle stands before its takeoff. objects: what stands and moves
    in the world, by name.
    """

    schema_: Annotated[Literal["wil/world/1"], Field(alias="schema")]
    description: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] | None = None
    origin: OriginModel
    ground_up_m: Coordinate | None = None
    objects: Annotated[dict[str, ObjectModel], Field(default_factory=dict)]
