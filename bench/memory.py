"""Whether mixing grows: ten minutes of mixtures of every kind, and the resident size over them.

    python bench/memory.py [--minutes M]

Readings of a camera (320x240, 30 Hz), a lidar, points, a microphone, an IMU and poses of both
worlds go through a recipe with steps that remember (delay, resampling, background, photometry,
sound), one minute of readings after the other, as fast as they are mixed. The size is read after
each minute; the first is for warming up.
"""

import argparse
import ctypes
import gc
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from wil_campaign.foundation.files.documents import parse_document
from wil_campaign.recipes.language.recipe_document import load_recipe
from wil_campaign.recipes.pipeline.pipeline import Mixer, compile_recipe
from wil_campaign.vehicles.readings import (
    CameraReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    Reading,
    Source,
)
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

WANTED_PERCENT = 2.0
CAMERA = Intrinsics.from_fov(320, 240, np.radians(69.0))
IMAGES = 8
RECIPE = """\
schema: wil/recipe/1
sensors:
  camera: {type: camera}
  scan: {type: lidar}
  points: {type: lidar_points}
  imu: {type: imu}
  pose: {type: pose}
  sound: {type: microphone}
combine:
  - sensor: camera
    transform: [{delay: 100}, match_photometry]
    filter: [{isolate_color: orange}]
    merge: {overlay: {soft_edge_px: 2}}
    publish: [real]
    max_skew_ms: 200
  - sensor: camera
    filter: [{subtract_background: {method: mog2}}]
    merge: overlay
    publish: [twin]
  - {sensor: scan, transform: [{resample: interpolate}], merge: {aggregate: min}}
  - {sensor: points, filter: [remove_outliers], merge: concatenate}
  - {sensor: imu, transform: [{resample: interpolate}], merge: {aggregate: mean}}
  - {sensor: pose, transform: [{delay: 50}], merge: {aggregate: mean}}
  - {sensor: sound, filter: [{band_pass: {low_hz: 300, high_hz: 3400}}], merge: add}
"""
RATES_HZ = {"camera": 30, "scan": 10, "points": 5, "imu": 200, "pose": 100, "sound": 20}


class Readings:
    """Makes readings as sources do: new objects each time, with arrays of their own."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(1)
        self._images = [self._image() for _ in range(IMAGES)]

    def _image(self) -> np.ndarray:
        image = self._rng.integers(90, 160, (240, 320, 3), dtype=np.uint8)
        left, top = self._rng.integers(20, 120, 2)
        cv2.rectangle(image, (left, top), (left + 60, top + 60), (0, 105, 220), 8)
        return image

    def of(self, sensor: str, t_s: float, seq: int, source: Source) -> Reading:
        """Return a reading of a sensor."""
        rng, head = self._rng, (t_s, t_s + 0.01, seq, source)
        match sensor:
            case "camera":
                return CameraReading(*head, self._images[seq % IMAGES].copy(), CAMERA)
            case "scan":
                ranges = rng.uniform(1.0, 9.0, 360).astype(np.float32)
                return LidarScanReading(
                    t_s=t_s,
                    arrived_s=t_s + 0.01,
                    seq=seq,
                    source=source,
                    ranges_m=ranges,
                    start_angle_rad=-np.pi,
                    step_rad=2 * np.pi / 360,
                    range_min_m=0.1,
                    range_max_m=30.0,
                )
            case "points":
                points = rng.uniform(-5.0, 5.0, (4000, 3)).astype(np.float32)
                return LidarPointsReading(
                    t_s=t_s, arrived_s=t_s + 0.01, seq=seq, source=source, points_frd_m=points
                )
            case "imu":
                return ImuReading(
                    t_s=t_s,
                    arrived_s=t_s + 0.01,
                    seq=seq,
                    source=source,
                    specific_force_frd_m_s2=(0.0, 0.0, -9.8),
                    rates_frd_rad_s=(0.0, 0.0, 0.1),
                )
            case "pose":
                return PoseReading(
                    t_s=t_s, arrived_s=t_s + 0.01, seq=seq, source=source, pose=Pose((t_s, 0, -1))
                )
            case _:
                samples = rng.integers(-9000, 9000, 800, dtype=np.int16)
                return MicrophoneReading(
                    t_s=t_s,
                    arrived_s=t_s + 0.06,
                    seq=seq,
                    source=source,
                    samples=samples,
                    sample_rate_hz=16000,
                    full_scale_pa=20.0,
                )


def ticks(from_s: int, for_s: int) -> Iterator[tuple[float, str, int]]:
    """Yield time, sensor and number of each reading of some seconds, in order."""
    due = [
        (k / rate, sensor, k)
        for sensor, rate in RATES_HZ.items()
        for k in range(rate * from_s, rate * (from_s + for_s))
    ]
    yield from sorted(due)


def mix_some(mixers: tuple[Mixer, ...], readings: Readings, from_s: int, for_s: int) -> int:
    """Mix some seconds of readings; return how many mixtures came of it."""
    made = 0
    for t_s, sensor, seq in ticks(from_s, for_s):
        real = readings.of(sensor, t_s, seq, "real")
        twin = readings.of(sensor, t_s, seq, "twin")
        for mixer in mixers:
            if mixer.sensor == sensor:
                mixer.offer("real", real)
                mixer.offer("twin", twin)
                made += mixer.mix(real, twin, now_s=t_s + 0.07).reading is not None
    return made


def mixers_of_all_kinds() -> tuple[Mixer, ...]:
    """Return the recipe's mixers, made ready."""
    return compile_recipe(
        load_recipe(parse_document(RECIPE.encode(), name="bench.yaml")), object_ids={}
    )


def resident_mb() -> float:
    """Return the resident size, once what is free has been given back."""
    gc.collect()
    ctypes.CDLL("libc.so.6").malloc_trim(0)
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024.0


def main() -> None:
    """Mix, and print the size after each minute."""
    parser = argparse.ArgumentParser(description="resident size over minutes of mixing")
    parser.add_argument("--minutes", type=int, default=10)
    minutes = parser.parse_args().minutes
    cv2.setNumThreads(1)
    mixers, readings = mixers_of_all_kinds(), Readings()
    sizes_mb: list[float] = []
    # The minute before the ten fills what remembers: buffers, histories, compiled code.
    for minute in range(minutes + 1):
        start_s = time.perf_counter()
        made = mix_some(mixers, readings, 60 * minute, 60)
        sizes_mb.append(resident_mb())
        took_s = time.perf_counter() - start_s
        print(
            f"minute {minute}: {sizes_mb[-1]:.1f} MB, {made} mixtures in {took_s:.0f} s", flush=True
        )
    grown = (max(sizes_mb[1:]) / sizes_mb[0] - 1.0) * 100.0
    print(f"largest over the size after warming up: {grown:+.2f} %")
    print(f"  ratio to the wanted {WANTED_PERCENT:g} %: {max(grown, 0.0) / WANTED_PERCENT:.2f}")


if __name__ == "__main__":
    main()
