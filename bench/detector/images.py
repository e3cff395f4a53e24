"""Labelled images for the shipped detector, made by our own renderer from drawn scenes.

A drawn scene is a room of its own textures with boxes and a gate in it, a person who walks about
and a drone that flies about, each in colours of its own. What an image shows of them is known from
the renderer's object ids. No campaign's world is among them.
"""

import colorsys
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3, quat_from_euler
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.meshes import Mesh
from wil_campaign.worlds.scene.motion import ObjectMotion, Waypoint
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape

NAMES = ("person", "quadrotor")
WIDTH_PX, HEIGHT_PX = 320, 240
LEAST_PX = (40, 14)
"""Visible pixels of a person and a drone below which nothing is to be found."""
LEAST_SHARE = 0.35
"""Of an object's pixels: with less in view nobody can say what is right."""
_PERSON, _DRONE = 1, 2

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class LabelledImage:
    """An image (HEIGHT_PX, WIDTH_PX, 3) BGR. boxes: (n, 5) class, centre x, y, width, height."""

    image_bgr: Image
    boxes: NDArray[np.float32]


def labelled_images(seed: int, scenes: int, each: int) -> Iterator[LabelledImage]:
    """Yield labelled images of drawn scenes, so many of each."""
    for index in range(scenes):
        rng = np.random.default_rng([seed, index])
        studio = _Studio(rng)
        made = 0
        while made < each:
            image = studio.image(rng)
            if image is not None:
                made += 1
                yield image


class _Studio:
    """A drawn scene with its renderer."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._size: Vec3 = (*(float(v) for v in rng.uniform(6, 12, 2)), float(rng.uniform(2.4, 4)))
        room = shapes.room_shape(*self._size, seed=int(rng.integers(1, 100_000)))
        self._person = _motion(rng, self._size, (0.0, 0.0), spin=True)
        self._drone = _motion(rng, self._size, (0.15, self._size[2] - 0.3), spin=True)
        person = _recolored(shapes.person_shape(_color(rng)), rng)
        drone = _recolored(shapes.quadrotor_shape(float(rng.uniform(0.25, 0.5)), _color(rng)), rng)
        things = [
            SceneObject(_PERSON, "person", person, self._person.begin, self._person),
            SceneObject(_DRONE, "drone", drone, self._drone.begin, self._drone),
            SceneObject(3, "room", room, Pose((0.0, 0.0, 0.0))),
        ]
        things += [_clutter(4 + index, rng, self._size) for index in range(int(rng.integers(0, 5)))]
        self._renderer = Renderer(Scene(tuple(things)))
        self._names = [thing.name for thing in things]

    def image(self, rng: np.random.Generator) -> LabelledImage | None:
        """Return one image; None where its content is ambiguous."""
        t_s = float(rng.uniform(0.0, 40.0))
        shown = {name for name in self._names if name not in {"person", "drone"}}
        draw = rng.uniform()
        shown |= {"person"} if draw < 0.35 else {"drone"} if draw < 0.72 else set()
        shown |= {"person", "drone"} if draw > 0.9 else set()
        target = (
            "drone" if "drone" in shown and ("person" not in shown or draw < 0.95) else "person"
        )
        motion = self._drone if target == "drone" else self._person
        camera = self._camera(rng, motion.pose_at(t_s, {}), target)
        fov = math.radians(float(rng.uniform(55, 85)))
        optics = Intrinsics.from_fov(2 * WIDTH_PX, 2 * HEIGHT_PX, fov)
        made = self._renderer.render(camera, optics, t_s, want_depth=False, only=frozenset(shown))
        assert made.object_ids is not None  # noqa: S101 - asked for
        boxes: list[tuple[float, ...]] = []
        for kind, name in ((0, "person"), (1, "drone")):
            if name not in shown:
                continue
            alone = self._renderer.render(
                camera, optics, t_s, want_depth=False, only=frozenset({name})
            )
            assert alone.object_ids is not None  # noqa: S101 - asked for
            seen, whole = made.object_ids == kind + 1, np.count_nonzero(alone.object_ids)
            count = np.count_nonzero(seen)
            if count == 0:
                continue
            if count < 4 * LEAST_PX[kind] or count < LEAST_SHARE * whole:
                return None
            rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
            top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
            width, height = (right - left) / 2, (bottom - top) / 2
            boxes.append((kind, (left + right) / 4, (top + bottom) / 4, width, height))
        image = _as_filmed(made.image_bgr, made.object_ids, rng)
        return LabelledImage(image, np.array(boxes, np.float32).reshape(-1, 5))

    def _camera(self, rng: np.random.Generator, target: Pose, kind: str) -> Pose:
        """Return the pose of a camera in the room that looks about at the target."""
        north, east, down = target.position_ned_m
        middle_m = -down + (0.0 if kind == "drone" else 0.9)
        inside = (self._size[0] / 2 - 0.2, self._size[1] / 2 - 0.2)
        for _ in range(50):
            away_m = float(rng.uniform(0.6, 4.0) if kind == "drone" else rng.uniform(1.5, 6.0))
            bearing = float(rng.uniform(-math.pi, math.pi))
            at = (north + away_m * math.cos(bearing), east + away_m * math.sin(bearing))
            if abs(at[0]) < inside[0] and abs(at[1]) < inside[1]:
                break
        else:
            at = (0.0, 0.0)
        up_m = float(np.clip(middle_m + rng.normal(0, 0.5), 0.3, self._size[2] - 0.3))
        ahead = math.atan2(east - at[1], north - at[0])
        away_m = max(0.3, math.hypot(north - at[0], east - at[1]))
        yaw = ahead + float(rng.uniform(-0.45, 0.45))
        pitch = 0.4 * math.atan2(middle_m - up_m, away_m) + float(rng.normal(0, 0.08))
        return Pose.of(*at, up_m, roll_rad=float(rng.normal(0, 0.06)), pitch_rad=pitch, yaw_rad=yaw)


def _motion(
    rng: np.random.Generator, size: Vec3, heights: tuple[float, float], *, spin: bool
) -> ObjectMotion:
    """Return a motion through the room that turns at its waypoints."""
    places = [
        (
            float(rng.uniform(-0.5, 0.5) * (size[0] - 1.2)),
            float(rng.uniform(-0.5, 0.5) * (size[1] - 1.2)),
            -float(rng.uniform(*heights)) if heights[1] else 0.0,
        )
        for _ in range(12)
    ]
    tilt = rng.normal(0, 0.15, 2) if heights[1] else (0.0, 0.0)
    begin = Pose(places[0], quat_from_euler(float(tilt[0]), float(tilt[1]), 0.0))
    waypoints = []
    for before, after in pairwise(places):
        heading = math.atan2(after[1] - before[1], after[0] - before[0])
        heading += 0.0 if not heights[1] else float(rng.uniform(-math.pi, math.pi))
        speed_m_s = float(rng.uniform(0.5, 3.0))
        if spin and rng.uniform() < 0.9:
            waypoints.append(Waypoint(before, speed_m_s, heading))
        waypoints.append(Waypoint(after, speed_m_s, heading))
    return ObjectMotion(begin, tuple(waypoints), loop=True)


def _clutter(object_id: int, rng: np.random.Generator, size: Vec3) -> SceneObject:
    """Return a box, tall like a person or small like a drone, or a gate."""
    kind = rng.uniform()
    if kind < 0.25:
        shape = shapes.gate_shape("square", float(rng.uniform(0.5, 1.2)), 0.1, _color(rng))
        up_m = 1.2
    elif kind < 0.7:
        sides = (float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.2, 1.0)))
        tall_m = float(rng.uniform(0.4, 2.0))
        shape, up_m = shapes.box_shape((*sides, tall_m), _color(rng)), tall_m / 2
    else:
        sides = (float(rng.uniform(0.1, 0.5)), float(rng.uniform(0.1, 0.5)))
        shape = shapes.box_shape((*sides, float(rng.uniform(0.05, 0.3))), _color(rng))
        up_m = float(rng.uniform(0.2, 2.0))
    at = [float(rng.uniform(-0.5, 0.5) * (side - 1.0)) for side in size[:2]]
    yaw_rad = float(rng.uniform(-math.pi, math.pi))
    pose = Pose.of(at[0], at[1], up_m, yaw_rad=yaw_rad)
    return SceneObject(object_id, f"clutter {object_id}", shape, pose)


def _color(rng: np.random.Generator) -> tuple[int, int, int]:
    """Return a colour: any hue, from grey to saturated, from dark to bright."""
    hue, saturation, value = rng.uniform(0, 1), rng.uniform(0, 1), rng.uniform(0.1, 1.0)
    red, green, blue = colorsys.hsv_to_rgb(hue, saturation, value)
    return (round(255 * red), round(255 * green), round(255 * blue))


def _recolored(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return a shape whose materials other than the drawn one are varied as well."""
    found: dict[tuple[int, int, int], tuple[int, int, int]] = {}

    def paint(mesh: Mesh) -> Mesh:
        materials = []
        for material in mesh.materials:
            if material.rgb not in found:
                new = np.array(material.rgb) * rng.uniform(0.6, 1.3) + rng.normal(0, 18, 3)
                red, green, blue = (int(v) for v in np.clip(new, 0, 255))
                found[material.rgb] = (red, green, blue)
            materials.append(replace(material, rgb=found[material.rgb]))
        return replace(mesh, materials=tuple(materials))

    limbs = tuple(
        replace(limb, shape=replace(limb.shape, mesh=paint(limb.shape.mesh)))
        for limb in shape.limbs
    )
    return replace(shape, mesh=paint(shape.mesh), limbs=limbs)


def _as_filmed(image: Image, ids: NDArray[np.uint8], rng: np.random.Generator) -> Image:
    """Return an image of half the size with exposure, blur and noise of a camera.

    In a third of them the objects are not filmed like the room: so is a mixed image.
    """
    small = cv2.resize(image, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA)
    filmed = small.astype(np.float32) * rng.uniform(0.6, 1.35) + rng.uniform(-20, 25)
    if rng.uniform() < 0.35:
        filmed *= rng.uniform(0.9, 1.1, 3).astype(np.float32)
    if rng.uniform() < 0.4:
        reach, angle = float(rng.uniform(1, 5)), float(rng.uniform(0, math.pi))
        kernel = np.zeros((7, 7), np.float32)
        for part in np.linspace(-0.5, 0.5, 15):
            x, y = 3 + part * reach * math.cos(angle), 3 + part * reach * math.sin(angle)
            kernel[round(y), round(x)] += 1
        filmed = cv2.filter2D(filmed, -1, kernel / kernel.sum())
    filmed += rng.normal(0, 1, filmed.shape).astype(np.float32) * rng.uniform(0, 5)
    if rng.uniform() < 0.33:
        objects = cv2.resize(
            np.isin(ids, (_PERSON, _DRONE)).astype(np.uint8),
            (WIDTH_PX, HEIGHT_PX),
            interpolation=cv2.INTER_NEAREST,
        )
        filmed = np.where(objects[:, :, None] > 0, small, filmed)
    return np.clip(filmed, 0, 255).astype(np.uint8)
