"""Which parameters the embedded autopilots have, without building one."""

from functools import cache
from pathlib import Path

import yaml

from vehicles.autopilots.autopilot import AutopilotName

_FILES: dict[AutopilotName, str] = {
    "px4": "px4/px4_parameters.yaml",
    "ardupilot": "copter/copter_parameters.yaml",
}


@cache
def known_parameters(autopilot: AutopilotName) -> frozenset[str]:
    """Return the names of the parameters that an embedded autopilot has."""
    file = Path(__file__).parent.joinpath(_FILES[autopilot])
    return frozenset(yaml.safe_load(file.read_text(encoding="utf-8")))
