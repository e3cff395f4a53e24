"""Builds the objects of a validated world file: shapes, colours, meshes; collects problems."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wil_campaign.foundation.files.documents import Document, Problem, closest_file, closest_word
from wil_campaign.foundation.files.paths import is_folder, path_exists
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.colors import NAMED, Rgb, parse_color
from wil_campaign.worlds.scene.mesh_formats import MeshAxes, MeshFileError, load_mesh_shape
from wil_campaign.worlds.scene.mesh_openings import (
    OpeningError,
    outline_opening,
    polygon_opening,
)
from wil_campaign.worlds.scene.motion import ObjectMotion, StartOnEvent, Waypoint
from wil_campaign.worlds.scene.scene import MAX_OBJECTS, SceneObject
from wil_campaign.worlds.scene.shapes import Shape
from wil_campaign.worlds.scene.textures import load_texture
from wil_campaign.worlds.world_file.world_schema import (
    ExistsModel,
    MeshModel,
    Mode,
    MotionModel,
    ObjectModel,
    OpeningModel,
    ShapeModel,
    Which,
)

_IN_FLOOR_TOLERANCE_M = 1e-3
_OUT_OF_SIGHT_M = 100_000.0
"""Of a mesh's nearest point from its origin: coordinates of a map, or a wrong unit."""
_EVERYWHERE = ExistsModel(sim="both", wil="both", real="both")
_Path = tuple[str | int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PlacedObject:
    """An object that the world reader has built, and in which worlds it exists."""

    scene_object: SceneObject
    exists_in: ExistsModel

    def stands_in(self, mode: Mode, which: Which) -> bool:
        """Return whether the object exists in a world (real or virtual) in runs of a mode."""
        existence = {"sim": self.exists_in.sim, "wil": self.exists_in.wil}
        return existence.get(mode, self.exists_in.real) in (which, "both")


class WorldReader:
    """Reads the objects of one world document and collects their problems.

    seed: for drawing the speeds of motions; None: every motion has the speeds of the file.
    """

    def __init__(self, document: Document, *, seed: int | None = None) -> None:
        self._document = document
        self._seed = seed
        self._folder = document.path.parent
        self._unreadable: set[str] = set()
        self.problems: list[Problem] = []

    def read(
        self, models: dict[str, ObjectModel], *, ground_down_m: float | None = None
    ) -> tuple[PlacedObject, ...]:
        """Return all objects of the world file, in order; check `problems` before using them.

        ground_down_m: the height of the ground where the file states it.
        """
        if len(models) > MAX_OBJECTS:
            self._note(("objects",), f"{len(models)} objects; at most {MAX_OBJECTS} are supported")
            return ()
        placed = tuple(
            PlacedObject(self._object(object_id, name, model), _exists_in(model))
            for object_id, (name, model) in enumerate(models.items(), start=1)
        )
        floor_m = _floor_down_m(placed, ground_down_m)
        for each in placed:
            self._check_floor(each.scene_object, floor_m)
        return placed

    def _note(self, path: _Path, message: str, suggestion: str = "") -> None:
        self.problems.append(self._document.problem(path, message, suggestion))

    def _object(self, object_id: int, name: str, model: ObjectModel) -> SceneObject:
        at: _Path = ("objects", name)
        pose = model.pose.pose()
        if model.motion is not None and model.shape.room is not None:
            self._note((*at, "motion"), "a room does not move")
        motion = _motion(pose, model.motion) if model.motion else None
        if motion is not None and self._seed is not None:
            motion = motion.drawn(np.random.default_rng([self._seed, object_id]))
        shape = self._apply_colors(at, model, self._shape(at, model))
        return SceneObject(object_id, name, shape, pose, motion)

    def _shape(self, at: _Path, model: ObjectModel) -> Shape:
        rgb = self._color(at, model)
        if model.shape.mesh is not None:
            shape = self._mesh((*at, "shape", "mesh", "file"), model.shape.mesh)
            return shape if rgb is None else replace(shape, mesh=shape.mesh.painted(rgb))
        return _built_in(model.shape, rgb)

    def _color(self, at: _Path, model: ObjectModel) -> Rgb | None:
        if model.color is None:
            return None
        if model.shape.room is not None:
            self._note((*at, "color"), "a room has its own textures and takes no colour")
            return None
        try:
            return parse_color(model.color)
        except ValueError as error:
            self._note((*at, "color"), str(error), closest_word(str(model.color), NAMED))
            return None

    def _mesh(self, at: _Path, model: MeshModel) -> Shape:
        path = self._folder / model.file
        axes = MeshAxes(model.up, model.forward) if model.up and model.forward else None
        try:
            shape = load_mesh_shape(
                path,
                unit=model.unit,
                scale=model.scale,
                axes=axes,
                draws_transparent=model.transparent == "opaque",
            )
        except MeshFileError as error:
            self._note(at, f"mesh file '{model.file}': {error}", self._similar_file(model.file))
            self._unreadable.add(str(at[1]))
            return shapes.box_shape((1.0, 1.0, 1.0))
        if (away_m := _away_m(shape)) > _OUT_OF_SIGHT_M:
            message = f"it begins {away_m / 1000.0:.4g} km from its own origin, out of sight"
            remedy = "export it about its own origin, or give its 'unit'"
            self._note(at, f"mesh file '{model.file}': {message}; {remedy}")
        return shape if model.opening is None else self._opened(at, shape, model.opening)

    def _opened(self, at: _Path, shape: Shape, model: OpeningModel) -> Shape:
        """Return a mesh's shape with its opening; what is wrong with it is noted."""
        through = {"forward": (1.0, 0.0, 0.0), "right": (0.0, 1.0, 0.0), "up": (0.0, 0.0, -1.0)}
        way = through[model.through]
        try:
            if model.at_m is not None:
                forward, right, up = model.at_m
                opening = outline_opening(shape.mesh, (forward, right, -up), way)
            else:
                corners = np.array(model.polygon_m) * (1.0, 1.0, -1.0)
                opening = polygon_opening(corners, way, shape.mesh)
        except OpeningError as error:
            key = "polygon_m" if model.at_m is None else "at_m"
            self._note((*at[:-1], "opening", key), f"no opening: {error}")
            return shape
        return replace(shape, openings=(opening,))

    def _apply_colors(self, at: _Path, model: ObjectModel, shape: Shape) -> Shape:
        """Return an object's shape with its texture, if the world file names one."""
        if model.texture is None:
            return shape
        if model.color is not None:
            self._note((*at, "color"), "the texture has its own colours; give one of the two")
        path = self._folder / model.texture
        try:
            return shape.textured(load_texture(path))
        except (OSError, ValueError) as error:
            reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
            message = f"texture file '{model.texture}': {reason}"
            self._note((*at, "texture"), message, self._similar_file(model.texture))
            return shape

    def _similar_file(self, written: str) -> str:
        """Return the path of a file that a misspelt one may mean, as it would be written; ""."""
        path = self._folder / written
        if path_exists(path) or not is_folder(path.parent):
            return ""
        try:
            names = [each.name for each in path.parent.iterdir()]
        except OSError:  # it may be entered, and not listed
            return ""
        found = closest_file(path.name, names)
        return str(Path(written).parent / found) if found else ""

    def _check_floor(self, scene_object: SceneObject, floor_m: float) -> None:
        """Note objects of the world file that stick in the floor, at rest or at waypoints.

        Meshes from files may stick in it, as terrain and roots do, but must not be buried whole.
        """
        if scene_object.is_room or scene_object.name in self._unreadable:
            return
        buried = scene_object.shape.kind == "mesh"
        stops: list[tuple[_Path, Pose]] = [(("pose",), scene_object.pose)]
        legs = scene_object.motion.waypoints if scene_object.motion else ()
        stops += [
            (("motion", "waypoints", index), Pose(each.position_ned_m, scene_object.pose.q_wxyz))
            for index, each in enumerate(legs)
        ]
        for path, pose in stops:
            down_m = _down_extent(scene_object.shape, pose)
            edge_m = down_m[0] if buried else down_m[1]
            if edge_m > floor_m + _IN_FLOOR_TOLERANCE_M:
                depth_m = edge_m - floor_m
                what = f"'{scene_object.name}' reaches {depth_m:.3g} m below the floor"
                higher = -pose.position_ned_m[2] + depth_m
                place = ("objects", scene_object.name, *path, "up_m")
                self._note(place, f"{what}; up_m must be at least {higher:.4g}")


def _exists_in(model: ObjectModel) -> ExistsModel:
    """Return where an object of the world file exists; a room is everywhere by default."""
    if model.exists_in is not None:
        return model.exists_in
    return _EVERYWHERE if model.shape.room is not None else ExistsModel()


def _floor_down_m(placed: tuple[PlacedObject, ...], ground_down_m: float | None) -> float:
    """Return the down coordinate of the world file's lowest floor: of a room or the ground, else 0.

    ground_down_m: that of the ground, where the file states it.
    """
    floors = [
        each.scene_object.pose.position_ned_m[2] for each in placed if each.scene_object.is_room
    ]
    if ground_down_m is not None:
        floors.append(ground_down_m)
    return max(floors, default=0.0)


def _away_m(shape: Shape) -> float:
    """Return how far the box about a shape is from the origin of its object, 0 where it is in."""
    low, high = shape.mesh.vertices_m.min(axis=0), shape.mesh.vertices_m.max(axis=0)
    return float(np.linalg.norm(np.clip(0.0, low, high)))


def _down_extent(shape: Shape, pose: Pose) -> tuple[float, float]:
    """Return the least and the greatest down coordinate of a shape at a pose."""
    down = shape.mesh.vertices_m @ matrix_from_quat(pose.q_wxyz)[2] + pose.position_ned_m[2]
    return float(np.min(down)), float(np.max(down))


def _built_in(model: ShapeModel, rgb: Rgb | None) -> Shape:
    """Return the built-in shape that the world file names; colour None is the shape's own."""
    if model.gate is not None:
        gate = model.gate
        return shapes.gate_shape(gate.form, gate.inner_size_m, gate.bar_m, rgb or NAMED["orange"])
    if model.room is not None:
        size = (model.room.size_north_m, model.room.size_east_m, model.room.height_m)
        return shapes.room_shape(
            *size, ceiling=model.room.ceiling == "closed", seed=model.room.seed
        )
    if model.box is not None:
        return shapes.box_shape(model.box.size_m, rgb or NAMED["grey"])
    if model.quadrotor is not None:
        return shapes.quadrotor_shape(model.quadrotor.size_m, rgb or NAMED["silver"])
    return shapes.person_shape(rgb or shapes.SHIRT_RGB)


def _motion(pose: Pose, model: MotionModel) -> ObjectMotion:
    """Return an object's motion from its part of the world file."""
    start = model.start
    begin = (
        StartOnEvent(start.on, start.delay_s)
        if start.on
        else StartOnEvent("goal", start.at_s or 0.0)
    )
    waypoints = tuple(
        Waypoint(
            (each.north_m, each.east_m, -each.up_m),
            each.speed_m_s,
            None if each.yaw_deg is None else math.radians(each.yaw_deg),
        )
        for each in model.waypoints
    )
    return ObjectMotion(
        pose, waypoints, begin, model.loop, model.acceleration_m_s2, model.speed_sd_m_s
    )
