"""From the end of a camera's exposure to the delivery of the mixture, in wall time.

    taskset -c 0,1 python bench/latency.py [--seconds N] [--size WxH] [--hz N] [--rtp]

On a machine with other work to do, `chrt -f 20` before it keeps that work out of the figures.

A thread stands for a live camera: at the end of each exposure it hands over an image of a pool.
Another stands for motion capture at 200 Hz. In between lies what a flight has: the wait for a pose
of the moment, the twin's image drawn from it in a thread, the gate recipe, delivery in the
process (and as RTP, if requested). The pool's images are ready: what a camera needs to hand over
its image is the camera's own.
"""

import argparse
import asyncio
import math
import os
import threading
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import cv2
import numpy as np
from mixing import POOL, RECIPE, wall
from render import cage

from wil_campaign.foundation.files.documents import load_document
from wil_campaign.foundation.tasks import start_task, stop_tasks
from wil_campaign.orchestrator.run.perception.mixing_loop import MixingLoop
from wil_campaign.orchestrator.run.perception.sensor_factory import run_sensor_in_thread
from wil_campaign.orchestrator.state.mixtures import MixedFrame
from wil_campaign.plugins.outlets.image_delivery import ImageDelivery
from wil_campaign.plugins.outlets.rtp import rtp_delivery
from wil_campaign.plugins.outlets.sdp import RtpAddress
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import compile_recipe
from wil_campaign.vehicles.cameras.rendered_cameras import OnDemandCamera
from wil_campaign.vehicles.poses.pose_history import PoseHistory
from wil_campaign.vehicles.readings import CameraReading
from wil_campaign.vehicles.sensors.lens import ThroughLens
from wil_campaign.vehicles.sensors.world_views import WorldImages
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose
from wil_campaign.worlds.scene.scene import Scene
from wil_campaign.worlds.world_file.world import World

WORLD = Path(__file__).parents[1] / "worlds" / "gate.yaml"
POSE_HZ = 200.0
POSE_WAIT_S = 0.05
WARM_UP_S = 2.0
WANTED_P99_MS, WANTED_DROPS = 25.0, 0.001


def body(t_s: float) -> Pose:
    """Return where the vehicle is: it sways sideways before the gate at up to 1 m/s."""
    east_m = 0.5 * math.sin(2.0 * t_s)
    return Pose.of(0.0, east_m, 1.2, yaw_rad=0.1 * math.sin(t_s), roll_rad=0.05 * math.cos(t_s))


class Ticker:
    """A thread that calls something in the loop at a rate, on time."""

    def __init__(self, rate_hz: float, tick: Callable[[int, float], None]) -> None:
        self._period_s = 1.0 / rate_hz
        self._tick = tick
        self._stop = threading.Event()
        self._loop = asyncio.get_running_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        start_s = self._loop.time()
        k = 0
        while not self._stop.is_set():
            at_s = start_s + k * self._period_s
            time.sleep(max(0.0, at_s - self._loop.time()))
            # What is stamped is when it was due: a thread that oversleeps is late, as cameras are.
            self._loop.call_soon_threadsafe(self._tick, k, at_s)
            k += 1


class Rig:
    """One scene at one size and rate."""

    def __init__(self, scene: Scene, size: tuple[int, int], delivery: ImageDelivery | None) -> None:
        self.taken_ms: list[float] = []
        self.offered = 0
        self._delivery = delivery
        self._poses = PoseHistory(2.0)
        lens = Intrinsics.from_fov(*size, math.radians(69.0))
        self._images = [wall(seed, *size) for seed in range(POOL)]
        self._lens = lens
        (mixer,) = compile_recipe(load_recipe(load_document(RECIPE)), object_ids={})
        images = WorldImages(scene=scene, events={"goal": 0.0})
        self.mixing = MixingLoop(
            name="camera",
            mixer=mixer,
            twin=OnDemandCamera(
                source=ThroughLens(images),
                intrinsics=lens,
                mount=CameraMount(),
                compute=run_sensor_in_thread,
            ),
            poses=self._poses,
            wait_s=POSE_WAIT_S,
            period_s=1.0 / 60.0,
            rate_hz=None,
            registration=None,
            on_mixture=self._report_mixture,
            on_fault=print,
        )

    def pose(self, _: int, t_s: float) -> None:
        """Take a pose of motion capture."""
        self._poses.add(t_s, body(t_s), (0.0, 0.0, 0.0))

    def exposed(self, k: int, t_s: float) -> None:
        """Take an image of the camera."""
        self.offered += 1
        now_s = asyncio.get_running_loop().time()
        image = self._images[k % POOL]
        self.mixing.real_reading(CameraReading(t_s, now_s, k, "real", image, self._lens))

    def forget(self) -> None:
        """Begin to count."""
        self.taken_ms.clear()
        self.offered = 0

    def _report_mixture(self, frame: MixedFrame) -> None:
        reading = frame.mixed.reading
        if not isinstance(reading, CameraReading) or frame.real is None:
            return
        if self._delivery is not None:
            self._delivery.deliver(reading)
        self.taken_ms.append(1e3 * (asyncio.get_running_loop().time() - frame.real.t_s))


async def measure(bench: Rig, hz: float, seconds: float) -> None:
    """Run the bench."""
    mixing = start_task(bench.mixing.run(), name="mixing")
    poses, camera = Ticker(POSE_HZ, bench.pose), Ticker(hz, bench.exposed)
    await asyncio.sleep(WARM_UP_S)
    bench.forget()
    await asyncio.sleep(seconds)
    for ticker in (camera, poses):
        await asyncio.to_thread(ticker.stop)
    await asyncio.sleep(0.2)
    await stop_tasks(mixing)


async def run(name: str, scene: Scene, arguments: argparse.Namespace) -> None:
    """Measure one scene and print its figures."""
    width, _, height = arguments.size.partition("x")
    size = (int(width), int(height))
    async with AsyncExitStack() as stack:
        delivery = None
        if arguments.rtp:
            delivery = await stack.enter_async_context(
                rtp_delivery(
                    width_px=size[0],
                    height_px=size[1],
                    rate_hz=arguments.hz,
                    address=RtpAddress("127.0.0.1", 5600),
                )
            )
        bench = Rig(scene, size, delivery)
        await measure(bench, arguments.hz, arguments.seconds)
    taken = np.array(bench.taken_ms)
    lost = max(0, bench.offered - len(taken)) / bench.offered
    p50, p99, worst = np.percentile(taken, (50, 99, 100))
    print(
        f"{name}, {arguments.size} at {arguments.hz:g} Hz: p50 {p50:.1f} ms, p99 {p99:.1f} ms, "
        f"worst {worst:.1f} ms, dropped {lost:.2%} of {bench.offered}"
    )
    print(f"  ratio of p99 to {WANTED_P99_MS:g} ms: {p99 / WANTED_P99_MS:.2f} (wanted: below 1)")
    print(f"  dropped: {lost:.3%} (wanted: below {WANTED_DROPS:.1%})")
    if delivery is not None:
        print(f"  RTP: {delivery.counts}")


def main() -> None:
    """Measure the gate's world and one of 20,000 triangles."""
    parser = argparse.ArgumentParser(description="exposure end to delivery, wall clock")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--size", default="1280x720")
    parser.add_argument("--hz", type=float, default=60.0)
    parser.add_argument("--rtp", action="store_true")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"load before: {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} cores")
    world = World.parse(load_document(WORLD))
    for name, scene in (("gate world", world.scene("wil", "Wv")), ("20,000 triangles", cage())):
        asyncio.run(run(name, scene, arguments))


if __name__ == "__main__":
    main()
