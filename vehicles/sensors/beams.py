"""Beams of sensors that measure ranges, and what they hit in a scene."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wil_campaign.vehicles.readings import ObjectIds, Ranges
from wil_campaign.worlds.frames import Pose

Directions = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RayHits:
    """The hits of beams. ranges_m: (beams,) float32, inf for none; object_ids: (beams,) uint8."""

    ranges_m: Ranges
    object_ids: ObjectIds


@dataclass(frozen=True, slots=True)
class BeamFan:
    """The beams of a sensor that looks around, in columns from its left to its right.

    directions: (beams, 3) unit vectors in the sensor's FRD frame; columns: (beams,) the number of
    the column of each, below `count`.
    """

    directions: Directions
    columns: NDArray[np.int64]
    count: int


class RayCaster(Protocol):
    """Casts a sensor's beams into a scene with its events (protocol)."""

    def __call__(self, sensor: Pose, directions_frd: Directions, t_s: float) -> RayHits:
        """Return what the beams hit at t_s.

        sensor: its pose in the world's local frame (NED metres). directions_frd: (beams, 3) unit
        vectors in the sensor's frame.
        """
