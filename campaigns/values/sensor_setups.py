"""Setups of a vehicle's sensors: cameras, depth cameras, and those of a registered type.

source: of external readings; None: readings are computed here.
"""

from dataclasses import dataclass
from typing import ClassVar, TypeVar

from wil_campaign.campaigns.values.external_setups import ReadingSourceSetup, SourceSetup
from wil_campaign.vehicles.sensors.sensor_spec import SensorOptions
from wil_campaign.worlds.camera import CameraMount, Intrinsics
from wil_campaign.worlds.frames import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSetup:
    """The setup of a vehicle's camera; intrinsics may be distorted. source: None: rendered."""

    kind: ClassVar[str] = "camera"

    name: str
    rate_hz: float
    intrinsics: Intrinsics
    mount: CameraMount
    source: SourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthSetup:
    """The setup of a vehicle's depth camera. source: None: rendered."""

    kind: ClassVar[str] = "depth"

    name: str
    rate_hz: float
    intrinsics: Intrinsics
    mount: CameraMount
    source: ReadingSourceSetup | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherSensorSetup:
    """The setup of a sensor other than a camera. kind: its type; options: its keys."""

    kind: str
    name: str
    options: SensorOptions
    source: ReadingSourceSetup | None = None

    @property
    def rate_hz(self) -> float | None:
        """Return the sensor's readings per second; None: as they arrive."""
        return self.options.per_s

    @property
    def mount(self) -> Pose:
        """Return the sensor's pose in the body's FRD frame."""
        return self.options.mounted


SensorSetup = CameraSetup | DepthSetup | OtherSensorSetup
SourcedSetup = DepthSetup | OtherSensorSetup
"""A sensor whose readings may be external, by a ReadingSourceSetup."""
Options = TypeVar("Options", bound=SensorOptions)


def sensor_options_of(sensor: SensorSetup, wanted: type[Options]) -> Options | None:
    """Return a sensor's keys where its type has these; else None."""
    options = sensor.options if isinstance(sensor, OtherSensorSetup) else None
    return options if isinstance(options, wanted) else None
