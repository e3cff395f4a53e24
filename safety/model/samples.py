"""The samples that judge and guard get: immutable, each with its time on the run clock.

Positions are NED metres in the world's local frame, whatever their source.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.vehicles.autopilots.autopilot import FlightMode
from wil_campaign.worlds.frames import Pose, Quat, Vec3

Stage = Literal["takeoff", "at_height", "goal", "done", "land", "landed", "end"]
"""Stages of a run: takeoff commanded, all at height, goal given (t0), autonomy done, landing
commanded, on the ground and disarmed, end of all samples."""

ModeName = Literal["hold", "takeoff", "guided", "land", "rtl", "mission", "pilot", "other"]
"""The values of `wil_campaign.vehicles.autopilots.autopilot.FlightMode`."""


class PoseSample(NamedTuple):
    """A sample of a vehicle's pose in the world, from the source that its campaign chose.

    A named tuple: a hundred are made in a second, and a frozen dataclass takes twice as long.
    """

    t_s: float
    vehicle: str
    pose: Pose
    velocity_ned_m_s: Vec3


@dataclass(frozen=True, slots=True)
class StateSample:
    """A sample of the state that a vehicle reports of itself.

    mode_name: the autopilot's own word. landed: None while unknown. fault: what is wrong with it
    in words, None while nothing is; estimator_fault: the same of its estimator alone.
    dead_reckoning: what its estimator's position was held by at arming and is not now, in words.
    battery_fraction: 0 to 1, battery_v: volts; None when unknown.
    """

    t_s: float
    vehicle: str
    armed: bool
    mode: FlightMode
    mode_name: str = ""
    landed: bool | None = None
    fault: str | None = None
    battery_fraction: float | None = None
    battery_v: float | None = None
    estimator_fault: str | None = None
    dead_reckoning: str | None = None


@dataclass(frozen=True, slots=True)
class LinkSample:
    """A sample of the link: something valid arrived from the vehicle."""

    t_s: float
    vehicle: str


class ReferenceSample(NamedTuple):
    """A sample of a vehicle's pose by another source than the judged one.

    q_wxyz: its attitude (FRD to NED), None where it was not recorded.
    """

    t_s: float
    vehicle: str
    source: str
    position_ned_m: Vec3
    velocity_ned_m_s: Vec3
    q_wxyz: Quat | None = None


class GroundSpeedSample(NamedTuple):
    """A sample of a vehicle's horizontal speed by another source than the judged one.

    t_s: when it arrived. accuracy_m_s: one standard deviation; None where the source states none.
    """

    t_s: float
    vehicle: str
    source: str
    speed_m_s: float
    accuracy_m_s: float | None


class HeadingSample(NamedTuple):
    """A sample of how far a vehicle's estimated heading is turned from another source's.

    t_s: when it arrived. turned_rad: since its frame was anchored where the source knows rotations
    alone, as gyroscopes do. accuracy_rad: of the source, one standard deviation.
    """

    t_s: float
    vehicle: str
    source: str
    turned_rad: float
    accuracy_rad: float


class ReportSample(NamedTuple):
    """A sample of a signal whose value is carried elsewhere: a status, a mixed frame.

    t_s: the time for which it is valid.
    """

    t_s: float
    vehicle: str
    signal: str


@dataclass(frozen=True, slots=True)
class DoubtSample:
    """A sample that marks a signal as not credible from t_s on; reason: for people.

    source: where the signal comes from ("mocap", "recipe").
    """

    t_s: float
    vehicle: str
    signal: str
    source: str
    reason: str


@dataclass(frozen=True, slots=True)
class StageSample:
    """A sample of a reached stage of the run, by one vehicle or, with None, by all."""

    t_s: float
    stage: Stage
    vehicle: str | None = None


@dataclass(frozen=True, slots=True)
class DropOutSample:
    """A sample of a vehicle that left the flight, which continued without it."""

    t_s: float
    vehicle: str


@dataclass(frozen=True, slots=True)
class FenceSample:
    """A sample of a vehicle's changed fence."""

    t_s: float
    vehicle: str
    fence: Fence
