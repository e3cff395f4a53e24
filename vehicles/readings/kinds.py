"""All kinds of readings, and the sensor types by which recipes and campaigns name them."""

from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from wil_campaign.foundation.files.documents import KeyFaultError
from wil_campaign.hooks import sensor_types
from wil_campaign.installed_plugins import absent_additions, loaded_additions, plugin_additions
from wil_campaign.vehicles.readings.images import CameraReading, DepthReading
from wil_campaign.vehicles.readings.navigation import GpsReading, ImuReading, PoseReading
from wil_campaign.vehicles.readings.numbers import NumbersReading
from wil_campaign.vehicles.readings.ranging import (
    LidarPointsReading,
    LidarScanReading,
    RangefinderReading,
)
from wil_campaign.vehicles.readings.sound import MicrophoneReading
from wil_campaign.vehicles.readings.traits import NUMBERS, ReadingTraits

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
    return tuple(plugin_additions(sensor_types))


def sensor_name_type() -> Any:
    """Return the type of a key that names a sensor type."""
    return Annotated[Literal[sensor_names()], BeforeValidator(_require_installed)]


def _require_installed(name: object) -> object:
    """Return the name of a sensor type; raises KeyFaultError where its plugin is absent."""
    if why := absent_additions(sensor_types).get(str(name)):
        raise KeyFaultError((), why)
    return name


@cache
def sensor_specs() -> Mapping[str, Any]:
    """Return each sensor type's `SensorSpec` by its name in files. Raises BadInput as `loaded`."""
    return MappingProxyType(loaded_additions(sensor_types, "spec"))


@cache
def reading_types() -> Mapping[str, type[Any]]:
    """Return each sensor type's class of readings by its name in files."""
    return MappingProxyType({name: spec.reading for name, spec in sensor_specs().items()})


@cache
def faults_of_types() -> Mapping[type[Any], Callable[[Any], object]]:
    """Return by class of readings the check that its sensor type brings, perhaps a plugin's."""
    return {spec.reading: spec.fault for spec in sensor_specs().values() if spec.fault is not None}


@cache
def _traits() -> Mapping[type[Any], ReadingTraits]:
    """Return the traits by class; of two types with one class those of the first hold for both."""
    found: dict[type[Any], ReadingTraits] = {}
    for spec in sensor_specs().values():
        found.setdefault(spec.reading, spec.traits)
    return MappingProxyType(found)


def traits_of(kind: type[Any]) -> ReadingTraits:
    """Return the traits of a class of readings; those of numbers for one that no type has."""
    return _traits().get(kind, NUMBERS)


def traits_named(sensor_type: str) -> ReadingTraits:
    """Return the traits of the readings of a sensor type by its name in files."""
    traits: ReadingTraits = sensor_specs()[sensor_type].traits
    return traits


@cache
def _names() -> Mapping[type[Any], str]:
    return MappingProxyType({kind: name for name, kind in reading_types().items()})


def sensor_type_of(reading: Reading) -> str:
    """Return the sensor type that gives this kind of reading."""
    return _names()[type(reading)]


def reading_end_s(reading: Reading) -> float:
    """Return when a reading ends: one that lasts after its last sample, any other at its time."""
    return reading.t_s + reading_duration_s(reading)


def reading_duration_s(reading: Any) -> float:
    """Return how long a reading lasts: 0 for one of a moment."""
    length_s: float = 0.0 if traits_of(type(reading)).line is None else reading.duration_s
    return length_s
