"""What a flown run's sensors had in view, computed from its judge log and its world's geometry.

Rays are cast from the poses by which the run was judged, five times a second while the goal was
flown: without the sensor's noise, and the same whether an image was rendered or is live.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from wil_campaign.campaigns.expansion.expansion import RunPlan
from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    OtherSensorSetup,
    SensorSetup,
)
from wil_campaign.foundation.files.paths import open_at_once
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME
from wil_campaign.orchestrator.state.run_setup import RunOrder, RunSetup
from wil_campaign.plugins.search.exploration.sensed import (
    SECTORS,
    Cell,
    SensedView,
    sensed_level_of,
)
from wil_campaign.safety.evaluation.judge_log import (
    ActorPose,
    JudgeLogError,
    LoggedWorldEvent,
    read_judge_log,
)
from wil_campaign.safety.model.samples import PoseSample, StageSample
from wil_campaign.vehicles.sensors.beams import BeamFan, Directions, RayHits
from wil_campaign.vehicles.sensors.sensor_spec import SensorOptions
from wil_campaign.vehicles.sensors.world_views import WorldRays
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.scene.track import RunHistory

_PERIOD_S = 0.2
_COLUMNS, _ROWS = 48, 12
"""Rays of an image: enough across and up to tell sectors and shares."""
_BESIDE_M = 0.5
"""Ranging sensors: only what is within this height of the vehicle counts; the floor does not."""
_AFTER_GOAL = frozenset({"land", "landed", "end"})


@dataclass(frozen=True, slots=True, kw_only=True)
class _SensorRays:
    """A sensor's rays. directions: (rays, 3) unit vectors; sectors: (rays,) the sector of each.

    pose: of the sensor, from that of the body. finds_objects: whether views are counted per object.
    """

    sensor: str
    directions: Directions
    sectors: NDArray[np.int64]
    pose: Callable[[Pose], Pose]
    finds_objects: bool


@dataclass(slots=True)
class _Views:
    """What one sensor had in view so far: the nearest surface, or one object."""

    cells: set[Cell] = field(default_factory=set)
    reduced: set[str] = field(default_factory=set)
    nearest_m: float = math.inf
    largest_share: float = 0.0


def sensed_views(plan: RunPlan, folder: Path) -> tuple[SensedView, ...]:
    """Return what a flown run's sensors had in view; empty if its judge log is unreadable.

    folder: of the run.
    """
    setup = RunSetup.of(RunOrder(plan=plan, folder=folder, clock="virtual"))
    events = RunHistory()
    eyes = [
        one for each in setup.vehicle(setup.subject).sensors if (one := _rays_of(each)) is not None
    ]
    scene = _visible_scene(setup)
    names = {
        scene_object.object_id: scene_object.name
        for scene_object in scene.objects
        if not scene_object.is_room
    }
    views_of = {(eye.sensor, name): _Views() for eye in eyes for name in _counted(eye, names)}
    rays = WorldRays(scene=scene, events=events)
    try:
        with open_at_once(folder / FILE_NAME) as stream:
            for sample in _goal_poses(stream, setup.subject, events):
                for eye in eyes:
                    pose = eye.pose(sample.pose)
                    hits = rays(pose, eye.directions, sample.t_s)
                    if eye.finds_objects:
                        _record_objects(eye, names, views_of, hits)
                    else:
                        _record_nearest(eye, pose, views_of[eye.sensor, ""], hits)
    except (OSError, JudgeLogError):
        return ()
    return tuple(
        SensedView(
            sensor=sensor,
            object=name,
            sectors=SECTORS,
            cells=tuple(sorted(views.cells)),
            reduced=tuple(sorted(views.reduced)),
            nearest_m=None if math.isinf(views.nearest_m) else round(views.nearest_m, 3),
            largest_share=round(views.largest_share, 4),
        )
        for (sensor, name), views in views_of.items()
    )


def _counted(eye: _SensorRays, names: Mapping[int, str]) -> tuple[str, ...]:
    """Return the names of the objects that are counted for a sensor; "" is the nearest surface."""
    return tuple(names.values()) if eye.finds_objects else ("",)


def _visible_scene(setup: RunSetup) -> Scene:
    """Return the objects that the subject's sensors may show in the run's mode."""
    if setup.mode != "wil":
        return setup.judged_scene
    virtual = setup.virtual_scene
    physical = tuple(
        scene_object
        for scene_object in setup.real_scene.objects
        if scene_object.name not in virtual
    )
    return Scene((*virtual.objects, *physical))


def _goal_poses(stream: BinaryIO, subject: str, events: RunHistory) -> Iterator[PoseSample]:
    """Yield the subject's poses while the goal was flown; update the history up to each."""
    due_s = math.inf
    for sample in read_judge_log(stream):
        match sample:
            case LoggedWorldEvent(t_s, name):
                events[name] = t_s
            case ActorPose(t_s, name, pose, velocity):
                events.add_pose(name, t_s, pose, velocity)
            case StageSample(t_s, stage):
                if stage == "goal":
                    due_s = min(due_s, t_s)
                elif stage in _AFTER_GOAL:
                    return
            case PoseSample(t_s, vehicle):
                if vehicle == subject and t_s >= due_s:
                    due_s = max(due_s + _PERIOD_S, t_s)
                    yield sample


def _record_nearest(eye: _SensorRays, pose: Pose, views: _Views, hits: RayHits) -> None:
    """Record the distance of the nearest surface at the vehicle's height in each sector."""
    ranges_m = hits.ranges_m.astype(float)
    is_hit = np.isfinite(ranges_m)
    down = eye.directions @ matrix_from_quat(pose.q_wxyz)[2]
    beside = np.zeros(len(ranges_m), bool)
    beside[is_hit] = np.abs(down[is_hit] * ranges_m[is_hit]) <= _BESIDE_M
    nearest = np.full(SECTORS, np.inf)
    np.minimum.at(nearest, eye.sectors[beside], ranges_m[beside])
    levels = [sensed_level_of(one) for one in nearest.tolist()]
    views.reduced.add("".join(map(str, levels)))
    views.cells.update(enumerate(levels))
    views.nearest_m = min(views.nearest_m, float(nearest.min()))


def _record_objects(
    eye: _SensorRays,
    names: Mapping[int, str],
    views_of: Mapping[tuple[str, str], _Views],
    hits: RayHits,
) -> None:
    """Record the sector, distance and share of the image of each visible object."""
    for number in np.unique(hits.object_ids).tolist():
        if number not in names:
            continue
        hit, views = hits.object_ids == number, views_of[eye.sensor, names[number]]
        nearest_m = float(hits.ranges_m[hit].min())
        views.cells.add((round(float(eye.sectors[hit].mean())), sensed_level_of(nearest_m)))
        views.nearest_m = min(views.nearest_m, nearest_m)
        views.largest_share = max(views.largest_share, float(hit.mean()))


def _rays_of(sensor: SensorSetup) -> _SensorRays | None:
    """Return a sensor's rays; None for a sensor that has no view."""
    match sensor:
        case CameraSetup():
            directions, columns = _image_rays(sensor.intrinsics)
            return _SensorRays(
                sensor=sensor.name,
                directions=directions,
                sectors=columns,
                pose=sensor.mount.camera_pose,
                finds_objects=True,
            )
        case DepthSetup():
            directions, columns = _image_rays(sensor.intrinsics)
            return _ranging_rays(sensor.name, directions, columns, sensor.mount.camera_pose)
        case OtherSensorSetup(options=SensorOptions(fan=BeamFan() as fan), mount=mount):
            sectors = fan.columns * SECTORS // fan.count
            return _ranging_rays(
                sensor.name, fan.directions, sectors, lambda body: body.compose(mount)
            )
    return None


def _ranging_rays(
    name: str,
    directions: Directions,
    sectors: NDArray[np.int64],
    pose: Callable[[Pose], Pose],
) -> _SensorRays:
    return _SensorRays(
        sensor=name, directions=directions, sectors=sectors, pose=pose, finds_objects=False
    )


def _image_rays(lens: Intrinsics) -> tuple[Directions, NDArray[np.int64]]:
    """Return rays through a grid of pixels, without lens distortion, and the sector of each."""
    u, v = np.meshgrid(
        (np.arange(_COLUMNS) + 0.5) * lens.width_px / _COLUMNS,
        (np.arange(_ROWS) + 0.5) * lens.height_px / _ROWS,
    )
    right, down = (u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px
    rays = np.stack([np.ones_like(right), right, down], axis=-1).reshape(-1, 3)
    columns = np.tile(np.arange(_COLUMNS) * SECTORS // _COLUMNS, _ROWS)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True), columns
