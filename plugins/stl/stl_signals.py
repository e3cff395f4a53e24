"""The signals that STL formulas may name, and how samples give their values."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import get_args

from wil_campaign.plugins.stl.units import SignalKind
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.model import signals
from wil_campaign.safety.model.samples import ModeName, PoseSample, ReferenceSample, StateSample
from wil_campaign.safety.model.signals import extrapolated_ned_m
from wil_campaign.safety.oracles.contact import ContactLimits
from wil_campaign.safety.oracles.late_tracks import LateStretch, LateTracks
from wil_campaign.safety.oracles.oracle import MotionName, OracleContext, StageTracker, WorldProbe
from wil_campaign.vehicles.driver.vehicle_state import ReportName
from wil_campaign.worlds.frames import Vec3, heading_of, norm, subtract

_FARTHEST_M = 1e5
"""The clearance where no object is near."""

OfPose = Callable[[PoseSample], float]
OfState = Callable[[StateSample], float | None]
OfReference = Callable[[PoseSample, ReferenceSample], float | None]
"""Of the newest judged pose, and of a pose by another source."""


@dataclass(frozen=True, slots=True)
class StlSignal:
    """An STL signal of one vehicle in one run: its kind, and how a sample gives its value."""

    kind: SignalKind
    of_pose: OfPose | None = None
    of_state: OfState | None = None
    of_both: bool = False
    """Whether the other vehicle's poses are needed too: `PairDistanceSignal` computes it."""
    of_reference: OfReference | None = None
    of_silence: bool = False
    """Whether it is the time since something was last received from the vehicle."""


def _truth(value: bool | None) -> float | None:
    """Return a boolean STL signal's value as a number; None for None."""
    return None if value is None else float(value)


def _in_mode(mode: str) -> OfState:
    """Return the STL signal that is true while the vehicle is in a mode."""
    return lambda sample: float(sample.mode.value == mode)


_OF_POSE: dict[str, tuple[SignalKind, OfPose]] = {
    "north_m": (SignalKind("m", "how far north of the world's origin"), signals.north_m),
    "east_m": (SignalKind("m", "how far east of the world's origin"), signals.east_m),
    "up_m": (SignalKind("m", "height over the world's origin"), signals.up_m),
    "speed_m_s": (SignalKind("m/s", "speed along all axes", least=0.0), signals.speed_m_s),
    "ground_speed_m_s": (
        SignalKind("m/s", "horizontal speed", least=0.0),
        signals.ground_speed_m_s,
    ),
    "climb_m_s": (SignalKind("m/s", "climb rate; negative while it sinks"), signals.climb_m_s),
    "roll_deg": (SignalKind("deg", "roll, positive to the right", -180.0, 180.0), signals.roll_deg),
    "pitch_deg": (SignalKind("deg", "pitch, positive nose up", -90.0, 90.0), signals.pitch_deg),
    "yaw_deg": (
        SignalKind("deg", "heading, clockwise from north, -180 to 180", -180.0, 180.0),
        signals.yaw_deg,
    ),
    "tilt_deg": (SignalKind("deg", "angle to the vertical", 0.0, 180.0), signals.tilt_deg),
}
_OF_STATE: dict[str, tuple[SignalKind, OfState]] = {
    "battery_percent": (SignalKind("%", "remaining charge", 0.0, 100.0), signals.battery_percent),
    "battery_v": (SignalKind("V", "battery voltage", least=0.0), lambda s: s.battery_v),
    "armed": (SignalKind("", "its motors are armed"), lambda s: _truth(s.armed)),
    "on_ground": (
        SignalKind("", "it reports that it is on the ground"),
        lambda s: _truth(s.landed),
    ),
    "estimator_sound": (
        SignalKind("", "its estimator reports no fault"),
        lambda s: _truth(s.estimator_fault is None),
    ),
    **{
        f"mode_{mode}": (SignalKind("", f"it is in a mode of kind '{mode}'"), _in_mode(mode))
        for mode in get_args(ModeName)
    },
}


def _error_m(judged: PoseSample, other: ReferenceSample) -> float:
    """Return the distance between two sources; the judged pose at the time of the other."""
    return norm(subtract(extrapolated_ned_m(judged, other.t_s), other.position_ned_m))


def _speed_error_m_s(judged: PoseSample, other: ReferenceSample) -> float:
    return norm(subtract(judged.velocity_ned_m_s, other.velocity_ned_m_s))


def _heading_error_deg(judged: PoseSample, other: ReferenceSample) -> float | None:
    if other.q_wxyz is None:
        return None
    turned_rad = judged.pose.yaw_rad - heading_of(other.q_wxyz)
    return abs(math.degrees(math.remainder(turned_rad, math.tau)))


_OF_ESTIMATE: dict[str, tuple[SignalKind, OfReference]] = {
    "estimate_error_m": (
        SignalKind(
            "m", "distance of its own estimate from the judged pose, or from the truth", 0.0
        ),
        _error_m,
    ),
    "estimate_speed_error_m_s": (
        SignalKind("m/s", "the same of the velocity, along all axes", 0.0),
        _speed_error_m_s,
    ),
    "estimate_heading_error_deg": (
        SignalKind("deg", "the same of the heading", 0.0, 180.0),
        _heading_error_deg,
    ),
}
_TRUE_SOURCES = frozenset({"truth", "simulator"})
_COMPARED_WITHIN_S = 0.5
"""A judged pose farther from the time of the other tells nothing of the difference."""
_REPORTS: Mapping[str, ReportName] = {
    "battery_percent": "battery",
    "battery_v": "battery",
    "on_ground": "landed_state",
    "estimator_sound": "estimator",
}
_MOTION: Mapping[str, MotionName] = {
    "speed_m_s": "velocity",
    "ground_speed_m_s": "velocity",
    "climb_m_s": "velocity",
    "roll_deg": "attitude",
    "pitch_deg": "attitude",
    "yaw_deg": "attitude",
    "tilt_deg": "attitude",
    "estimate_error_m": "velocity",
    "estimate_speed_error_m_s": "velocity",
    "estimate_heading_error_deg": "attitude",
}
CLEARANCE = SignalKind(
    "m", "distance to the nearest object; floors count between at_height and land", 0.0
)
FENCE_MARGIN = SignalKind("m", "distance to its geofence, negative outside (if there is one)")
GOAL_DISTANCE = SignalKind("m", "distance to the goal's position (if it has one)", least=0.0)
TWIN_DISTANCE_NAME = "twin_distance_m"
TWIN_DISTANCE = SignalKind("m", "distance between real and twin (in mode wil)", least=0.0)
SILENCE = SignalKind("s", "time since something was last received from it", least=0.0)
THING_DISTANCE = SignalKind("m", "distance to one object of the world, by its name", least=0.0)


def signal_docs() -> dict[str, SignalKind]:
    """Return the documentation of every STL signal, also those of some campaigns only."""
    return {
        **{name: kind for name, (kind, _) in _OF_POSE.items()},
        "clearance_m": CLEARANCE,
        "distance_<thing>_m": THING_DISTANCE,
        "fence_margin_m": FENCE_MARGIN,
        "goal_distance_m": GOAL_DISTANCE,
        TWIN_DISTANCE_NAME: TWIN_DISTANCE,
        "silence_s": SILENCE,
        **{name: kind for name, (kind, _) in _OF_ESTIMATE.items()},
        **{name: kind for name, (kind, _) in _OF_STATE.items()},
    }


def reports_of(names: Iterable[str]) -> frozenset[ReportName]:
    """Return which reports of a vehicle its STL signals need."""
    return frozenset(_REPORTS.get(name, "heartbeat") for name in names if name in _OF_STATE)


def motion_needs_of(names: Iterable[str]) -> frozenset[MotionName]:
    """Return what the STL signals need of a pose besides the position."""
    return frozenset(_MOTION[name] for name in names if name in _MOTION)


def signals_of(context: OracleContext, stages: StageTracker) -> dict[str, StlSignal]:
    """Return the STL signals of one vehicle in one run. stages: of the oracle."""
    found = {name: StlSignal(kind, of_pose=of) for name, (kind, of) in _OF_POSE.items()}
    found |= {name: StlSignal(kind, of_state=of) for name, (kind, of) in _OF_STATE.items()}
    found |= {
        name: StlSignal(kind, of_reference=partial(_estimate_error, context.pose_source, of))
        for name, (kind, of) in _OF_ESTIMATE.items()
    }
    found["silence_s"] = StlSignal(SILENCE, of_silence=True)
    if (probe_of := context.probe_of) is not None and context.things:
        found["clearance_m"] = StlSignal(CLEARANCE, of_pose=_Nearest(context, stages))
        for thing in context.things:
            name = signals.distance_name(thing)
            of_pose = _Distance(thing, probe_of, context.events)
            found[name] = StlSignal(THING_DISTANCE, of_pose=of_pose)
    if context.fence is not None:
        found["fence_margin_m"] = StlSignal(FENCE_MARGIN, of_pose=FenceMarginSignal(context.fence))
    if context.target_ned_m is not None:
        target = context.target_ned_m
        found["goal_distance_m"] = StlSignal(
            GOAL_DISTANCE, of_pose=lambda s: norm(subtract(s.pose.position_ned_m, target))
        )
    if context.mode == "wil":
        found[TWIN_DISTANCE_NAME] = StlSignal(TWIN_DISTANCE, of_both=True)
    return found


def _estimate_error(
    pose_source: str, of: OfReference, judged: PoseSample, other: ReferenceSample
) -> float | None:
    """Return an error of the vehicle's estimate; None where the other source is none of it.

    The estimate is the other one, unless it judges itself: then the truth of a simulation is.
    """
    is_estimate = other.source == "mavlink"
    if not (is_estimate or (pose_source == "mavlink" and other.source in _TRUE_SOURCES)):
        return None
    return of(judged, other) if abs(judged.t_s - other.t_s) <= _COMPARED_WITHIN_S else None


class FenceMarginSignal:
    """The STL signal of the distance to the fence that applies now.

    Where the way from the last pose inside to this one led outside, the worst of the way.
    """

    def __init__(self, fence: Fence) -> None:
        self.fence = fence
        self._last: tuple[Fence, Vec3, float] | None = None

    def __call__(self, sample: PoseSample) -> float:
        """Return the fence margin of a pose as a signal value."""
        here, last = sample.pose.position_ned_m, self._last
        margin_m = self.fence.margin_m(here)
        self._last = (self.fence, here, margin_m)
        if last is not None and last[0] is self.fence:
            outside = self.fence.outside_between(last[1], here, (last[2], margin_m))
            if outside is not None:
                return outside[1]
        return margin_m


class _Distance:
    """The STL signal of the distance to one object at each pose.

    While it is not known where the object is, it stays; then the least of that time counts.
    """

    def __init__(
        self, thing: str, probe_of: Callable[[str], WorldProbe], events: Mapping[str, float]
    ) -> None:
        self._thing, self._probe_of, self._events = thing, probe_of, events
        self._probe: WorldProbe | None = None
        self._late = LateTracks(events)
        self._value: float | None = None

    def __call__(self, sample: PoseSample) -> float:
        poses = [then for name, _, then in self._late.due() if name == self._thing]
        if self._thing not in self._late.add(sample, sample):
            poses.append(sample)
        if poses or self._value is None:
            self._value = min(map(self._distance_m, poses or [sample]))
        return self._value

    def _distance_m(self, sample: PoseSample) -> float:
        if self._probe is None:
            self._probe = self._probe_of(self._thing)
        swept = self._probe.sweep(sample.pose, sample.t_s, sample.pose, sample.t_s, self._events)
        return max(0.0, min(each.clearance_m for each in swept))


class _Nearest:
    """The STL signal of the least clearance to any object since the last pose.

    To an object of which it is not known yet where it is, it counts once that is known.
    """

    def __init__(self, context: OracleContext, stages: StageTracker) -> None:
        self._context, self._stages = context, stages
        self._probes: dict[str, WorldProbe] = {}
        self._last: PoseSample | None = None
        self._late = LateTracks(context.events)

    def __call__(self, sample: PoseSample) -> float:
        context = self._context
        if not self._probes and context.probe_of is not None:
            self._probes = {thing: context.probe_of(thing) for thing in context.things}
        last, self._last = self._last or sample, sample
        judged = [one for one in self._late.due() if one.name in self._probes]
        later = self._late.add(last, sample)
        judged += [LateStretch(name, last, sample) for name in self._probes if name not in later]
        limits = ContactLimits()
        limits.below_m, limits.floors_ignored = _FARTHEST_M, self._stages.near_ground_at(sample.t_s)
        for name, first, then in judged:
            swept = self._probes[name].sweep(
                first.pose, first.t_s, then.pose, then.t_s, context.events, below_m=limits
            )
            limits.below_m = min([limits.below_m, *(each.clearance_m for each in swept)])
        return max(0.0, limits.below_m)


class PairDistanceSignal:
    """The STL signal of the distance between real and twin, the older pose extrapolated."""

    def __init__(self) -> None:
        self._last: dict[str, PoseSample] = {}

    def observe(self, sample: PoseSample) -> float | None:
        """Take a pose of either; return the pair's distance signal, None while one is unknown."""
        self._last[sample.vehicle] = sample
        other = self._last.get("twin" if sample.vehicle == "real" else "real")
        if other is None:
            return None
        return norm(subtract(sample.pose.position_ned_m, extrapolated_ned_m(other, sample.t_s)))
