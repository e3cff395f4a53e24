"""The close-up plot of the value that violated its limit; pure."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from wil_campaign.foundation.files.documents import Data
from wil_campaign.orchestrator.reading.judged_motion import JudgedMotion
from wil_campaign.orchestrator.report.model import Closeup, Plot, Point, VerdictCause
from wil_campaign.orchestrator.report.reading.curves import curve_of
from wil_campaign.orchestrator.report.reading.distances import TimedFences, fence_at
from wil_campaign.orchestrator.report.reading.held_limits import HeldLimit
from wil_campaign.orchestrator.report.reading.world_facts import recorded_body
from wil_campaign.safety.model import signals
from wil_campaign.safety.model.oracle_results import OracleResult
from wil_campaign.safety.model.samples import PoseSample
from wil_campaign.safety.oracles.contact import ContactLimits
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.scene.scene import Scene

_BEFORE_S, _AFTER_S = 1.0, 1.5
_LONGEST_S = 20.0
_MOST_POINTS = 300
_NEAR = 0.02
"""Relative tolerance between recomputed and judged value; a larger difference is not shown."""
_FAR_M = 1e4

_OF_POSE: Mapping[str, Callable[[PoseSample], float]] = {
    "north_m": signals.north_m,
    "east_m": signals.east_m,
    "up_m": signals.up_m,
    "speed_m_s": signals.speed_m_s,
    "ground_speed_m_s": signals.ground_speed_m_s,
    "vertical_speed_m_s": signals.vertical_speed_m_s,
    "climb_m_s": signals.climb_m_s,
    "roll_deg": signals.roll_deg,
    "pitch_deg": signals.pitch_deg,
    "yaw_deg": signals.yaw_deg,
    "tilt_deg": signals.tilt_deg,
}
_TITLES = {"up_m": "height", "clearance_m": "clearance", "fence_margin_m": "margin to the fence"}


@dataclass(frozen=True, slots=True)
class JudgedFlight:
    """Input to recompute the values of a flight. fences: by vehicle. campaign: as flown."""

    motion: JudgedMotion
    scene: Scene
    fences: Mapping[str, TimedFences]
    campaign: Mapping[str, Data] = field(default_factory=dict)


def closeup_of(
    cause: VerdictCause | None,
    oracle: OracleResult | None,
    limits: Sequence[HeldLimit],
    flight: JudgedFlight,
) -> Closeup | None:
    """Return the violated value over the time of its limit; None where it is not recorded.

    It is recomputed from the judged poses, and shown only if it matches the judged value.
    """
    if cause is None or cause.at_s is None or oracle is None or oracle.actual is None:
        return None
    for limit in limits:
        if limit.oracle == oracle.name and oracle.detail.startswith(limit.text):
            found = _closeup(limit, cause.at_s, oracle, flight)
            if found is not None:
                return found
    return None


def _closeup(
    limit: HeldLimit, crossed_s: float, oracle: OracleResult, flight: JudgedFlight
) -> Closeup | None:
    value_of = _values_of(limit.signal, oracle.vehicle, flight)
    poses = flight.motion.poses.get(oracle.vehicle, [])
    velocities = flight.motion.velocities.get(oracle.vehicle, [])
    if value_of is None or not poses:
        return None
    begin_s, end_s = _shown_span(limit, crossed_s, oracle.at_s)
    samples = [
        PoseSample(t_s, oracle.vehicle, pose, velocity)
        for (t_s, pose), velocity in zip(poses, velocities, strict=False)
        if begin_s <= t_s <= end_s
    ]
    every = max(1, math.ceil(len(samples) / _MOST_POINTS))
    points = tuple((sample.t_s, value_of(sample)) for sample in samples[::every])
    judged = [point for point in points if limit.span_s[0] <= point[0] <= limit.span_s[1]]
    if not judged:
        return None
    worst = max(judged, key=lambda one: limit.excess(one[1]))
    is_same = abs(worst[1] - (oracle.actual or 0.0)) <= _NEAR * max(1.0, abs(worst[1]))
    if limit.excess(worst[1]) <= 0.0 or not is_same:
        return None
    title = _TITLES.get(limit.signal, limit.signal)
    curves = (curve_of(oracle.vehicle, points),)
    plot = Plot(title, oracle.unit, curves, (limit.line,), judged=oracle.vehicle)
    return Closeup(plot, (points[0][0], points[-1][0]), crossed_s, worst)


def _shown_span(limit: HeldLimit, crossed_s: float, worst_s: float | None) -> Point:
    """Return the interval of the limit if it is short, else the time around the violation."""
    first_s, last_s = limit.span_s
    if not limit.is_whole and last_s - first_s <= _LONGEST_S:
        return first_s - _BEFORE_S, last_s + _AFTER_S
    last_s = max(crossed_s, worst_s or crossed_s)
    return crossed_s - 2.0 * _BEFORE_S, min(last_s, crossed_s + _LONGEST_S) + _AFTER_S


def _values_of(
    signal: str, vehicle: str, flight: JudgedFlight
) -> Callable[[PoseSample], float] | None:
    """Return the function from pose to a signal's value; None if poses do not determine it."""
    if signal in _OF_POSE:
        return _OF_POSE[signal]
    if signal == "fence_margin_m" and vehicle in flight.fences:
        fences = flight.fences[vehicle]
        return lambda sample: _fence_margin_m(fences, sample)
    names = [
        name
        for name in flight.scene.names
        if signal in {"clearance_m", signals.distance_name(name), f"distance to {name}"}
    ]
    if not names:
        return None
    return _distance_to(names, vehicle, flight, spares_floors=signal == "clearance_m")


def _fence_margin_m(fences: TimedFences, sample: PoseSample) -> float:
    """Return the distance to the boundary of the fence of that time; NaN before the first."""
    fence = fence_at(fences, sample.t_s)
    return math.nan if fence is None else fence.margin_m(sample.pose.position_ned_m)


def _distance_to(
    names: Sequence[str], vehicle: str, flight: JudgedFlight, *, spares_floors: bool
) -> Callable[[PoseSample], float]:
    """Return the distance from the body to the nearest of some objects.

    spares_floors: floors count between at_height and land only.
    """
    others = [name for name in flight.scene.names if name not in names]
    body, motion = recorded_body(flight.campaign, vehicle), flight.motion
    probe = ClearanceProbe(flight.scene, body, exclude=others, within_m=_FAR_M)
    limits = ContactLimits()
    limits.below_m = _FAR_M

    def distance(sample: PoseSample) -> float:
        at, t_s = sample.pose, sample.t_s
        limits.floors_ignored = spares_floors and motion.near_ground_at(t_s)
        found = probe.sweep(at, t_s, at, t_s, motion.world_events, below_m=limits)
        return max(0.0, min((clearance.clearance_m for clearance in found), default=_FAR_M))

    return distance
