"""A flight as a log tells it: values that every reader of logs returns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from wil_campaign.worlds.geodesy import Geodetic


class FlightLogError(Exception):
    """A log cannot be used; the message says which, why, and what to do."""


class TrackPoint(NamedTuple):
    """A place of the vehicle. t_s: of the log's clock. yaw_rad: None where it is unknown."""

    t_s: float
    north_m: float
    east_m: float
    up_m: float
    yaw_rad: float | None


class PowerSample(NamedTuple):
    """A measurement of the battery. t_s: of the log's clock; current_a: None where unknown."""

    t_s: float
    voltage_v: float
    current_a: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedFlight:
    """What a log tells. None, or empty, is what it does not tell.

    kind: of the log, in words. vehicle_type: as MAVLink calls it ("quadrotor"). firmware: version
    and commit, in words. track: in a local north-east-up frame in metres, oldest first. origin:
    latitude, longitude and altitude of that frame's origin. armed: times of arming (True) and
    disarming. problems: what is missing or damaged, in words.
    """

    kind: str
    autopilot: str | None = None
    vehicle_type: str = ""
    firmware: str = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    track: Sequence[TrackPoint] = ()
    origin: Geodetic | None = None
    armed: Sequence[tuple[float, bool]] = ()
    power: Sequence[PowerSample] = ()
    problems: tuple[str, ...] = ()
