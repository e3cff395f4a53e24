"""A type of sensors: its readings, its keys in campaign files, and what makes its readings.

One file has all of a type that is numbers alone: docs/plugins.md shows one.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Annotated, Any, ClassVar, Protocol

import numpy as np
from pydantic import Field

from wil_campaign.foundation.files.documents import Part
from wil_campaign.installed_plugins import plugin_of_module, require_derived, whose_fault_text
from wil_campaign.vehicles.readings import Reading, Source
from wil_campaign.vehicles.readings.traits import NUMBERS, ReadingTraits
from wil_campaign.vehicles.sensors.beams import BeamFan, RayCaster
from wil_campaign.vehicles.sensors.noise_sets import NoiseSetName
from wil_campaign.vehicles.sensors.timing import Timing
from wil_campaign.vehicles.sensors.truth import Truth
from wil_campaign.worlds.frames import AT_ORIGIN, Pose, quat_from_euler
from wil_campaign.worlds.geodesy import LocalFrame

TruthRate = Annotated[float, Field(gt=0, le=250)]
"""The embedded vehicle's physics runs at 250 Hz: no truth is available in between."""


class MountPart(Part):
    """A sensor's mount: metres forward, right and down of the body's centre, and angles.

    pitch_deg is positive upwards, yaw_deg to the right, roll_deg right side down.

    forward_m, right_m, down_m: from the body's centre to the sensor. roll_deg, pitch_deg, yaw_deg:
    turn of the sensor on the body, applied as yaw, then pitch, then roll.
    """

    forward_m: float = 0.0
    right_m: float = 0.0
    down_m: float = 0.0
    roll_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-90, le=90)] = 0.0
    yaw_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0

    def pose(self) -> Pose:
        """Return the sensor's mount as a pose in the body's FRD frame."""
        angles = (math.radians(a) for a in (self.roll_deg, self.pitch_deg, self.yaw_deg))
        return Pose((self.forward_m, self.right_m, self.down_m), quat_from_euler(*angles))


class SensorOptions(Part):
    """The keys of a type of sensors in campaign files, and what a run needs of them.

    The docstring of a derived class is the text of its page: `key: what it is` of each key.
    embedded_only: without a source, only an embedded vehicle that flies has its readings.
    """

    embedded_only: ClassVar[bool] = False

    @property
    def per_s(self) -> float | None:
        """Return the sensor's readings per second (`rate_hz`); None: as they arrive."""
        rate_hz: float | None = getattr(self, "rate_hz", None)
        return rate_hz

    @property
    def mounted(self) -> Pose:
        """Return the sensor's pose in the body's FRD frame."""
        return AT_ORIGIN

    @property
    def fan(self) -> BeamFan | None:
        """Return the beams of a sensor that looks around; None for others."""
        return None


class MountedOptions(SensorOptions):
    """The keys of a sensor that has a place of its own on the body: by default its centre."""

    mount: MountPart = MountPart()

    @property
    def mounted(self) -> Pose:
        """Return the sensor's pose in the body's FRD frame."""
        return self.mount.pose()


class Sensor(Protocol):
    """A sensor model that makes readings of the truth (protocol)."""

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> Reading:
        """Return the sensor's reading of t_s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorSite:
    """Where a sensor's model stands.

    side: its vehicle. frame: where the world's local frame (NED metres) lies on WGS-84. noise: the
    set that the vehicle's profile names. mount: its pose in the body's FRD frame. caster: returns
    what casts rays into the vehicle's world.
    """

    side: Source
    frame: LocalFrame
    noise: NoiseSetName
    mount: Pose
    caster: Callable[[], RayCaster]

    def timing(self, datasheet: Timing, rate_hz: float) -> Timing:
        """Return the sensor's timing: ideal, or late as data sheets say.

        A scan of a lidar is delivered when its turn is complete: a faster one has less latency.
        """
        if self.noise == "ideal":
            return Timing(rate_hz)
        turn_s = 1.0 / datasheet.rate_hz
        late_s = 1.0 / rate_hz if datasheet.latency_s == turn_s else datasheet.latency_s
        return Timing(rate_hz, late_s, datasheet.jitter_s)


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """A type of sensors.

    name: in campaigns and recipes. reading: the class of its readings, which derives from
    `NumbersReading`. options: its keys; those of cameras are in campaigns/schema/sensors.py. model:
    a function of the options and of the site, which returns the sensor of a vehicle, or of the
    twin, which senses at any pose. fault: a function of a reading, which returns what is wrong with
    it, or ""; a number that is not finite is refused before. traits: of readings that are more than
    numbers. mavlink: `module:name` of the `MavlinkReading` that reads them of a vehicle's messages
    (vehicles/sources/readings/mavlink_messages.py); "" for none.
    """

    name: str
    reading: type[Any]
    options: type[SensorOptions] = SensorOptions
    model: Callable[[Any, SensorSite], Sensor] | None = None
    fault: Callable[[Any], str] | None = None
    traits: ReadingTraits = NUMBERS
    mavlink: str = ""

    def __post_init__(self) -> None:
        """Raise TypeError for a class of another form."""
        what = f"sensor {self.name!r}"
        require_derived(self.options, SensorOptions, what)
        if "__dataclass_fields__" not in vars(self.reading):
            raise TypeError(f"{what}: {self.reading.__name__} is no dataclass of its own")
        if not {"t_s", "arrived_s", "seq", "source"} <= {one.name for one in fields(self.reading)}:
            raise TypeError(f"{what}: {self.reading.__name__} lacks the stamps of a NumbersReading")


class NamedSensor:
    """A sensor's model whose exceptions name it; its readings are of its type, their times go on.

    name: in messages, as "sonar down of twin". side: of its readings. make: makes the model.
    """

    def __init__(
        self, name: str, spec: SensorSpec, side: Source, make: Callable[[], Sensor]
    ) -> None:
        self._name = name
        self._side = side
        self._asked_s = self._given_s = -math.inf
        self._reading = spec.reading
        self._plugin = plugin_of_module(spec.reading.__module__)
        with self._named():
            self._sensor = make()

    def sample(self, truth: Truth, t_s: float, rng: np.random.Generator) -> Reading:
        """Return the sensor's reading of t_s."""
        with self._named():
            reading: Reading = self._sensor.sample(truth, t_s, rng)
            if type(reading) is not self._reading:
                given = type(reading).__name__
                raise TypeError(f"gave {given}, not {self._reading.__name__}")
            self._require_stamps(reading, t_s)
        return reading

    def _require_stamps(self, reading: Reading, t_s: float) -> None:
        """Raise ValueError for a reading of another vehicle, or of a time that stands still.

        A time that is not finite is refused where readings are checked.
        """
        if reading.source != self._side:
            raise ValueError(f"gave a reading of {reading.source}, not of {self._side}")
        if reading.t_s <= self._given_s and t_s > self._asked_s:
            times = f"gave a reading of {reading.t_s:.3f} s at {t_s:.3f} s"
            raise ValueError(f"{times}, after one of {self._given_s:.3f} s")
        self._asked_s, self._given_s = t_s, reading.t_s

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            error.add_note(f"({self._name}){whose_fault_text(self._plugin)}")
            raise
