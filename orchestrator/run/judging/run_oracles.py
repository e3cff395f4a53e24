"""Builds the judge of a run: the campaign's oracles with the world that they judge against."""

from collections.abc import Mapping
from functools import partial

from wil_campaign.campaigns.setup.case_setup import VehicleSetup
from wil_campaign.orchestrator.run.judging.run_evidence import signal_terms
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.safety.evaluation.judge import Judge, build_oracles
from wil_campaign.safety.evidence.evidence import Evidence
from wil_campaign.safety.oracles.gates import gates_of
from wil_campaign.safety.oracles.oracle import OracleContext
from wil_campaign.worlds.clearance.clearance import ClearanceProbe
from wil_campaign.worlds.scene.parts import BoxShape
from wil_campaign.worlds.scene.scene import Scene

_ANY_DISTANCE_M = 1e6
_BENEATH_FLOOR_M = 0.01
"""More than floors and ground differ by rounding: within a room, its floor is the nearer one."""


def build_judge(setup: RunSetup, events: Mapping[str, float]) -> Judge:
    """Return the judge of a run with its oracles. events: times of world events, set in flight."""
    scene = setup.judged_scene
    contexts: dict[str, OracleContext] = {
        vehicle.name: OracleContext(
            mode=setup.mode,
            subject=setup.subject,
            vehicle=vehicle.name,
            pose_source=vehicle.pose_source,
            body_half_m=vehicle.body.half_m,
            start=vehicle.start,
            probe=ClearanceProbe(scene, vehicle.body),
            ground_down_m=_ground_down_m(setup, vehicle),
            touchdown_m_s=_touchdown_m_s(setup, vehicle),
            things=scene.names,
            probe_of=partial(_probe_of, scene, vehicle.body),
            gates=gates_of(scene),
            route=setup.case.goal.gates,
            target_ned_m=setup.case.goal.position_ned_m,
            fence=setup.case.fences.get(vehicle.name),
            frame=setup.case.world.frame,
            events=events,
        )
        for vehicle in setup.vehicles
    }
    campaign = setup.case
    oracles = build_oracles(campaign.oracles, contexts, collision_always=campaign.collision_always)
    return Judge(oracles, Evidence(signal_terms(setup, oracles)))


def _ground_down_m(setup: RunSetup, vehicle: VehicleSetup) -> float:
    """Return the height (NED, metres) of the ground beneath a vehicle.

    It is what the world file states, else beneath the lowest floor of a room, else where the
    vehicle stands before it takes off.
    """
    stated_m, floor_m = setup.case.world.ground_down_m, setup.judged_scene.floor_down_m
    if stated_m is not None:
        return stated_m
    return vehicle.start.position_ned_m[2] if floor_m is None else floor_m + _BENEATH_FLOOR_M


def _touchdown_m_s(setup: RunSetup, vehicle: VehicleSetup) -> float | None:
    """Return how fast a vehicle may sink as it lands by its profile; None where it has none."""
    return setup.profiles[vehicle.name].max_touchdown_m_s if vehicle.embedded else None


def _probe_of(scene: Scene, body: BoxShape, name: str) -> ClearanceProbe:
    """Return a clearance probe of one object alone for an oracle, at any distance."""
    return ClearanceProbe(Scene((scene[name],)), body, within_m=_ANY_DISTANCE_M)
