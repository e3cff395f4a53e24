"""Marks of relevant objects in an image, projected from the recorded world and poses; pure.

There is no detection in the image: a hidden object is marked where the record has it.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import ValidationError

from wil_campaign.foundation.files.documents import Data
from wil_campaign.orchestrator.report.model import ObjectMark, PageImage
from wil_campaign.orchestrator.report.reading.distances import TimedPose, pose_at
from wil_campaign.orchestrator.report.reading.outlines import vertices_of
from wil_campaign.orchestrator.report.reading.world_facts import recorded_body
from wil_campaign.vehicles.sensors.sensor_spec import MountPart
from wil_campaign.worlds.camera import CameraMount
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.scene.scene import Scene, SceneObject

_MOST = 3
_NEAR_M = 0.02
"""Points nearer to the camera are not projected."""
_BETWEEN = 6
"""Points between each two corners, for parts that are partly behind the camera."""
_MOST_CORNERS = 24
_FAR_M = 1e3

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SeenWorld:
    """Input of marks. poses: by vehicle, as judged. events: of the world.

    campaign, recipe: as flown. physical: names of the objects in the real world.
    """

    scene: Scene
    physical: frozenset[str]
    poses: Mapping[str, Sequence[TimedPose]]
    events: Mapping[str, float]
    campaign: Mapping[str, Data]
    recipe: str = ""


def marks_of(
    frame: PageImage,
    sensor: str,
    world: SeenWorld,
    *,
    of_interest: Iterable[str],
    touched: str = "",
) -> tuple[ObjectMark, ...]:
    """Return the marks of objects in an image; empty where the record is not sufficient.

    of_interest: names of objects. touched: a part, as "gate.left".
    """
    view = frame.view
    names = [name for name in dict.fromkeys(of_interest) if name in world.scene]
    objects = [world.scene[name] for name in names if not world.scene[name].is_room][:_MOST]
    if view is None or not objects:
        return ()
    distances = _distances(view.vehicle, frame.t_s, world, objects)
    found = []
    for obj in objects:
        camera = _camera_pose(frame, sensor, obj, world)
        if camera is not None:
            part = touched.removeprefix(f"{obj.name}.") if touched.startswith(obj.name) else ""
            parts = list(_seen_parts(frame, camera, obj, world.events))
            found.append(_mark(obj, distances.get(obj.name), parts, part))
    return tuple(found)


def _camera_pose(frame: PageImage, sensor: str, obj: SceneObject, world: SeenWorld) -> Pose | None:
    """Return the pose of the camera that shows an object; None where it is not recorded.

    In a mixture the recipe decides from which pose virtual objects were rendered.
    """
    assert frame.view is not None  # noqa: S101 - checked by the caller
    if frame.view.camera_pose is not None:
        return frame.view.camera_pose
    vehicle = frame.view.vehicle
    if frame.source == "mixed" and obj.name not in world.physical:
        vehicle = _registered_to(world.recipe, sensor)
    body, mount = pose_at(world.poses.get(vehicle, ()), frame.t_s), _mount(vehicle, sensor, world)
    return None if body is None or mount is None else mount.camera_pose(body)


def _registered_to(recipe: str, sensor: str) -> str:
    """Return the vehicle from whose pose the twin's sensor was rendered; by default the twin."""
    try:
        document = json.loads(recipe)
        steps = [
            step["register"]
            for part in document["combine"]
            if part.get("sensor") == sensor
            for step in part.get("transform", ())
            if isinstance(step, dict) and "register" in step
        ]
    except (ValueError, KeyError, TypeError, AttributeError):
        return ""
    given = steps[0] if steps else {"pose": "twin"}
    return str(given.get("pose", "real")) if isinstance(given, dict) else "real"


def _mount(vehicle: str, sensor: str, world: SeenWorld) -> CameraMount | None:
    """Return the mount of a camera; None where a calibration file defines it."""
    found: Data = dict(world.campaign)
    for key in ("vehicles", vehicle, "sensors", sensor.split(" ", maxsplit=1)[0]):
        found = found.get(key) if isinstance(found, dict) else None
    if not isinstance(found, dict) or found.get("calibration") is not None:
        return None
    try:
        part = MountPart.model_validate(found.get("mount") or {})
    except ValidationError:
        return None
    return CameraMount(part.pose(), stabilized=found.get("stabilized") is True)


def _distances(
    vehicle: str, t_s: float, world: SeenWorld, objects: Sequence[SceneObject]
) -> dict[str, float]:
    """Return the distances of objects from a vehicle's body at a time."""
    pose = pose_at(world.poses.get(vehicle, ()), t_s)
    if pose is None:
        return {}
    wanted = {obj.name for obj in objects}
    others = [name for name in world.scene.names if name not in wanted]
    body = recorded_body(world.campaign, vehicle)
    probe = ClearanceProbe(world.scene, body, exclude=others, floors=False, within_m=_FAR_M)
    nearest: dict[str, float] = {}
    for clearance in probe.sweep(pose, t_s, pose, t_s, world.events):
        known_m = nearest.get(clearance.object_name, math.inf)
        nearest[clearance.object_name] = max(0.0, min(known_m, clearance.clearance_m))
    return nearest


def _seen_parts(
    frame: PageImage, camera: Pose, obj: SceneObject, events: Mapping[str, float]
) -> Iterator[tuple[str, shapely.Geometry]]:
    """Yield the visible parts of an object, each with its shape in the image."""
    screen = shapely.box(0.0, 0.0, frame.width_px, frame.height_px)
    for body in obj.bodies:
        pose = body.pose_at(frame.t_s, events)
        for part in body.shape.parts:
            seen = shapely.intersection(_silhouette(vertices_of(part), pose, camera, frame), screen)
            if not part.is_floor and not seen.is_empty:
                yield part.name, seen


def _mark(
    obj: SceneObject,
    distance_m: float | None,
    parts: Sequence[tuple[str, shapely.Geometry]],
    touched: str,
) -> ObjectMark:
    shapes = [shape for name, shape in parts if name == touched and shape.geom_type == "Polygon"]
    outline = tuple((x, y) for x, y in shapes[0].exterior.coords) if shapes else ()
    box = None
    if parts:
        left, top, right, bottom = shapely.total_bounds([shape for _, shape in parts]).tolist()
        box = (left, top, right, bottom)
    return ObjectMark(obj.name, distance_m, box, touched, outline)


def _silhouette(corners: Points, pose: Pose, camera: Pose, frame: PageImage) -> shapely.Geometry:
    """Return the hull of a part in the image, pixels; empty where it is behind the camera."""
    world = corners @ matrix_from_quat(pose.q_wxyz).T + np.array(pose.position_ned_m)
    seen = (world - np.array(camera.position_ned_m)) @ matrix_from_quat(camera.q_wxyz)
    seen = _with_points_between(seen)
    seen = seen[seen[:, 0] > _NEAR_M]
    if not len(seen):
        return shapely.Point()
    assert frame.view is not None  # noqa: S101 - checked by the caller
    optics = frame.view.intrinsics
    scale = frame.width_px / optics.width_px
    matrix = np.array(
        [[optics.fx_px, 0.0, optics.cx_px], [0.0, optics.fy_px, optics.cy_px], [0.0, 0.0, 1.0]]
    )
    optical = np.ascontiguousarray(seen[:, [1, 2, 0]])
    zero = np.zeros(3)
    pixels, _ = cv2.projectPoints(optical, zero, zero, matrix, np.array(optics.distortion))
    flat = pixels.reshape(-1, 2)
    flat = flat[np.isfinite(flat).all(axis=1)]
    return shapely.multipoints((flat + 0.5) * scale).convex_hull


def _with_points_between(corners: Points) -> Points:
    """Return the corners; if some are behind the camera, with points on the lines between."""
    if len(corners) > _MOST_CORNERS or (corners[:, 0] > _NEAR_M).all():
        return corners
    shares = np.linspace(0.0, 1.0, _BETWEEN + 2)[:, None, None, None]
    first, second = corners[None, :, None, :], corners[None, None, :, :]
    return (first * (1.0 - shares) + second * shares).reshape(-1, 3)


def touched_part(detail: str) -> str:
    """Return the touched part in a detail: "gate.left" in "touched gate.left"; else empty."""
    _, is_touched, part = detail.partition("touched ")
    return part.split(";")[0].strip() if is_touched else ""


def objects_named_in_texts(scene: Scene, texts: Iterable[str]) -> list[str]:
    """Return the objects of a scene that are named in texts, alone or as "object.part"."""
    words = {word.strip(".,;:'\"()") for text in texts for word in text.split()}
    words |= {word.partition(".")[0] for word in words}
    return [name for name in scene.names if name in words]
