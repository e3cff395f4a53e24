"""Built-in shapes: gate, box, person, quadrotor, room; each with mesh, parts and openings.

Frames: FRD metres. A gate's origin is the centre of its opening and it is flown through along
forward; a box and a quadrotor have theirs in the middle, a person on the ground between the
feet, a room in the middle of its floor.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np

from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene import meshes, textures
from wil_campaign.worlds.scene.colors import NAMED, Rgb
from wil_campaign.worlds.scene.gait import ANKLE_M, HIP_M, JOINTS, KNEE_M, Joint
from wil_campaign.worlds.scene.meshes import BgrTexture, Material, Mesh
from wil_campaign.worlds.scene.parts import BoxShape, HullShape, ObjectOpening, SolidPart

RING_SEGMENTS = 48
WALL_THICKNESS_M = 0.1
SHIRT_RGB: Rgb = (70, 110, 160)
_CACHED_SHAPES = 8
"""Cached shapes of a kind: the cases of a campaign share them, and none is modified."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """An object's shape in its own frame: visible mesh, touchable parts, openings.

    limbs: what moves against the rest while the object moves, together the whole shape at rest.
    """

    kind: str
    mesh: Mesh
    parts: tuple[SolidPart, ...]
    openings: tuple[ObjectOpening, ...] = ()
    limbs: tuple["ShapeLimb", ...] = ()

    @property
    def radius_m(self) -> float:
        """Return the radius of the sphere about the origin that holds the shape's parts."""
        reach = (math.hypot(*part.pose.position_ned_m) + part.shape.radius_m for part in self.parts)
        return max(reach, default=0.0)

    def textured(self, texture: BgrTexture) -> "Shape":
        """Return this shape with one texture on every surface, in the texture's own colours."""
        limbs = tuple(replace(limb, shape=limb.shape.textured(texture)) for limb in self.limbs)
        return replace(self, mesh=self.mesh.textured(texture), limbs=limbs)


@dataclass(frozen=True, slots=True, eq=False)
class ShapeLimb:
    """A limb of a shape, where it is at rest, and the joint that moves it."""

    joint: Joint
    shape: Shape


@dataclass(frozen=True, slots=True)
class _Piece:
    """A convex piece of a shape that is drawn as it is touched."""

    name: str
    mesh: Mesh


def _assemble(kind: str, pieces: Sequence[_Piece]) -> Shape:
    """Return the shape assembled from convex pieces."""
    parts = tuple(SolidPart(piece.name, *_hull(piece.mesh)) for piece in pieces)
    return Shape(kind, meshes.merge_meshes([piece.mesh for piece in pieces]), parts)


def _hull(mesh: Mesh) -> tuple[HullShape, Pose]:
    """Return a convex mesh as a solid part about its middle, corners welded, and its pose."""
    middle = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2.0
    about_middle = np.round(mesh.vertices_m - middle, 9)
    corners, index = np.unique(about_middle, axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    whole = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    hull = HullShape(np.ascontiguousarray(corners), faces[whole].astype(np.int32))
    return hull, Pose(meshes.vec3(middle))


@lru_cache(maxsize=_CACHED_SHAPES)
def gate_shape(
    form: Literal["square", "ring"], inner_size_m: float, bar_m: float, color: Rgb = NAMED["orange"]
) -> Shape:
    """Return the shape of a gate of bars with a square cross-section.

    inner_size_m: inner edge of the square, or inner diameter of the ring.
    """
    material = Material(color)
    opening = ObjectOpening("opening", form, inner_size_m / 2.0)
    if form == "ring":
        ring = _assemble("gate", list(_ring_pieces(inner_size_m / 2.0, bar_m, material)))
        return Shape("gate", ring.mesh, ring.parts, (opening,))
    middle_m, outer_m = (inner_size_m + bar_m) / 2.0, inner_size_m + 2.0 * bar_m
    bars: tuple[tuple[str, Vec3, Vec3], ...] = (
        ("left", (bar_m, bar_m, outer_m), (0.0, -middle_m, 0.0)),
        ("right", (bar_m, bar_m, outer_m), (0.0, middle_m, 0.0)),
        ("top", (bar_m, inner_size_m, bar_m), (0.0, 0.0, -middle_m)),
        ("bottom", (bar_m, inner_size_m, bar_m), (0.0, 0.0, middle_m)),
    )
    return Shape(
        "gate",
        meshes.merge_meshes(
            [meshes.box_mesh(size, material).moved(Pose(at)) for _, size, at in bars]
        ),
        tuple(SolidPart(name, BoxShape(_half(size)), Pose(at)) for name, size, at in bars),
        (opening,),
    )


def _half(size_m: Vec3) -> Vec3:
    """Return the half extents of a box shape."""
    return (size_m[0] / 2.0, size_m[1] / 2.0, size_m[2] / 2.0)


def _ring_pieces(inner_radius_m: float, bar_m: float, material: Material) -> Iterable[_Piece]:
    """Yield the segments of a ring gate's shape; inner edges touch the inner circle."""
    step = 2.0 * math.pi / RING_SEGMENTS
    stretch = 1.0 / math.cos(step / 2.0)
    half = bar_m / 2.0
    sides = np.array(
        [[0, 1, 2, 3], [7, 6, 5, 4], [0, 4, 5, 1], [3, 2, 6, 7], [0, 3, 7, 4], [1, 5, 6, 2]]
    )
    faces = np.concatenate([sides[:, [2, 1, 0]], sides[:, [3, 2, 0]]])
    for segment in range(RING_SEGMENTS):
        corners = [
            (forward, radius * stretch * math.sin(angle), -radius * stretch * math.cos(angle))
            for angle in (segment * step, (segment + 1) * step)
            for forward, radius in (
                (half, inner_radius_m),
                (half, inner_radius_m + bar_m),
                (-half, inner_radius_m + bar_m),
                (-half, inner_radius_m),
            )
        ]
        degrees = round(math.degrees(segment * step))
        segment_mesh = meshes.mesh_from_triangles(np.array(corners), faces, material)
        yield _Piece(f"ring {degrees:03d}", replace(segment_mesh, closed=True))


def box_shape(size_m: Vec3, color: Rgb = NAMED["grey"]) -> Shape:
    """Return the shape of a centred box; size along forward, right, down."""
    part = SolidPart("box", BoxShape(_half(size_m)), Pose((0.0, 0.0, 0.0)))
    return Shape("box", meshes.box_mesh(size_m, Material(color)), (part,))


@lru_cache(maxsize=_CACHED_SHAPES)
def quadrotor_shape(size_m: float = 0.3, color: Rgb = NAMED["silver"]) -> Shape:
    """Return the shape of a quadrotor in X layout; size is its width over the rotors."""
    body, dark = Material(color), Material((45, 45, 50))
    red, green = Material(NAMED["red"]), Material(NAMED["green"])
    unit = size_m / 2.0 / (math.sqrt(0.5) + 0.52)
    pieces = [
        _Piece("hull", meshes.box_mesh((0.62 * unit, 0.42 * unit, 0.26 * unit), body)),
        _Piece(
            "battery",
            meshes.box_mesh((0.5 * unit, 0.3 * unit, 0.16 * unit), dark).moved(
                Pose((0.0, 0.0, -0.2 * unit))
            ),
        ),
        _Piece(
            "camera",
            meshes.box_mesh((0.12 * unit, 0.2 * unit, 0.14 * unit), dark).moved(
                Pose((0.36 * unit, 0.0, 0.02 * unit))
            ),
        ),
    ]
    for name, yaw_deg, tip in (
        ("front right", 45, green),
        ("rear right", 135, dark),
        ("rear left", -135, dark),
        ("front left", -45, red),
    ):
        turn = Pose.of(0.0, 0.0, 0.0, yaw_rad=math.radians(yaw_deg))
        arm = meshes.box_mesh((unit, 0.09 * unit, 0.08 * unit), body).moved(
            turn.compose(Pose((0.5 * unit, 0.0, 0.0)))
        )
        motor = meshes.frustum_mesh(0.13 * unit, 0.13 * unit, 0.24 * unit, tip).moved(
            turn.compose(Pose((unit, 0.0, -0.06 * unit)))
        )
        rotor = meshes.frustum_mesh(0.52 * unit, 0.52 * unit, 0.03 * unit, dark, slices=20).moved(
            turn.compose(Pose((unit, 0.0, -0.2 * unit)))
        )
        pieces += [
            _Piece(f"{name} arm", arm),
            _Piece(f"{name} motor", motor),
            _Piece(f"{name} rotor", rotor),
        ]
    return _assemble("quadrotor", pieces)


@lru_cache(maxsize=_CACHED_SHAPES)
def person_shape(color: Rgb = SHIRT_RGB) -> Shape:
    """Return the shape of a standing person of 1.75 m, facing forward; colour of the shirt."""
    skin, hair = Material((214, 168, 140)), Material((70, 48, 35))
    shirt, trousers, shoes = Material(color), Material((45, 52, 72)), Material((40, 36, 34))

    def ball(radii: Vec3, at: Vec3, material: Material) -> Mesh:
        return meshes.ellipsoid_mesh(radii, material).moved(Pose(at))

    def limb(
        top_m: float,
        bottom_m: float,
        radii: tuple[float, float],
        right_m: float,
        material: Material,
        *,
        tilt_deg: float = 0.0,
        flatten: float = 1.0,
    ) -> Mesh:
        tilt = Pose.of(0.0, right_m, (top_m + bottom_m) / 2.0, roll_rad=math.radians(tilt_deg))
        return meshes.frustum_mesh(*radii, top_m - bottom_m, material, flatten=flatten).moved(tilt)

    trunk = [
        _Piece("hips", limb(0.98, 0.80, (0.168, 0.178), 0.0, trousers, flatten=0.62)),
        _Piece("torso", limb(1.38, 0.96, (0.205, 0.165), 0.0, shirt, flatten=0.58)),
        _Piece("shoulders", ball((0.112, 0.225, 0.080), (0.0, 0.0, -1.385), shirt)),
        _Piece("neck", limb(1.54, 1.42, (0.055, 0.06), 0.0, skin)),
        _Piece("head", ball((0.095, 0.078, 0.118), (0.01, 0.0, -1.622), skin)),
        _Piece("hair", ball((0.098, 0.086, 0.100), (-0.018, 0.0, -1.650), hair)),
    ]
    pieces: dict[str, list[_Piece]] = {"trunk": trunk}
    for side, sign in (("right", 1.0), ("left", -1.0)):
        pieces[f"{side} arm"] = [
            _Piece(
                f"{side} upper arm",
                limb(1.40, 1.09, (0.056, 0.047), sign * 0.235, shirt, tilt_deg=-sign * 7.0),
            ),
            _Piece(
                f"{side} forearm",
                limb(1.10, 0.83, (0.042, 0.034), sign * 0.262, skin, tilt_deg=-sign * 3.0),
            ),
            _Piece(f"{side} hand", ball((0.05, 0.03, 0.08), (0.01, sign * 0.27, -0.79), skin)),
        ]
        thigh = limb(HIP_M + 0.02, KNEE_M - 0.02, (0.088, 0.073), sign * 0.09, trousers)
        pieces[f"{side} thigh"] = [_Piece(f"{side} thigh", thigh)]
        shank = limb(KNEE_M + 0.02, ANKLE_M - 0.01, (0.074, 0.06), sign * 0.09, trousers)
        pieces[f"{side} shank"] = [_Piece(f"{side} shank", shank)]
        foot = ball((0.14, 0.05, 0.05), (0.05, sign * 0.1, -0.05), shoes)
        pieces[f"{side} foot"] = [_Piece(f"{side} foot", foot)]
    standing = _assemble("person", [piece for some in pieces.values() for piece in some])
    limbs = (ShapeLimb(joint, _assemble("person", pieces[joint])) for joint in JOINTS)
    return replace(standing, limbs=tuple(limbs))


@lru_cache(maxsize=_CACHED_SHAPES)
def room_shape(
    size_north_m: float, size_east_m: float, height_m: float, *, ceiling: bool = True, seed: int = 0
) -> Shape:
    """Return the shape of a room: the space inside its inner faces is free.

    Every wall has its own texture, so that an image shows where the camera looks. Solid are the
    walls outside of the inner faces; the part "floor" is marked as such.
    """
    sides = _room_sides(size_north_m, size_east_m, height_m, seed)
    drawn = [side for side in sides if ceiling or side.name != "ceiling"]
    thick = WALL_THICKNESS_M
    parts = []
    for side in drawn:
        normal = np.cross(side.right_m, side.up_m)
        normal /= np.linalg.norm(normal)
        half = np.abs(side.right_m) + np.abs(side.up_m)
        # The walls overlap at the corners, so that no gap is left there.
        half = np.where(np.abs(normal) > 0.5, thick / 2.0, half + thick)
        at = np.array(side.center_m) - normal * thick / 2.0
        shape, pose = BoxShape(meshes.vec3(half)), Pose(meshes.vec3(at))
        parts.append(SolidPart(side.name, shape, pose, is_floor=side.name == "floor"))
    return Shape("room", meshes.merge_meshes([side.mesh() for side in drawn]), tuple(parts))


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """An inner face of a room's shape: centre, half edges right and up as seen from inside."""

    name: str
    center_m: Vec3
    right_m: Vec3
    up_m: Vec3
    texture: meshes.BgrTexture
    repeat_m: float

    def mesh(self) -> Mesh:
        across = 2.0 * math.hypot(*self.right_m) / self.repeat_m
        along = 2.0 * math.hypot(*self.up_m) / self.repeat_m
        material = Material((255, 255, 255), self.texture)
        return meshes.quad_mesh(self.center_m, self.right_m, self.up_m, material, (across, along))


@lru_cache(maxsize=_CACHED_SHAPES)
def room_textures(seed: int) -> tuple[meshes.BgrTexture, ...]:
    """Return the textures of a room's shape: north, east, south, west, floor, ceiling; 16 ms."""
    seeds = [seed * 6 + index for index in range(6)]
    return (
        textures.block_texture(seeds[0], (165, 170, 172)),
        textures.concrete_texture(seeds[1], (150, 165, 150)),
        textures.block_texture(seeds[2], (160, 154, 158)),
        textures.concrete_texture(seeds[3], (168, 158, 146)),
        textures.tile_texture(seeds[4], (98, 96, 92)),
        textures.panel_texture(seeds[5], (238, 240, 240)),
    )


def _room_sides(north_m: float, east_m: float, height_m: float, seed: int) -> tuple[_Side, ...]:
    """Return the inner faces of a room's shape, textured by a seed."""
    n, e, h = north_m / 2.0, east_m / 2.0, height_m / 2.0
    up = (0.0, 0.0, -h)
    north, east, south, west, floor, ceiling = room_textures(seed)
    return (
        _Side(
            "north wall",
            (n, 0.0, -h),
            (0.0, e, 0.0),
            up,
            north,
            1.6,
        ),
        _Side(
            "east wall",
            (0.0, e, -h),
            (-n, 0.0, 0.0),
            up,
            east,
            2.5,
        ),
        _Side(
            "south wall",
            (-n, 0.0, -h),
            (0.0, -e, 0.0),
            up,
            south,
            2.0,
        ),
        _Side(
            "west wall",
            (0.0, -e, -h),
            (n, 0.0, 0.0),
            up,
            west,
            2.5,
        ),
        _Side(
            "floor",
            (0.0, 0.0, 0.0),
            (0.0, e, 0.0),
            (n, 0.0, 0.0),
            floor,
            2.0,
        ),
        _Side(
            "ceiling",
            (0.0, 0.0, -2.0 * h),
            (0.0, -e, 0.0),
            (n, 0.0, 0.0),
            ceiling,
            2.4,
        ),
    )
