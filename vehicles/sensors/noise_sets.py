"""The noise of all sensors together, as sets that profiles name."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from vehicles.sensors.beams import RangeNoise
from vehicles.sensors.depth import NO_DEPTH_NOISE, DepthNoise
from vehicles.sensors.gps import NO_GPS_NOISE, GpsNoise
from vehicles.sensors.imu import NO_IMU_NOISE, ImuNoise
from vehicles.sensors.lidar import POINTS_NOISE, RANGEFINDER_NOISE, SCAN_NOISE, silent
from vehicles.sensors.microphone import QUIET, MicrophoneNoise


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """A set of noise settings, one for each sensor."""

    imu: ImuNoise
    gps: GpsNoise
    lidar: RangeNoise
    lidar_points: RangeNoise
    rangefinder: RangeNoise
    depth: DepthNoise
    microphone: MicrophoneNoise


IDEAL = SensorNoise(
    imu=NO_IMU_NOISE,
    gps=NO_GPS_NOISE,
    lidar=silent(SCAN_NOISE),
    lidar_points=silent(POINTS_NOISE),
    rangefinder=silent(RANGEFINDER_NOISE),
    depth=NO_DEPTH_NOISE,
    microphone=QUIET,
)
"""A simulator's idea of sensors: their reach, and no noise."""

DATASHEET = SensorNoise(
    imu=ImuNoise(),
    gps=GpsNoise(),
    lidar=SCAN_NOISE,
    lidar_points=POINTS_NOISE,
    rangefinder=RANGEFINDER_NOISE,
    depth=DepthNoise(),
    microphone=MicrophoneNoise(),
)
"""What the datasheets promise."""

NOISE_SETS: Mapping[str, SensorNoise] = MappingProxyType({"ideal": IDEAL, "datasheet": DATASHEET})
"""By what a profile of an embedded vehicle says under `sensors`."""
