"""The names and defaults of the embedded autopilots' parameters, without building an autopilot."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

import yaml

from wil_campaign.vehicles.autopilots.registry import autopilot_named


@cache
def _file_rows(file: Path) -> Mapping[str, list[str | float]]:
    rows: dict[str, list[str | float]] = yaml.safe_load(file.read_text(encoding="utf-8"))
    return MappingProxyType(rows)


@cache
def parameter_rows(file: Path) -> Mapping[str, tuple[str, float]]:
    """Return kind and default by name of a parameter file (`NAME: [kind, default]`); cached."""
    rows = _file_rows(file)
    return MappingProxyType({name: (str(row[0]), float(row[1])) for name, row in rows.items()})


@cache
def unused_rows(file: Path) -> Mapping[str, float | None]:
    """Return the parameters of a file that nothing acts on (`NAME: [kind, default, unused]`).

    By name the value that the vehicle flies by whatever is set; None where there is none.
    """
    rows = {name: row[2] for name, row in _file_rows(file).items() if row[2:]}
    return MappingProxyType(
        {name: None if value == "unused" else float(value) for name, value in rows.items()}
    )


def unused_parameters(autopilot: str) -> Mapping[str, float | None]:
    """Return `unused_rows` of an embedded autopilot."""
    return unused_rows(autopilot_named(autopilot).embedded_parameters)


def default_parameters(autopilot: str) -> Mapping[str, float]:
    """Return the parameters of an embedded autopilot with their defaults, by name."""
    rows = parameter_rows(autopilot_named(autopilot).embedded_parameters)
    return {name: value for name, (_, value) in rows.items()}


@cache
def known_parameters(autopilot: str) -> frozenset[str]:
    """Return the names of the parameters that an embedded autopilot has."""
    return frozenset(parameter_rows(autopilot_named(autopilot).embedded_parameters))
