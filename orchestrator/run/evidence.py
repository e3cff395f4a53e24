"""The signals that a run is judged by, and what is expected of each."""

from collections.abc import Iterable, Iterator

from campaigns.setup import VehicleSetup
from orchestrator.run.setup import RunSetup
from safety.evidence.evidence import POSE
from safety.evidence.terms import SignalTerms, position_limit_s
from safety.oracles.base import Oracle

JUDGED_EVERY_S = 0.018
"""50 poses a second are judged: between two, a vehicle that brakes at 3 m/s^2 leaves the straight
way that is swept by a dt^2 / 8 = 0.15 mm, less than the tolerance of 1 mm of a clearance."""


def signal_terms(setup: RunSetup, oracles: Iterable[Oracle]) -> Iterator[SignalTerms]:
    """Yield the signals of the vehicles that fly; required are those of required oracles."""
    judges = tuple(oracles)
    for vehicle in setup.vehicles:
        yield SignalTerms(
            signal=POSE,
            vehicle=vehicle.name,
            source=vehicle.pose_source,
            limit_s=_pose_limit_s(setup, vehicle),
            required=any(_rests_on_pose(one, vehicle.name) for one in judges),
            over_link=vehicle.pose_source == "mavlink",
        )


def _pose_limit_s(setup: RunSetup, vehicle: VehicleSetup) -> float:
    if vehicle.pose_source == "mavlink":
        rate_hz, declared_s = vehicle.rates.position_hz, vehicle.max_gap_s
    elif vehicle.mocap is not None:
        return vehicle.mocap.stall_s
    else:
        rate_hz, declared_s = setup.profiles[vehicle.name].mocap.rate_hz, None
    return declared_s or position_limit_s(rate_hz, judged_every_s=JUDGED_EVERY_S)


def _rests_on_pose(oracle: Oracle, vehicle: str) -> bool:
    watches = type(oracle).on_pose is not Oracle.on_pose
    return oracle.required and watches and vehicle in oracle.watches
