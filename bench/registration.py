"""How far from its place a virtual gate is drawn while the vehicle flies past it.

    python bench/registration.py [--seconds S]

1 m/s sideways, a gate 3 m ahead, images of 640x480 at 69 degrees and 30 Hz that arrive 100 ms
after their exposure, motion capture at 100 Hz with 1 mm of noise on each axis that arrives after
5 ms. The mixing loop of a flight runs in virtual time; a recipe that interpolates the pose stands
beside one that takes the latest. Error: RMS over the corners of the box round the gate, in pixels,
as in a flight's results; and, as a check of that figure, how far the gate's orange has moved
between the image as drawn and as drawn from where the camera truly was.
"""

import argparse
import asyncio
import math
from dataclasses import dataclass, field

import numpy as np

from wil_campaign.foundation.clocks.sleeping import sleep_until
from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop, RegistrationError
from wil_campaign.orchestrator.run.perception.registration_error import (
    box_corners,
    registration_error_px,
    seen_points,
)
from wil_campaign.orchestrator.state.mixtures import MixedFrame
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import compile_recipe
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import CameraReading, Reading
from wil_campaign.vehicles.sensors.world_views import WorldImages
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose, Vec3
from wil_campaign.worlds.scene import shapes
from wil_campaign.worlds.scene.scene import Scene, SceneObject

CAMERA = Intrinsics.from_fov(640, 480, math.radians(69.0))
SPEED_M_S = 1.0
AHEAD_M = 3.0
UP_M = 1.2
IMAGES_HZ, IMAGE_LATENCY_S = 30.0, 0.1
CAPTURE_HZ, CAPTURE_LATENCY_S, CAPTURE_NOISE_M = 100.0, 0.005, 0.001
WAIT_S = 0.05
WANTED_PX = 1.0
RECIPE = """\
schema: wil/recipe/1
sensors: {{camera: {{type: camera}}}}
combine:
  - sensor: camera
    transform: [{{register: {{pose: real, align: {align}, max_gap_ms: 200}}}}]
    filter: [{{isolate_color: orange}}]
    merge: overlay
    max_skew_ms: 200
"""


def truth(t_s: float) -> Pose:
    """Return where the camera truly is: it passes the gate to and fro, 0.8 m to each side."""
    way_m = (SPEED_M_S * t_s) % 3.2
    east_m = way_m - 0.8 if way_m < 1.6 else 2.4 - way_m
    return Pose.of(0.0, east_m, UP_M)


@dataclass(slots=True)
class Twin:
    """A simulator that is asked for images and answers at once."""

    images: WorldImages

    async def ask(
        self, body: Pose, t_s: float, *, want_depth: bool = False, want_ids: bool = False
    ) -> Reading:
        """Return the image from a pose."""
        del want_depth, want_ids
        image = self.images.picture(body, CAMERA, t_s).image_bgr
        return CameraReading(t_s, t_s, 0, "twin", image, CAMERA, camera_pose=body)


@dataclass(slots=True)
class Seen:
    """What was measured: errors in pixels of each mixture."""

    errors_px: list[float] = field(default_factory=list)
    moved_px: list[float] = field(default_factory=list)
    dropped: int = 0


def orange_at(image: np.ndarray) -> Vec3 | None:
    """Return the middle of the orange pixels (column, row, count); None for none."""
    blue, _, red = (image[:, :, k].astype(np.int16) for k in range(3))
    rows, columns = np.nonzero(red - blue > 60)
    return (columns.mean(), rows.mean(), len(rows)) if len(rows) else None


def fly(align: str, seconds: float) -> Seen:
    """Return what comes of a flight past the gate."""
    shape = shapes.gate_shape("square", 1.0, 0.1)
    gate = SceneObject(1, "gate", shape, pose=Pose.of(AHEAD_M, 0.0, UP_M))
    images = WorldImages(scene=Scene((gate,)), events={})
    corners = [gate.pose.to_parent(corner) for corner in box_corners(gate)]
    seen = Seen()

    def registration(twin: Reading, exposed_s: float) -> RegistrationError:
        if not isinstance(twin, CameraReading) or twin.camera_pose is None:
            return RegistrationError()
        points = seen_points(
            zip(corners, corners, strict=True),
            intrinsics=CAMERA,
            drawn_from=twin.camera_pose,
            reference=truth(exposed_s),
        )
        return RegistrationError(registration_error_px(points))

    def tell(frame: MixedFrame) -> None:
        error_px = frame.mixed.provenance.registration_error_px
        if error_px is None or frame.real is None or not isinstance(frame.twin, CameraReading):
            seen.dropped += 1
            return
        seen.errors_px.append(error_px)
        right = images.picture(truth(frame.real.t_s), CAMERA, frame.real.t_s).image_bgr
        a, b = orange_at(frame.twin.image_bgr), orange_at(right)
        if a is not None and b is not None:
            seen.moved_px.append(math.hypot(a[0] - b[0], a[1] - b[1]))

    recipe = load_recipe(parse_document(RECIPE.format(align=align).encode(), name="bench.yaml"))
    (mixer,) = compile_recipe(recipe, object_ids={})
    poses = PoseHistory(2.0)
    loop = MixingLoop(
        name="camera",
        mixer=mixer,
        twin=Twin(images),
        poses=poses,
        wait_s=WAIT_S,
        period_s=1.0 / IMAGES_HZ,
        rate_hz=None,
        registration=registration,
        on_mixture=tell,
        on_fault=print,
    )

    run_virtual(_flight(loop, poses, seconds))
    return seen


async def _flight(loop: MixingLoop, poses: PoseHistory, seconds: float) -> None:
    async with asyncio.TaskGroup() as group:
        tasks = [
            group.create_task(_capture(poses), name="motion capture"),
            group.create_task(_camera(loop), name="camera"),
            group.create_task(loop.run(), name="mixing"),
        ]
        await sleep_until(seconds)
        for task in tasks:
            task.cancel()


async def _capture(poses: PoseHistory) -> None:
    rng = np.random.default_rng(1)
    tick = 0
    while True:
        t_s = tick / CAPTURE_HZ
        await sleep_until(t_s + CAPTURE_LATENCY_S)
        pose = truth(t_s)
        noise = rng.normal(0.0, CAPTURE_NOISE_M, 3)
        north, east, down = (float(a + b) for a, b in zip(pose.position_ned_m, noise, strict=True))
        poses.add(t_s, Pose((north, east, down), pose.q_wxyz))
        tick += 1


async def _camera(loop: MixingLoop) -> None:
    empty = np.full((CAMERA.height_px, CAMERA.width_px, 3), 128, np.uint8)
    tick = 0
    while True:
        # Between two samples of motion capture, at a place that differs from image to image.
        t_s = 0.2337 + tick / IMAGES_HZ
        await sleep_until(t_s + IMAGE_LATENCY_S)
        loop.real_reading(CameraReading(t_s, t_s + IMAGE_LATENCY_S, tick, "real", empty, CAMERA))
        tick += 1


def main() -> None:
    """Measure both ways to align, and print them."""
    parser = argparse.ArgumentParser(description="registration error in pixels")
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    for align in ("interpolate", "latest"):
        seen = fly(align, seconds)
        p50, p99 = np.percentile(seen.errors_px, (50, 99))
        print(
            f"{align}: median {p50:.2f} px, p99 {p99:.2f} px in {len(seen.errors_px)} mixtures"
            f" ({seen.dropped} without); measured in the images: median"
            f" {np.median(seen.moved_px):.2f} px"
        )
        if align == "interpolate":
            print(f"  ratio to the wanted {WANTED_PX:g} px: {p50 / WANTED_PX:.2f}")


if __name__ == "__main__":
    main()
