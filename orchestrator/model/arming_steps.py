"""The steps before arming, as a run's result lists them."""

from dataclasses import dataclass
from typing import Literal

StepName = Literal["parameters", "fence", "actor", "external", "anchor", "preflight"]


@dataclass(frozen=True, slots=True)
class ArmingStep:
    """One step before arming in a run's result.

    vehicle: empty for a step of all. at_s: when it ended, run clock. ok: False for the step that
    failed and prevented arming. text: what was set or checked, or the error. restored: whether an
    attached vehicle got its own configuration back; None where nothing is restored.
    """

    step: StepName
    vehicle: str
    at_s: float
    ok: bool
    text: str
    restored: bool | None = None
