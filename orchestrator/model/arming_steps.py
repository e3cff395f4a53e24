"""What was done to a run's vehicles before they armed, as results have it."""

from dataclasses import dataclass
from typing import Literal

StepName = Literal["parameters", "fence", "actor", "external", "anchor", "preflight"]


@dataclass(frozen=True, slots=True)
class ArmingStep:
    """One step before arming in a run's result.

    vehicle: empty for a step of all. at_s: when it ended, run clock. ok: False for the one that
    kept the vehicles from arming. text: what was set, proven or found, else the error. restored:
    whether an attached vehicle has its own again; None where nothing is set back.
    """

    step: StepName
    vehicle: str
    at_s: float
    ok: bool
    text: str
    restored: bool | None = None
