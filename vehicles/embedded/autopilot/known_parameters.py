"""The names and defaults of the embedded autopilots' parameters, without building an autopilot."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import yaml

from vehicles.autopilots.autopilot import AutopilotName

_FILES: dict[AutopilotName, str] = {
    "px4": "px4/px4_parameters.yaml",
    "ardupilot": "copter/copter_parameters.yaml",
}


@cache
def parameter_rows(file: Path) -> Mapping[str, tuple[str, float]]:
    """Return the rows of a parameter file (`NAME: [kind, value]`); cached."""
    rows = yaml.safe_load(file.read_text(encoding="utf-8"))
    return MappingProxyType({name: (kind, float(value)) for name, (kind, value) in rows.items()})


@cache
def known_parameters(autopilot: AutopilotName) -> frozenset[str]:
    """Return the names of the parameters that an embedded autopilot has."""
    return frozenset(parameter_rows(Path(__file__).parent.joinpath(_FILES[autopilot])))
