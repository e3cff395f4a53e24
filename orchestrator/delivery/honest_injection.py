"""The one question of honest injection, for both autopilots; pure."""

from collections.abc import Mapping

from orchestrator.delivery.honoured import (
    Ignored,
    Rules,
    Setpoints,
    Situation,
    Thing,
    broken_rules,
)
from orchestrator.delivery.honoured_ardupilot import ARDUPILOT
from orchestrator.delivery.honoured_px4 import PX4
from vehicles.autopilots.base import AutopilotName

_RULES: Mapping[AutopilotName, Rules] = {"ardupilot": ARDUPILOT, "px4": PX4}


def honoured(
    autopilot: AutopilotName,
    thing: Thing,
    parameters: Mapping[str, float],
    mode: str,
    *,
    setpoints: Setpoints = "velocity",
) -> tuple[Ignored, ...]:
    """Return every reason why an injected thing would be ignored; empty when it is acted on.

    parameters: all that the autopilot reported. mode: that it will fly in, by its own name.
    setpoints: what the autonomy sends in guided flight.
    """
    return broken_rules(_RULES[autopilot], thing, Situation(parameters, mode, setpoints))
