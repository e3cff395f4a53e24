"""The gate recipe beside the bare OpenCV calls that it cannot do without, on one core.

    python bench/mixing.py [--frames N]

Frames are ready and both images are of one size. The bare calls work on buffers made before:
a copy of the real image, cvtColor to HSV, inRange, copyTo.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from wil_campaign.foundation.files.documents import load_document
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.vehicles.readings import BgrImage, CameraReading, Source
from wil_campaign.worlds.camera import Intrinsics

RECIPE = Path(__file__).parents[1] / "recipes" / "gate.yaml"
SIZES = ((640, 480), (1280, 720), (1920, 1080))
WANTED_PER_S = {(1280, 720): 400, (1920, 1080): 150}
WANTED_P99_MS = {(1280, 720): 5.0}
POOL = 4
"""Several pairs in turn, so that no image is mixed out of the cache by courtesy."""


def wall(seed: int, width_px: int, height_px: int) -> BgrImage:
    """Return a grey wall with stains and noise."""
    rng = np.random.default_rng(seed)
    stains = cv2.resize(rng.normal(140, 25, (9, 16)), (width_px, height_px))
    noise = rng.normal(0, 4, (height_px, width_px, 3))
    return np.clip(stains[:, :, None] + noise, 0, 255).astype(np.uint8)


def with_gate(image: BgrImage) -> BgrImage:
    """Return the image with an orange frame, as large as a 1 m gate 2 m ahead."""
    height_px, width_px = image.shape[:2]
    half, bar = int(0.36 * height_px), int(0.075 * height_px)
    x, y = width_px // 2, height_px // 2
    made = image.copy()
    cv2.rectangle(made, (x - half, y - half), (x + half, y + half), (0, 105, 220), bar)
    return made


def duration_ms(work: Callable[[int], None], frames: int) -> np.ndarray:
    """Return how long each frame took."""
    for frame in range(20):
        work(frame)
    taken = np.empty(frames)
    for frame in range(frames):
        start = time.perf_counter()
        work(frame)
        taken[frame] = (time.perf_counter() - start) * 1e3
    return taken


def bare(real: list[BgrImage], twin: list[BgrImage]) -> Callable[[int], None]:
    """Return the bare calls, on buffers made here."""
    hsv, out = np.empty_like(real[0]), np.empty_like(real[0])
    mask = np.empty(real[0].shape[:2], np.uint8)
    low, high = (6, 128, 38), (23, 255, 255)

    def work(frame: int) -> None:
        shown = twin[frame % POOL]
        np.copyto(out, real[frame % POOL])
        cv2.cvtColor(shown, cv2.COLOR_BGR2HSV, dst=hsv)
        cv2.inRange(hsv, low, high, dst=mask)
        cv2.copyTo(shown, mask, out)

    return work


def ours(
    mixer: Mixer, real: list[CameraReading], twin: list[CameraReading]
) -> Callable[[int], None]:
    """Return a call of the mixer as a flight makes it."""

    def work(frame: int) -> None:
        mixed = mixer.mix(real[frame % POOL], twin[frame % POOL], now_s=1.06)
        if mixed.provenance.dropped is not None:
            raise RuntimeError(mixed.provenance.detail)

    return work


def reading(image: BgrImage, source: Source) -> CameraReading:
    """Return the image as a reading of a 69 degree camera."""
    camera = Intrinsics.from_fov(image.shape[1], image.shape[0], np.radians(69.0))
    return CameraReading(1.0, 1.05, 0, source, image, camera)


def compare(size: tuple[int, int], frames: int) -> None:
    """Print one size: frames per second, percentiles, and the ratio to the bare calls."""
    real = [wall(seed, *size) for seed in range(POOL)]
    twin = [with_gate(wall(seed + POOL, *size)) for seed in range(POOL)]
    (mixer,) = compile_recipe(load_recipe(load_document(RECIPE)), object_ids={})
    calls = {
        "bare OpenCV": bare(real, twin),
        "gate recipe": ours(
            mixer, [reading(one, "real") for one in real], [reading(one, "twin") for one in twin]
        ),
    }
    # In turns, so that a neighbour's load falls on both alike.
    rounds = [
        {name: duration_ms(work, frames // 4) for name, work in calls.items()} for _ in "1234"
    ]
    taken = {name: np.concatenate([one[name] for one in rounds]) for name in calls}
    print(f"{size[0]} x {size[1]}")
    for name, ms in taken.items():
        p50, p99 = np.percentile(ms, (50, 99))
        print(
            f"  {name}: {1e3 / ms.mean():6.0f} frames/s, mean {ms.mean():.3f} ms,"
            f" p50 {p50:.3f} ms, p99 {p99:.3f} ms"
        )
    ratio = np.median(taken["gate recipe"]) / np.median(taken["bare OpenCV"])
    rate = 1e3 / taken["gate recipe"].mean()
    print(f"  ratio to bare OpenCV (p50): {ratio:.2f}  (wanted: at most 1)")
    if wanted := WANTED_PER_S.get(size):
        print(f"  ratio to the wanted {wanted} frames/s: {rate / wanted:.2f}")
    if limit_ms := WANTED_P99_MS.get(size):
        p99 = np.percentile(taken["gate recipe"], 99)
        print(f"  ratio of p99 to {limit_ms} ms: {p99 / limit_ms:.2f}")


def main() -> None:
    """Compare all sizes."""
    parser = argparse.ArgumentParser(description="mixing beside bare OpenCV, on one core")
    parser.add_argument("--frames", type=int, default=1000)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for size in SIZES:
        compare(size, arguments.frames)


if __name__ == "__main__":
    main()
