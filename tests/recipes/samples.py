"""Readings and steps for the tests of recipes."""

from dataclasses import replace
from typing import Any

import numpy as np

from wil_campaign.recipes.model.registry import Stage, StepContext, find_step
from wil_campaign.recipes.operations.optics import scaled_intrinsics
from wil_campaign.recipes.working import Masked
from wil_campaign.vehicles.readings import (
    BgrImage,
    CameraReading,
    DepthReading,
    GpsReading,
    ImuReading,
    LidarPointsReading,
    LidarScanReading,
    MicrophoneReading,
    PoseReading,
    RangefinderReading,
    Source,
)
from wil_campaign.worlds.camera import Intrinsics
from wil_campaign.worlds.frames import Pose

WIDTH, HEIGHT = 64, 48
CAMERA = Intrinsics.from_fov(WIDTH, HEIGHT, 1.2)


def build(
    name: str, /, context: StepContext | None = None, stage: Stage | None = None, **parameters: Any
) -> Any:
    kind = find_step(name, stage)
    assert kind is not None
    return kind.build(kind.parameters(**parameters), context or StepContext())


def apply(name: str, reading: Any, other: Any = None, /, **parameters: Any) -> Any:
    """Return the work that a transform or filter makes of a reading."""
    beside = None if other is None else Masked(other)
    return build(name, **parameters)(Masked(reading), beside)


def plain(
    color: tuple[int, int, int] = (200, 60, 30), width: int = WIDTH, height: int = HEIGHT
) -> BgrImage:
    return np.full((height, width, 3), color, np.uint8)


def camera(image: BgrImage | None = None, source: Source = "twin", **more: Any) -> CameraReading:
    image = plain() if image is None else image
    height, width = image.shape[:2]
    lens = scaled_intrinsics(CAMERA, width, height)
    if (width, height) == (WIDTH, HEIGHT):
        lens = CAMERA
    return replace(CameraReading(1.0, 1.0, 3, source, image, lens), **more)


def depth(values: Any, source: Source = "twin", **more: Any) -> DepthReading:
    depth_m = np.asarray(values, np.float32)
    if depth_m.ndim == 0:
        depth_m = np.full((HEIGHT, WIDTH), depth_m, np.float32)
    height, width = depth_m.shape
    lens = scaled_intrinsics(CAMERA, width, height)
    return replace(DepthReading(1.0, 1.0, 3, source, depth_m, lens), **more)


def scan(ranges: Any, source: Source = "twin", **more: Any) -> LidarScanReading:
    ranges_m = np.asarray(ranges, np.float32)
    made = LidarScanReading(
        t_s=1.0,
        arrived_s=1.0,
        seq=3,
        source=source,
        ranges_m=ranges_m,
        start_angle_rad=-np.pi,
        step_rad=2 * np.pi / len(ranges_m),
        range_min_m=0.1,
        range_max_m=30.0,
    )
    return replace(made, **more)


def cloud(points: Any, source: Source = "twin", **more: Any) -> LidarPointsReading:
    points_frd_m = np.asarray(points, np.float32).reshape(-1, 3)
    return replace(LidarPointsReading(1.0, 1.0, 3, source, points_frd_m), **more)


def beam(range_m: float, source: Source = "twin", **more: Any) -> RangefinderReading:
    return replace(RangefinderReading(1.0, 1.0, 3, source, range_m, 0.1, 30.0), **more)


def fix(latitude: float, longitude: float, source: Source = "twin", **more: Any) -> GpsReading:
    made = GpsReading(1.0, 1.0, 3, source, latitude, longitude, 10.0, (1.0, 2.0, 3.0), 1.0, 2.0)
    return replace(made, **more)


def pose(at: Pose | None = None, source: Source = "twin", **more: Any) -> PoseReading:
    made = PoseReading(1.0, 1.0, source, at or Pose((1.0, 2.0, 3.0)), (1.0, 0.0, 0.0), 3)
    return replace(made, **more)


def imu(source: Source = "twin", **more: Any) -> ImuReading:
    return replace(ImuReading(1.0, 1.0, 3, source, (0.1, 0.2, -9.8), (0.01, 0.02, 0.03)), **more)


def sound(samples: Any, source: Source = "twin", rate: int = 8000, **more: Any) -> Any:
    made = MicrophoneReading(
        1.0, 1.0, 3, source, np.asarray(samples, np.int16), rate, full_scale_pa=10.0
    )
    return replace(made, **more)
