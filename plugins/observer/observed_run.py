"""A recorded run as its observer sees it: the world, and both vehicles at their judged poses.

What is solid in an image is real; what only the virtual world has, and the twin beside a real
vehicle, shines through.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wil_campaign.foundation.files.documents import BadInput, Data
from wil_campaign.orchestrator.reading.errors import ResultsFolderError
from wil_campaign.orchestrator.reading.judged_motion import read_judged_motion
from wil_campaign.orchestrator.recording.judge_log_file import FILE_NAME as JUDGED
from wil_campaign.orchestrator.recording.recording_facts import campaign_in, world_in
from wil_campaign.orchestrator.report.reading.recorded_sights import read_facts
from wil_campaign.orchestrator.report.reading.world_facts import recorded_body
from wil_campaign.plugins.observer.observer_part import FixedObserver, observer_in, pose_looking_at
from wil_campaign.plugins.run_images.drawing import REAL, TWIN, Rgb
from wil_campaign.vehicles.readings import BgrImage
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.render.renderer import Renderer
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.motion import ObjectMotion
from wil_campaign.worlds.scene.scene import MAX_OBJECTS, Scene, SceneObject
from wil_campaign.worlds.scene.track import ObjectTrack, RunHistory
from wil_campaign.worlds.world_file.world import Mode

RECORDING = "run.mcap"
_COLOURS: Mapping[str, Rgb] = {"real": REAL, "twin": TWIN}
_AT_REST = (0.0, 0.0, 0.0)
_GHOST = 0.55
"""How much of what is only virtual covers what is behind it."""
_LEAST_RADIUS_PX = 9.0
_DASHES = 12
_DEFAULT = (640, 480, 70.0, 10.0)
"""Width, height (pixels), field of view (degrees) and rate (Hz) without the key `observer`."""
_INSIDE_M = 0.3
"""How far from walls and ceiling the default observer stands."""


@dataclass(frozen=True, slots=True)
class ObservedRun:
    """What an observer sees of a run. observer: None where the campaign has none.

    scene: all objects of W and Wv, and the vehicles. solid: names of what is really there.
    history: times of events and poses of vehicles. span_s: of the judged poses, on the run clock.
    stages: when each was reached.
    """

    observer: FixedObserver | None
    scene: Scene
    solid: frozenset[str]
    history: RunHistory
    vehicles: Mapping[str, str]
    span_s: tuple[float, float]
    stages: Mapping[str, float]
    facts: Mapping[str, str]

    @property
    def default_observer(self) -> FixedObserver:
        """Return an observer behind the beginning of the flight that looks at its middle.

        It stands in the room where there is one.
        """
        width_px, height_px, fov_deg, rate_hz = _DEFAULT
        places = np.array(list(self._flown_places()))
        low, high = places.min(axis=0), places.max(axis=0)
        middle, size_m = (low + high) / 2.0, float(np.linalg.norm(high - low))
        away_m = max(3.0, 0.9 * size_m)
        along = places[-1] - places[0]
        along[2] = 0.0
        ahead = along / np.linalg.norm(along) if np.linalg.norm(along) > 0.5 else np.eye(3)[0]
        aside = np.array([-ahead[1], ahead[0], 0.0])
        place = middle + away_m * (0.75 * aside - 0.65 * ahead) - np.array([0.0, 0.0, 0.5 * away_m])
        place = self._within_rooms(place)
        n, e, d = (float(one) for one in place)
        a, b, c = (float(one) for one in middle)
        intrinsics = Intrinsics.from_fov(width_px, height_px, math.radians(fov_deg))
        return FixedObserver(pose_looking_at((n, e, d), (a, b, c)), intrinsics, rate_hz)

    def _flown_places(self) -> Iterator[Vec3]:
        begin_s, end_s = self.span_s
        subject = next(iter(self.vehicles.values()))
        for t_s in np.linspace(self.stages.get("goal", begin_s), self.stages.get("land", end_s)):
            pose = self.history.tracks[subject].pose_at(float(t_s))
            if pose is not None:
                yield pose.position_ned_m

    def _within_rooms(self, place: np.ndarray) -> np.ndarray:
        for room in (scene_object for scene_object in self.scene.objects if scene_object.is_room):
            n, e, d = (float(one) for one in place)
            corners = room.shape.mesh.vertices_m
            local = np.array(room.pose.to_local((n, e, d)))
            inside = np.clip(local, corners.min(0) + _INSIDE_M, corners.max(0) - _INSIDE_M)
            x, y, z = (float(one) for one in inside)
            place = np.array(room.pose.to_parent((x, y, z)))
        return place


def read_observed_run(folder: Path) -> ObservedRun:
    """Return what an observer sees of the run in a folder. Raises ResultsFolderError."""
    facts = read_facts(folder / RECORDING)
    if "world" not in facts:
        raise ResultsFolderError(
            f"{folder / RECORDING} has no world of a flight: give the folder of a recorded run"
        )
    motion = read_judged_motion(folder / JUDGED)
    if not motion.poses:
        why = "; ".join(motion.problems) or f"{folder / JUDGED} has no pose of a vehicle"
        raise ResultsFolderError(why)
    mode: Mode = next((one for one in get_args(Mode) if one == facts.get("mode")), "wil")
    try:
        world = world_in(facts)
        campaign = campaign_in(facts)
    except (BadInput, ValueError) as error:
        raise ResultsFolderError(f"{folder / RECORDING}: {error}") from error
    if world is None:
        raise ResultsFolderError(f"{folder / RECORDING} has no world of a flight")
    there, virtual = world.scene(mode, "W"), world.scene(mode, "Wv")
    objects = {
        scene_object.name: scene_object for scene_object in (*virtual.objects, *there.objects)
    }
    history, vehicles, bodies = _with_vehicles(motion.world_events, motion.poses, campaign, objects)
    scene = Scene((*sorted(objects.values(), key=lambda one: one.object_id), *bodies))
    solid = frozenset(scene.names)
    if mode == "wil":
        solid = frozenset(
            {*there.names, *(vehicles[vehicle] for vehicle in vehicles if vehicle != "twin")}
        )
    times = [t_s for poses in motion.poses.values() for t_s, _ in (poses[0], poses[-1])]
    return ObservedRun(
        observer=observer_in(campaign),
        scene=scene,
        solid=solid,
        history=history,
        vehicles=vehicles,
        span_s=(min(times), max(times)),
        stages=motion.stages,
        facts=facts,
    )


def _with_vehicles(
    events: RunHistory,
    poses: Mapping[str, Sequence[tuple[float, Pose]]],
    campaign: Mapping[str, Data],
    objects: Mapping[str, SceneObject],
) -> tuple[RunHistory, dict[str, str], list[SceneObject]]:
    """Return a run's history with its vehicles as flown objects, their names, and the objects.

    The real vehicle comes first. Where ids or names are used up, a vehicle is not drawn.
    """
    history = RunHistory(events.tracks)
    history.update(events)
    vehicles: dict[str, str] = {}
    bodies: list[SceneObject] = []
    last_id = max((scene_object.object_id for scene_object in objects.values()), default=0)
    for number, name in enumerate(sorted(poses, key=lambda one: one != "real"), start=1):
        shown = f"vehicle {name}"
        if last_id + number > MAX_OBJECTS:
            break
        _, half_m, _ = recorded_body(campaign, name).half_m
        colour = _COLOURS.get(name, REAL)
        shape = shapes.quadrotor_shape(2.0 * half_m, colour)
        shape = replace(shape, mesh=shape.mesh.painted(colour))
        at = poses[name][0][1]
        # Only what moves has a track.
        body = SceneObject(last_id + number, shown, shape, at, ObjectMotion(at, ()))
        track = history.tracks.setdefault(shown, ObjectTrack())
        for t_s, pose in poses[name]:
            track.add(t_s, pose, _AT_REST)
        vehicles[name] = shown
        bodies.append(body)
    return history, vehicles, bodies


class ObserverCamera:
    """Draws what an observer sees of a run."""

    def __init__(self, run: ObservedRun, observer: FixedObserver) -> None:
        self._run = run
        self._observer = observer
        self._renderer = Renderer(run.scene)
        ghosts = [
            scene_object.object_id
            for scene_object in run.scene.objects
            if scene_object.name not in run.solid
        ]
        self._is_ghost = np.isin(np.arange(256), ghosts)

    def draw(self, t_s: float, *, marked: bool = True) -> BgrImage:
        """Return the image (height, width, 3) at a time of the run clock.

        marked: with a dashed ring and the name at each vehicle.
        """
        observer, history = self._observer, self._run.history
        whole = self._renderer.render(
            observer.pose, observer.intrinsics, t_s, history, want_depth=False
        )
        image = whole.image_bgr
        if self._is_ghost.any() and whole.object_ids is not None:
            behind = self._renderer.render(
                observer.pose,
                observer.intrinsics,
                t_s,
                history,
                want_depth=False,
                want_ids=False,
                only=self._run.solid,
            ).image_bgr
            mixed = cv2.addWeighted(image, _GHOST, behind, 1.0 - _GHOST, 0.0)
            image = np.where(self._is_ghost[whole.object_ids][:, :, None], mixed, image)
        return self._marked(image, t_s) if marked else image

    def place_px(self, vehicle: str, t_s: float) -> tuple[float, float, float] | None:
        """Return column and row of a vehicle's middle, and its radius, pixels; None out of view."""
        pose = self._run.history.tracks[self._run.vehicles[vehicle]].pose_at(t_s)
        if pose is None:
            return None
        local_m = self._observer.pose.to_local(pose.position_ned_m)
        place = self._observer.intrinsics.project(local_m)
        if place is None:
            return None
        radius_m = self._run.scene[self._run.vehicles[vehicle]].shape.radius_m
        radius_px = self._observer.intrinsics.fx_px * radius_m / local_m[0]
        return (*place, max(_LEAST_RADIUS_PX, 1.25 * radius_px))

    def _marked(self, image: BgrImage, t_s: float) -> BgrImage:
        """Return an image with a dashed ring and the name at each vehicle."""
        sheet = Image.fromarray(np.ascontiguousarray(image[:, :, ::-1]))
        pen = ImageDraw.Draw(sheet)
        size = max(11, image.shape[1] // 45)
        font = ImageFont.load_default(size)
        # The twin's ring is under the real vehicle's, and its name below, not above.
        for vehicle in reversed(list(self._run.vehicles)):
            found = self.place_px(vehicle, t_s)
            if found is None:
                continue
            x, y, radius = found
            colour = _COLOURS.get(vehicle, REAL)
            offset = 180.0 / _DASHES if vehicle == "twin" else 0.0
            box = (x - radius, y - radius, x + radius, y + radius)
            for number in range(_DASHES):
                begin = offset + 360.0 / _DASHES * number
                pen.arc(box, begin, begin + 180.0 / _DASHES, colour, 2)
            below = vehicle == "twin" and "real" in self._run.vehicles
            at = (x, y + radius + 2 if below else y - radius - 2)
            anchor = "ma" if below else "md"
            pen.text(at, vehicle, colour, font, anchor, stroke_width=2, stroke_fill="white")
        return np.ascontiguousarray(np.asarray(sheet)[:, :, ::-1])
