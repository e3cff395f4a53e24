"""Blank readings as large as those of a sensor, to find out what a recipe does to their size."""

import numpy as np

from wil_campaign.campaigns.values.sensor_setups import (
    CameraSetup,
    DepthSetup,
    SensorSetup,
    options_of,
)
from wil_campaign.recipes.working import Side
from wil_campaign.vehicles.readings import CameraReading, DepthReading, LidarScanReading, Reading
from wil_campaign.vehicles.sensors.lidar import LidarOptions


def blank_reading(sensor: SensorSetup, side: Side) -> Reading | None:
    """Return an empty reading as large as those of a sensor; None for one without a shape."""
    if isinstance(sensor, CameraSetup):
        size = (sensor.intrinsics.height_px, sensor.intrinsics.width_px)
        image = np.zeros((*size, 3), np.uint8)
        return CameraReading(0.0, 0.0, 0, side, image, sensor.intrinsics, sensor=sensor.name)
    if isinstance(sensor, DepthSetup):
        size = (sensor.intrinsics.height_px, sensor.intrinsics.width_px)
        depth_m = np.full(size, np.inf, np.float32)
        return DepthReading(0.0, 0.0, 0, side, depth_m, sensor.intrinsics, sensor=sensor.name)
    if lidar := options_of(sensor, LidarOptions):
        pattern = lidar.pattern
        return LidarScanReading(
            t_s=0.0,
            arrived_s=0.0,
            seq=0,
            source=side,
            ranges_m=np.full(pattern.beams, np.inf, np.float32),
            start_angle_rad=pattern.start_angle_rad,
            step_rad=pattern.step_rad,
            range_min_m=0.0,
            range_max_m=np.inf,
            sensor=sensor.name,
        )
    return None
