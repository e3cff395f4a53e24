"""Builds the judge of a run: the campaign's oracles with the world that they judge against."""

from collections.abc import Mapping
from functools import partial

from orchestrator.run.judging.run_evidence import signal_terms
from orchestrator.state.run_setup import RunSetup
from safety.evaluation.judge import Judge, build_oracles
from safety.evidence.evidence import Evidence
from safety.oracles.gates import gates_of
from safety.oracles.oracle import OracleContext
from worlds.clearance.clearance import ClearanceProbe
from worlds.scene.parts import BoxShape
from worlds.scene.scene import Scene

_ANY_DISTANCE_M = 1e6


def build_judge(setup: RunSetup, events: Mapping[str, float]) -> Judge:
    """Return the judge of a run with its oracles. events: times of world events, set in flight."""
    scene = setup.judged_scene
    contexts: dict[str, OracleContext] = {
        vehicle.name: OracleContext(
            mode=setup.mode,
            subject=setup.subject,
            vehicle=vehicle.name,
            body_half_m=vehicle.body.half_m,
            start=vehicle.start,
            probe=ClearanceProbe(scene, vehicle.body),
            things=scene.names,
            probe_of=partial(_probe_of, scene, vehicle.body),
            gates=gates_of(scene),
            route=setup.campaign.goal.gates,
            target_ned_m=setup.campaign.goal.position_ned_m,
            fence=setup.campaign.fences.get(vehicle.name),
            frame=setup.campaign.world.frame,
            events=events,
        )
        for vehicle in setup.vehicles
    }
    campaign = setup.campaign
    oracles = build_oracles(campaign.oracles, contexts, collision_always=campaign.collision_always)
    return Judge(oracles, Evidence(signal_terms(setup, oracles)))


def _probe_of(scene: Scene, body: BoxShape, name: str) -> ClearanceProbe:
    """Return a clearance probe of one object alone for an oracle, at any distance."""
    return ClearanceProbe(Scene((scene[name],)), body, within_m=_ANY_DISTANCE_M)
