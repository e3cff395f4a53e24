"""What reads a type of sensors of MAVLink's messages: a record, and their times; pure."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol

from wil_campaign.installed_plugins import load_plugin_object
from wil_campaign.vehicles.driver.vehicle_state import VehicleState
from wil_campaign.vehicles.readings import Reading, Source
from wil_campaign.vehicles.readings.kinds import sensor_specs
from wil_campaign.worlds.frames import AT_ORIGIN, Pose

CM = 0.01
UINT16_MAX = 0xFFFF
_UNIX_US = 10**15
"""time_usec above this counts from 1970, below it from boot (31 years)."""


@dataclass(frozen=True, slots=True)
class MessageTimes:
    """When a message was sampled and when it arrived, on the run clock; side: whose it is."""

    t_s: float
    arrived_s: float
    side: Source

    @property
    def stamps(self) -> tuple[float, float, int, Source]:
        """Return the first fields of its reading: times, number 0, vehicle."""
        return self.t_s, self.arrived_s, 0, self.side


@dataclass(frozen=True, slots=True, kw_only=True)
class MavlinkSensor:
    """A sensor whose readings are in one of the vehicle's MAVLink messages.

    message: its name; None for a pose, which is the vehicle's estimate. rate_hz: at most; None:
    as it arrives. options: the sensor's keys; None for one of images. mount: its pose in the body's
    FRD frame. sensor_id: by the message's id; None: any. undulation_m: of the geoid above the
    ellipsoid, for a GPS receiver that does not report it.
    """

    message: str | None
    rate_hz: float | None = None
    options: Any = None
    mount: Pose = AT_ORIGIN
    sensor_id: int | None = None
    undulation_m: float | None = None


class HasState(Protocol):
    """The vehicle of whose messages readings are made (protocol)."""

    @property
    def state(self) -> VehicleState:
        """Return the vehicle's last reported state."""


Reader = Callable[[Any, MessageTimes], Reading | None]
"""Returns the reading in a message; None for none. Raises UnusableReadingError."""


@dataclass(frozen=True, slots=True)
class MavlinkReading:
    """How the readings of a type of sensors are read of a vehicle's MAVLink messages.

    messages: those that hold such readings, the usual one first. reader: makes what reads them for
    a sensor of a vehicle. remedies: by message, what to do where none comes. level: why the sensor
    cannot be turned on the body; "" where it can.
    """

    messages: tuple[str, ...]
    reader: Callable[[MavlinkSensor, HasState], Reader]
    remedies: Mapping[str, str] = field(default_factory=dict)
    level: str = ""


@cache
def mavlink_reading(sensor_type: str) -> MavlinkReading | None:
    """Return how a type of sensors is read of MAVLink messages; None where it is in none."""
    place = sensor_specs()[sensor_type].mavlink
    return load_plugin_object(place) if place else None


def messages_of_sensor(sensor_type: str) -> tuple[str, ...]:
    """Return the messages that hold a type of sensor's readings."""
    read = mavlink_reading(sensor_type)
    return () if read is None else read.messages


def message_stamp_s(message: Any) -> tuple[float, bool]:
    """Return a message's time stamp in seconds, and whether it counts from 1970, not from boot."""
    if hasattr(message, "time_boot_ms"):
        return message.time_boot_ms * 1e-3, False
    return message.time_usec * 1e-6, message.time_usec >= _UNIX_US
