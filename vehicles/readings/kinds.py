"""All kinds of readings, and the sensor types by which recipes and campaigns name them."""

from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Literal

from wil_campaign.hooks import sensor_types
from wil_campaign.installed_plugins import added, loaded
from wil_campaign.vehicles.readings.images import CameraReading, DepthReading
from wil_campaign.vehicles.readings.navigation import GpsReading, ImuReading, PoseReading
from wil_campaign.vehicles.readings.numbers import NumbersReading
from wil_campaign.vehicles.readings.ranging import (
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
)
from wil_campaign.vehicles.readings.sound import MicrophoneReading

Reading = (
    CameraReading
    | DepthReading
    | LidarScanReading
    | LidarPointsReading
    | RangefinderReading
    | GpsReading
    | PoseReading
    | ImuReading
    | MicrophoneReading
    | NumbersReading
)


def sensor_names() -> tuple[str, ...]:
    """Return the sensor types as files name them, the core's first; imports none of their code."""
    return tuple(added(sensor_types))


def one_of_names() -> Any:
    """Return the type of a key that names a sensor type."""
    return Literal[sensor_names()]


@cache
def sensor_specs() -> Mapping[str, Any]:
    """Return each sensor type's `SensorSpec` by its name in files. Raises BadInput as `loaded`."""
    return MappingProxyType(loaded(sensor_types, "spec"))


@cache
def reading_types() -> Mapping[str, type[Any]]:
    """Return each sensor type's class of readings by its name in files."""
    return MappingProxyType({name: spec.reading for name, spec in sensor_specs().items()})


@cache
def faults_of_types() -> Mapping[type[Any], Callable[[Any], str]]:
    """Return by class of readings the check that its sensor type brings, where it does."""
    return {spec.reading: spec.fault for spec in sensor_specs().values() if spec.fault is not None}


@cache
def _names() -> Mapping[type[Any], str]:
    return MappingProxyType({kind: name for name, kind in reading_types().items()})


def sensor_type_of(reading: Reading) -> str:
    """Return the sensor type that gives this kind of reading."""
    return _names()[type(reading)]


def end_s(reading: Reading) -> float:
    """Return when a reading ends: a block of sound after its last sample, any other at its time."""
    length_s = reading.duration_s if isinstance(reading, MicrophoneReading) else 0.0
    return reading.t_s + length_s
