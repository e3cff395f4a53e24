"""Compares the world that a simulator reports to show with the requested one; pure.

An image alone does not distinguish a gate of 1.0 m from one of 0.5 m that is nearer.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wil_campaign.plugins.readings.messagepack import BadMessageError, MessageHeader
from wil_campaign.worlds.frames import Pose, Quat, Vec3, angle_between
from wil_campaign.worlds.scene.colors import Rgb
from wil_campaign.worlds.scene.meshes import Material
from wil_campaign.worlds.scene.scene import Scene

TOLERANCE_M, TOLERANCE = 0.01, 0.01
"""Allowed difference of an engine's shapes: in metres, or as a fraction of a size."""
_TURN_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True)
class ShownObject:
    """An object of the virtual world, at rest.

    size_m: of the box around it, along its own forward, right and down axes. opening_m: the inner
    edge or diameter of its opening, form: `square` or `ring`; None and empty without one. q_wxyz:
    its attitude, to north, east, down. color_rgb: 0 to 255; None of what has several, or textures.
    """

    kind: str
    size_m: Vec3
    position_ned_m: Vec3
    q_wxyz: Quat
    opening_m: float | None = None
    form: str = ""
    color_rgb: tuple[int, int, int] | None = None


@dataclass(frozen=True, slots=True)
class ShownWorld:
    """A world by name, its case, and its objects by name; None where not reported."""

    world: str | None = None
    case: str | None = None
    objects: Mapping[str, ShownObject] | None = None


@dataclass(frozen=True, slots=True)
class AskedWorld:
    """The world that a simulator is asked to show. ids: the objects' values in id images."""

    world: str = ""
    case: str = ""
    objects: Mapping[str, ShownObject] = field(default_factory=dict)
    ids: Mapping[str, int] = field(default_factory=dict)


def asked_world(scene: Scene, *, world: str, case: str) -> AskedWorld:
    """Return a scene as the world that a simulator is asked to show."""
    return AskedWorld(
        world=world,
        case=case,
        objects=shown_objects(scene),
        ids={placed.name: placed.object_id for placed in scene.objects},
    )


def shown_objects(scene: Scene) -> dict[str, ShownObject]:
    """Return the objects of a scene, by name."""
    found: dict[str, ShownObject] = {}
    for placed in scene.objects:
        corners_m = placed.shape.mesh.vertices_m
        north, east, down = (corners_m.max(axis=0) - corners_m.min(axis=0)).tolist()
        openings = [opening for opening in placed.shape.openings if opening.form != "polygon"]
        found[placed.name] = ShownObject(
            kind=placed.shape.kind,
            size_m=(north, east, down),
            position_ned_m=placed.pose.position_ned_m,
            q_wxyz=placed.pose.q_wxyz,
            opening_m=2.0 * openings[0].limit_m if len(openings) == 1 else None,
            form=openings[0].form if len(openings) == 1 else "",
            color_rgb=_color_of(placed.shape.mesh.materials),
        )
    return found


def poses_of_moving(scene: Scene, t_s: float, events: Mapping[str, float]) -> dict[str, Pose]:
    """Return where the objects of a scene that move are at a time, by name."""
    return {
        placed.name: placed.pose_at(t_s, events)
        for placed in scene.objects
        if placed.motion is not None
    }


def _color_of(materials: Sequence[Material]) -> Rgb | None:
    """Return the colour of an object that has a single one."""
    colors = {None if material.texture is not None else material.rgb for material in materials}
    return colors.pop() if len(colors) == 1 else None


def packed_objects(objects: Mapping[str, ShownObject]) -> dict[str, dict[str, Any]]:
    """Return objects as `hello` and `welcome` carry them."""
    return {
        name: {
            "kind": shown_object.kind,
            "size_m": list(shown_object.size_m),
            "position_ned_m": list(shown_object.position_ned_m),
            "q_wxyz": list(shown_object.q_wxyz),
            **({} if shown_object.opening_m is None else {"opening_m": shown_object.opening_m}),
            **({"form": shown_object.form} if shown_object.form else {}),
            **(
                {}
                if shown_object.color_rgb is None
                else {"color_rgb": list(shown_object.color_rgb)}
            ),
        }
        for name, shown_object in objects.items()
    }


def shown_world(header: MessageHeader) -> ShownWorld:
    """Return the world that a `welcome` reports to show. Raises BadMessageError."""
    return ShownWorld(
        world=header.text("world") if "world" in header else None,
        case=header.text("case") if "case" in header else None,
        objects=_objects_of(header.header("shapes")) if "shapes" in header else None,
    )


def _objects_of(shapes: MessageHeader) -> dict[str, ShownObject]:
    found: dict[str, ShownObject] = {}
    for name in shapes.names:
        one = shapes.header(name)
        try:
            north_m, east_m, down_m = one.numbers("size_m", 3)
            at_n, at_e, at_d = one.numbers("position_ned_m", 3)
            w, x, y, z = one.numbers("q_wxyz", 4)
            found[name] = ShownObject(
                kind=one.text("kind") if "kind" in one else "",
                size_m=(north_m, east_m, down_m),
                position_ned_m=(at_n, at_e, at_d),
                q_wxyz=(w, x, y, z),
                opening_m=one.number("opening_m") if "opening_m" in one else None,
                form=one.text("form") if "form" in one else "",
            )
        except BadMessageError as error:
            raise BadMessageError(f"shape {name!r:.40}: {error}") from error
    return found


def world_disagreements(asked: AskedWorld, shown: ShownWorld) -> tuple[str, ...]:
    """Return in words how the shown world differs from the requested one, where it is reported."""
    found = [
        f"it shows the {what} '{reported}', and '{requested}' is flown"
        for what, requested, reported in (
            ("world", asked.world, shown.world),
            ("case", asked.case, shown.case),
        )
        if reported is not None and reported != requested
    ]
    if shown.objects is not None:
        for name, wanted in asked.objects.items():
            there = shown.objects.get(name)
            missing = (f"it does not show {name}: the `shapes` of its `welcome` lack this object",)
            found += missing if there is None else _differences(name, wanted, there)
    return tuple(found)


def _differences(name: str, asked: ShownObject, shown: ShownObject) -> Iterator[str]:
    if not _alike(asked.opening_m, shown.opening_m):
        yield (
            f"it shows {name} with an opening of {shown.opening_m:.2f} m, and "
            f"{asked.opening_m:.2f} m is judged"
        )
    if asked.form and shown.form and asked.form != shown.form:
        yield f"it shows {name} as a {shown.form}, and a {asked.form} is judged"
    if not all(map(_alike, asked.size_m, shown.size_m)):
        yield f"it shows {name} {_size(shown.size_m)} large, and {_size(asked.size_m)} is judged"
    away_m = math.dist(asked.position_ned_m, shown.position_ned_m)
    if away_m > TOLERANCE_M:
        yield f"it shows {name} {away_m:.2f} m from its place"
    turned_rad = angle_between(asked.q_wxyz, shown.q_wxyz)
    if turned_rad > _TURN_RAD:
        yield f"it shows {name} turned by {math.degrees(turned_rad):.0f} degrees"


def _alike(one_m: float | None, other_m: float | None) -> bool:
    if one_m is None or other_m is None:
        return True
    return abs(one_m - other_m) <= max(TOLERANCE_M, TOLERANCE * abs(one_m))


def _size(size_m: Vec3) -> str:
    return " x ".join(f"{side_m:.2f}" for side_m in size_m) + " m"
