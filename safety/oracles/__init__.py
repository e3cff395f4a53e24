"""Oracles: the checks that a campaign may name; importing this package fills the registry."""

from safety.oracles import (
    area,
    autopilot_health,
    contact,
    distance,
    goal,
    motion,
    pair,
    reached,
    stl,
    vehicle_health,
)
from safety.oracles.oracle import (
    Oracle,
    OracleContext,
    OracleError,
    OracleSpec,
    Parameters,
    RunMode,
    registry,
)

__all__ = [
    "Oracle",
    "OracleContext",
    "OracleError",
    "OracleSpec",
    "Parameters",
    "RunMode",
    "area",
    "autopilot_health",
    "contact",
    "distance",
    "goal",
    "motion",
    "pair",
    "reached",
    "registry",
    "stl",
    "vehicle_health",
]
