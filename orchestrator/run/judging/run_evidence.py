"""Evidence terms of a run: the signals that it is judged by, and the requirements on each."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import get_args

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.campaigns.values.external_setups import (
    CAPTURED,
    ESTIMATED,
    SIMULATED,
    PoseAccuracy,
)
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.evidence.agreement import SourceAccuracy
from wil_campaign.safety.evidence.evidence import POSE, VELOCITY
from wil_campaign.safety.evidence.terms import (
    MOST_GAP_S,
    SignalTerms,
    position_limit_s,
    status_limit_s,
)
from wil_campaign.safety.oracles.oracle import MotionName, Oracle
from wil_campaign.safety.oracles.oracle_terms import STAGES, StageWindow
from wil_campaign.vehicles.autopilots.autopilot import TelemetryRates
from wil_campaign.vehicles.driver.vehicle_state import ReportName

JUDGED_EVERY_S = 0.018
"""50 poses a second are judged, as JudgedTimes selects them. Between two a vehicle that brakes at
3 m/s^2 deviates from the swept straight line by a dt^2 / 8 = 0.15 mm, less than the tolerance of a
clearance, 1 mm."""
_HEARTBEAT_HZ = 1.0
_OVER_LINK = frozenset({"mavlink", "simulator"})
"""Sources of poses that come over the vehicle's link, as often as its positions."""
_SOURCES: Mapping[str, PoseAccuracy] = {
    "mavlink": ESTIMATED,
    "mocap": CAPTURED,
    "truth": PoseAccuracy(position_m=0.0, attitude_rad=0.0),
    "simulator": SIMULATED,
}
"""Accuracy of each pose source, unless the campaign states it."""


def signal_terms(setup: RunSetup, oracles: Iterable[Oracle]) -> Iterator[SignalTerms]:
    """Yield the evidence terms of a run's signals; those of required oracles are required."""
    all_oracles = tuple(oracles)
    for vehicle in setup.vehicles:
        pose = _pose_terms(setup, vehicle, all_oracles)
        yield pose
        yield from _motion_terms(pose, all_oracles)
        yield from _report_terms(vehicle, all_oracles)


def _pose_terms(setup: RunSetup, vehicle: VehicleSetup, oracles: Iterable[Oracle]) -> SignalTerms:
    source = vehicle.pose_source
    return SignalTerms(
        signal=POSE,
        vehicle=vehicle.name,
        source=source,
        limit_s=_pose_limit_s(setup, vehicle),
        required=any(_rests_on_pose(oracle, vehicle.name) for oracle in oracles),
        over_link=source in _OVER_LINK,
        on_grid=source == "simulator",
        by_estimate=source == "mavlink",
        permits_dead_reckoning=vehicle.permits_dead_reckoning,
        accuracy=_accuracy(vehicle.pose_accuracy),
        references=_references(source),
    )


def _references(source: str) -> dict[str, SourceAccuracy]:
    """Return the accuracy of the other sources of a vehicle's pose, by source.

    The velocity of an estimate is not compared with the simulator's ground truth: where the
    estimate steps, as estimators do, the judged truth is right, and its error is only reported.
    """
    references = {
        name: _accuracy(pose_accuracy) for name, pose_accuracy in _SOURCES.items() if name != source
    }
    if source == "simulator":
        references["mavlink"] = replace(references["mavlink"], velocity_m_s=None)
    return references


def _motion_terms(pose: SignalTerms, oracles: Iterable[Oracle]) -> Iterator[SignalTerms]:
    """Yield the evidence terms of a vehicle's velocity and attitude where an oracle judges them.

    Positions and velocities of a simulator's ground truth come from different parts of it. The
    velocity is always compared with the positions: it shows when these are frozen.
    """
    using = [oracle for oracle in oracles if pose.vehicle in oracle.watches]
    for part in get_args(MotionName):
        windows = [one.terms.window for one in using if part in one.motion]
        required = any(one.required and part in one.motion for one in using)
        if part == VELOCITY and pose.on_grid:
            yield replace(pose, signal=part, required=required or pose.required)
        elif windows:
            yield replace(pose, signal=part, required=required, window=_widest(windows))


def _report_terms(vehicle: VehicleSetup, oracles: Iterable[Oracle]) -> Iterator[SignalTerms]:
    using = [oracle for oracle in oracles if oracle.vehicle == vehicle.name]
    for report, rate_hz in _rates(vehicle.rates).items():
        windows = [one.terms.window for one in using if report in one.reports]
        if not windows:
            continue
        yield SignalTerms(
            signal=report,
            vehicle=vehicle.name,
            source="mavlink",
            limit_s=max(status_limit_s(rate_hz), vehicle.max_gap_s or 0.0),
            required=any(one.required and report in one.reports for one in using),
            over_link=True,
            window=_widest(windows),
        )


def _rates(rates: TelemetryRates) -> Mapping[ReportName, float]:
    return {
        "heartbeat": _HEARTBEAT_HZ,
        "landed_state": rates.state_hz,
        "battery": rates.status_hz,
        "estimator": rates.status_hz,
    }


def _widest(windows: Iterable[StageWindow]) -> StageWindow:
    """Return the evidence window from the earliest first to the latest last stage, until landed."""
    known = tuple(windows)
    first = min((window.first for window in known), key=STAGES.index)
    last = max((window.last for window in known), key=STAGES.index)
    return StageWindow(first, "landed" if last == "end" else last)


def _pose_limit_s(setup: RunSetup, vehicle: VehicleSetup) -> float:
    """Return the longest gap of a vehicle's poses that the evidence accepts."""
    if vehicle.pose_source in _OVER_LINK:
        rate_hz, declared_s = vehicle.rates.position_hz, vehicle.max_gap_s
    elif vehicle.mocap is not None:
        return vehicle.mocap.stall_s
    else:
        rate_hz, declared_s = setup.profiles[vehicle.name].mocap.rate_hz, None
    return declared_s or position_limit_s(rate_hz, judged_every_s=JUDGED_EVERY_S)


def pair_gap_s(setup: RunSetup) -> float:
    """Return the longest accepted gap in the distance of real and twin: that of their poses."""
    return max(MOST_GAP_S, *(_pose_limit_s(setup, vehicle) for vehicle in setup.vehicles))


def _accuracy(accuracy: PoseAccuracy) -> SourceAccuracy:
    return SourceAccuracy(accuracy.position_m, accuracy.velocity_m_s, accuracy.attitude_rad)


def _rests_on_pose(oracle: Oracle, vehicle: str) -> bool:
    watches = type(oracle).on_pose is not Oracle.on_pose
    return oracle.required and watches and vehicle in oracle.watches
