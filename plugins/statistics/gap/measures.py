"""Distance measures between two flights: behaviour, perception, actuation; pure.

behaviour: the positions of the vehicle. perception and actuation are measured along the alignment
of dynamic time warping, where both flights were at matching places. perception: the difference of
the autonomy's commands (it is the same program, so its perception differs). actuation: the
difference of the vehicle's response to its commands. The split is that of Lambertenghi, Flores
Valdez and Stocco (arXiv 2509.22379), in quantities that every recorded flight has.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wil_campaign.plugins.statistics.gap.motion import RunMotion
from wil_campaign.plugins.statistics.gap.trajectory_distances import (
    cheapest_alignment,
    dtw_distance_m,
    frechet_distance_m,
    time_aligned_rmse_m,
)
from wil_campaign.worlds.jit import F64

Part = Literal["behaviour", "perception", "actuation"]


@dataclass(frozen=True, slots=True)
class FlightMeasure:
    """A distance between two flights. between: None where a flight did not record it."""

    name: str
    part: Part
    text: str
    between: Callable[[RunMotion, RunMotion], float | None]


def _command_difference(one: RunMotion, other: RunMotion) -> float | None:
    return _rms_along(one, other, one.commands, other.commands)


def _response_difference(one: RunMotion, other: RunMotion) -> float | None:
    first, second = one.answers - one.commands, other.answers - other.commands
    return _rms_along(one, other, first, second)


def _rms_along(one: RunMotion, other: RunMotion, first: F64, second: F64) -> float | None:
    """Return the root mean square difference of two quantities at matching places."""
    if not one.kind or one.kind != other.kind:
        return None
    places, others = cheapest_alignment(one.positions_ned_m, other.positions_ned_m)
    return float(np.sqrt(np.mean(np.sum((first[places] - second[others]) ** 2, axis=1))))


MEASURES = (
    FlightMeasure(
        "dtw",
        "behaviour",
        "mean distance of aligned paths, m (dynamic time warping)",
        lambda one, other: dtw_distance_m(one.positions_ned_m, other.positions_ned_m),
    ),
    FlightMeasure(
        "frechet",
        "behaviour",
        "largest distance of aligned paths, m (discrete Frechet)",
        lambda one, other: frechet_distance_m(one.positions_ned_m, other.positions_ned_m),
    ),
    FlightMeasure(
        "rmse",
        "behaviour",
        "root mean square distance at equal times, m",
        lambda one, other: time_aligned_rmse_m(one.positions_ned_m, other.positions_ned_m),
    ),
    FlightMeasure(
        "commands",
        "perception",
        "difference of the autonomy's commands at matching places, m/s or m",
        _command_difference,
    ),
    FlightMeasure(
        "answers",
        "actuation",
        "difference of the vehicle's response to its commands, m/s or m",
        _response_difference,
    ),
)
