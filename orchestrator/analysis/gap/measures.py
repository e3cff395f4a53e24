"""How far two flights are apart, as a whole and by where that arises; pure.

behaviour: where the vehicle was. Along the alignment of dynamic time warping, that is where both
flights were at matching places: perception, how differently the autonomy commanded there (it is the
same program, so what differs is what it perceived), and actuation, how differently the vehicle
answered what it was commanded. The split is that of Lambertenghi, Flores Valdez and Stocco
(arXiv 2509.22379), in quantities that every recorded flight has.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.statistics.trajectory_distances import (
    alignment,
    dtw_m,
    frechet_m,
    time_aligned_rmse_m,
)
from orchestrator.analysis.gap.motion import RunMotion
from worlds.jit import F64

Part = Literal["behaviour", "perception", "actuation"]


@dataclass(frozen=True, slots=True)
class Measure:
    """A distance between two flights. between: None where one of them did not record it."""

    name: str
    part: Part
    text: str
    between: Callable[[RunMotion, RunMotion], float | None]


def _command_difference(one: RunMotion, other: RunMotion) -> float | None:
    return _rms_along(one, other, one.commands, other.commands)


def _answer_difference(one: RunMotion, other: RunMotion) -> float | None:
    first, second = one.answers - one.commands, other.answers - other.commands
    return _rms_along(one, other, first, second)


def _rms_along(one: RunMotion, other: RunMotion, first: F64, second: F64) -> float | None:
    """Return the root mean square difference of two quantities at matching places."""
    if not one.kind or one.kind != other.kind:
        return None
    ours, theirs = alignment(one.positions_ned_m, other.positions_ned_m)
    return float(np.sqrt(np.mean(np.sum((first[ours] - second[theirs]) ** 2, axis=1))))


MEASURES = (
    Measure(
        "dtw",
        "behaviour",
        "mean distance of aligned paths, m (dynamic time warping)",
        lambda one, other: dtw_m(one.positions_ned_m, other.positions_ned_m),
    ),
    Measure(
        "frechet",
        "behaviour",
        "largest distance of aligned paths, m (discrete Frechet)",
        lambda one, other: frechet_m(one.positions_ned_m, other.positions_ned_m),
    ),
    Measure(
        "rmse",
        "behaviour",
        "root mean square distance at equal times, m",
        lambda one, other: time_aligned_rmse_m(one.positions_ned_m, other.positions_ned_m),
    ),
    Measure(
        "commands",
        "perception",
        "difference of the autonomy's commands at matching places, m/s or m",
        _command_difference,
    ),
    Measure(
        "answers",
        "actuation",
        "difference of the vehicle's answer to its commands, m/s or m",
        _answer_difference,
    ),
)
