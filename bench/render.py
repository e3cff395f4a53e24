"""Images and distances of one scene, compared with an Embree ray cast of it, on one core.

    python bench/render.py [--frames N] [--pictures FOLDER]

An image is 1280x720 with colour, depth and object ids, of about 20,000 triangles. The ray cast
gives the same depth and ids (no colour) by one ray per pixel; its rays are ready beforehand.
Clearance is that of a vehicle of 0.3 m that is flown through the scene in steps of 20 ms.
"""

import argparse
import math
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.clearance.clearance import BoxShape, ClearanceProbe
from wil_campaign.worlds.frames import Pose, matrix_from_quat
from wil_campaign.worlds.rays.raycast import SceneRayCaster
from wil_campaign.worlds.render.renderer import Renderer, RenderOutput
from wil_campaign.worlds.scene import meshes, shapes
from wil_campaign.worlds.scene.meshes import FloatArray, Material, Mesh
from wil_campaign.worlds.scene.parts import SolidPart, SurfaceShape
from wil_campaign.worlds.scene.scene import Scene, SceneObject
from wil_campaign.worlds.scene.shapes import Shape

CAMERA = Intrinsics.from_fov(1280, 720, math.radians(69.0))
WANTED_MS = 12.0
BODY = BoxShape((0.15, 0.15, 0.05))
STEP_S = 0.02


def hills(side: int = 42) -> Mesh:
    """Return smooth ground of 2 side^2 triangles, such as a scan gives, 6 m wide."""
    at = np.linspace(-3.0, 3.0, side + 1)
    north, east = np.meshgrid(at, at, indexing="ij")
    down = 0.12 * np.sin(2.1 * north) * np.cos(1.7 * east) - 0.13
    index = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, c, b], -1), np.stack([a, d, c], -1)])
    corners = np.stack([north, east, down], axis=-1).reshape(-1, 3)
    return meshes.mesh_from_triangles(corners, faces, Material((110, 120, 90)))


def as_shape(mesh: Mesh) -> Shape:
    """Return a mesh as a thing whose surface can be touched, as mesh files are."""
    surface = SurfaceShape(mesh.vertices_m, mesh.faces)
    return Shape("mesh", mesh, (SolidPart("surface", surface, Pose((0.0, 0.0, 0.0))),))


def cage() -> Scene:
    """Return a flight cage with about 20,000 triangles of the built-in things and a mesh."""
    things = [
        (shapes.room_shape(6, 6, 2.5), Pose.of(2, 0, 0)),
        (shapes.gate_shape("square", 1.0, 0.1), Pose.of(3, 0, 1.2)),
        (shapes.gate_shape("ring", 0.8, 0.06, (200, 40, 40)), Pose.of(4, 1.2, 1.4, yaw_rad=0.5)),
        (as_shape(hills()), Pose.of(2, 0, 0)),
    ]
    things += [
        (shapes.person_shape(), Pose.of(3.2 + 0.4 * k, -2.2 + 0.9 * k, 0, yaw_rad=2.0 + k))
        for k in range(5)
    ]
    things += [
        (shapes.quadrotor_shape(0.4), Pose.of(2.2 + 0.5 * k, 1.2 - 0.6 * k, 1.7, roll_rad=0.1 * k))
        for k in range(5)
    ]
    named = enumerate(things, start=1)
    return Scene(tuple(SceneObject(k, f"thing {k}", *thing) for k, thing in named))


def flight(steps: int) -> list[Pose]:
    """Return a flight through the gate, the vehicle rolling and turning a little."""
    return [
        Pose.of(
            -0.6 + 3.4 * s,
            0.25 * math.sin(5.0 * s),
            1.2 + 0.1 * math.sin(3.0 * s),
            roll_rad=0.1 * math.sin(9.0 * s),
            pitch_rad=-0.08,
            yaw_rad=0.3 * math.sin(4.0 * s),
        )
        for s in np.linspace(0.0, 1.0, steps).tolist()
    ]


def rays(pose: Pose) -> FloatArray:
    """Return one unit vector per pixel, in the world."""
    columns, rows = np.meshgrid(np.arange(CAMERA.width_px), np.arange(CAMERA.height_px))
    across = (columns - CAMERA.cx_px) / CAMERA.fx_px
    down = (rows - CAMERA.cy_px) / CAMERA.fy_px
    frd = np.stack([np.ones_like(across), across, down], axis=-1).reshape(-1, 3)
    frd /= np.linalg.norm(frd, axis=1, keepdims=True)
    return np.ascontiguousarray(frd @ matrix_from_quat(pose.q_wxyz).T)


def embree(scene: Scene) -> Callable[[Pose, np.ndarray], dict[str, np.ndarray]]:
    """Return Embree's bare call (first hits in single precision) on a scene at rest."""
    from embreex.mesh_construction import TriangleMesh  # noqa: PLC0415 (a test dependency here)
    from embreex.rtcore_scene import EmbreeScene  # noqa: PLC0415

    tree = EmbreeScene()
    kept = []
    for thing in scene.objects:
        mesh = thing.shape.mesh.moved(thing.pose)
        kept.append(TriangleMesh(tree, mesh.vertices_m[mesh.faces].astype(np.float32)))

    def cast(pose: Pose, directions: np.ndarray) -> dict[str, np.ndarray]:
        origins = np.broadcast_to(np.float32(pose.position_ned_m), directions.shape)
        found = tree.run(np.ascontiguousarray(origins), directions, output=True)
        found["keeps"] = kept
        return dict(found)

    return cast


def timed_ms(work: Callable[[], object]) -> tuple[float, float]:
    """Return how long one call takes: by the clock, and of the processor (under load less)."""
    start, busy = time.perf_counter(), time.thread_time()
    work()
    return (time.perf_counter() - start) * 1e3, (time.thread_time() - busy) * 1e3


def compare_images(scene: Scene, frames: int) -> list[RenderOutput]:
    """Print the times of rendering and of casting, frame by frame in turns."""
    renderer, cast = Renderer(scene), embree(scene)
    way = flight(frames)
    images = [renderer.render(way[0], CAMERA, 0.0)]
    rendered, casts = [], []
    for k, pose in enumerate(way):
        rendered.append(timed_ms(lambda at=pose: images.append(renderer.render(at, CAMERA, 0.0))))
        if k % 5 == 0:
            directions = rays(pose).astype(np.float32)
            casts.append(timed_ms(lambda at=pose, to=directions: cast(at, to)))
    triangles = sum(len(thing.shape.mesh.faces) for thing in scene.objects)
    ours, theirs = np.array(rendered), np.array(casts)
    print(f"1280x720, {triangles} triangles, colour + depth + ids; load {os.getloadavg()[0]:.1f}")
    for name, taken in (("renderer", ours), ("Embree, one ray per pixel, depth + ids", theirs)):
        clock, busy = np.median(taken, axis=0)
        print(f"  {name}: p50 {clock:.2f} ms by the clock, {busy:.2f} ms of the processor")
    clock, busy = np.median(ours, axis=0) / np.median(theirs, axis=0)
    print(f"  ratio to Embree: {clock:.3f} by the clock, {busy:.3f} of the processor")
    clock, busy = np.median(ours, axis=0) / WANTED_MS
    print(f"  ratio to the wanted {WANTED_MS:.0f} ms: {clock:.2f}, {busy:.2f}  (at most 1)")
    check(scene, way[len(way) // 2], renderer)
    return images


def check(scene: Scene, pose: Pose, renderer: Renderer) -> None:
    """Print how far rendered ids and depths agree with rays, so that nothing fast is wrong."""
    picture, directions = renderer.render(pose, CAMERA, 0.0), rays(pose)
    hits = SceneRayCaster(scene).cast(pose.position_ned_m, directions, 0.0)
    ids = hits.object_ids.reshape(CAMERA.height_px, CAMERA.width_px)
    forward = directions @ matrix_from_quat(pose.q_wxyz)[:, 0]
    depth = (hits.ranges_m * forward).reshape(ids.shape)
    same = picture.object_ids == ids
    gap_mm = np.abs(picture.depth_m - depth)[same & (ids > 0)] * 1e3
    print(
        f"  same id as the ray's: {same.mean():.4%} of pixels;"
        f" depth differs by {np.median(gap_mm):.4f} mm (p99 {np.percentile(gap_mm, 99):.3f} mm)"
    )


def sweep(probe: ClearanceProbe, known: dict[tuple[str, bool], float], *at: Any) -> None:
    """Measure a stretch as a run does: only what comes closer than ever before."""
    closer = probe.sweep(*at, below_m=known)
    known.update((each.key, each.clearance_m) for each in closer)


def compare_clearance(scene: Scene, seconds: float) -> None:
    """Print what a step of clearance costs, and how much of real time that is."""
    way = flight(round(seconds / STEP_S))
    mesh = "thing 4"
    for title, probe in (
        ("built-in things", ClearanceProbe(scene, BODY, exclude={mesh})),
        ("and 3,528 triangles of a mesh", ClearanceProbe(scene, BODY)),
    ):
        taken: list[tuple[float, float]] = []
        known: dict[tuple[str, bool], float] = {}
        for k in range(len(way) - 1):
            at = (way[k], k * STEP_S, way[k + 1], (k + 1) * STEP_S)
            taken.append(timed_ms(partial(sweep, probe, known, *at)))
        clock, busy = np.mean(taken[1:], axis=0)
        print(
            f"clearance, {title}: mean {clock * 1e3:.0f} us by the clock for a step of 20 ms,"
            f" {busy * 1e3:.0f} us of the processor ({busy / STEP_S / 1e3:.2%} of real time)"
        )


def main() -> None:
    """Compare, and write some of the images to a folder if one is given."""
    parser = argparse.ArgumentParser(description="rendering beside ray casting, on one core")
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--pictures", type=Path)
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    scene = cage()
    images = compare_images(scene, arguments.frames)
    compare_clearance(scene, 20.0)
    if arguments.pictures:
        arguments.pictures.mkdir(parents=True, exist_ok=True)
        for k in range(0, len(images), max(1, len(images) // 5)):
            cv2.imwrite(str(arguments.pictures / f"frame{k:03d}.png"), images[k].image_bgr)


if __name__ == "__main__":
    main()
