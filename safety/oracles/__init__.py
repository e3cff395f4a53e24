"""Oracles: what a campaign may have judged; importing this fills the registry."""

from safety.oracles import (
    area,
    contact,
    distance,
    goal,
    health,
    motion,
    pair,
    reached,
    stl,
    vehicle,
)
from safety.oracles.base import (
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
    "contact",
    "distance",
    "goal",
    "health",
    "motion",
    "pair",
    "reached",
    "registry",
    "stl",
    "vehicle",
]
