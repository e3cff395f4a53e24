"""Merge of points: those of both sides in one cloud."""

from dataclasses import replace

import numpy as np

from wil_campaign.plugins.steps.transform.frames import remounted_points
from wil_campaign.recipes.model.registry import StepContext, StepParameters, step
from wil_campaign.recipes.operations.masks import kept_elements
from wil_campaign.recipes.working import AnyMasked, Merge, Sides
from wil_campaign.vehicles.readings import LidarPointsReading
from wil_campaign.worlds.frames import Pose


class ConcatenateParameters(StepParameters):
    """Parameters of merging point clouds: none."""


@step("concatenate", stage="merge", sensors=("lidar_points",), parameters=ConcatenateParameters)
def concatenate(parameters: ConcatenateParameters, context: StepContext) -> Merge:  # noqa: ARG001 - the interface of steps
    """Put the kept points of both sides into one cloud, in the frame of the real sensor.

    points_frd_m (n, 3) and (m, 3) float32 metres to (n + m, 3), the real ones first. The twin's
    are moved when its sensor is mounted elsewhere.
    """

    def merge(sides: Sides) -> LidarPointsReading:
        real: LidarPointsReading = sides["real"].reading
        parts = [kept_points(sides[side], real.mount) for side in ("real", "twin") if side in sides]
        return join_clouds(real, parts)

    return merge


def kept_points(work: AnyMasked, mount: Pose) -> LidarPointsReading:
    """Return the kept points of a side, in the frame of a sensor mounted at `mount`."""
    reading: LidarPointsReading = remounted_points(work.reading, mount)
    if work.mask is None:
        return reading
    keep = kept_elements(work)
    ids = None if reading.object_ids is None else reading.object_ids[keep]
    return replace(reading, points_frd_m=reading.points_frd_m[keep], object_ids=ids)


def join_clouds(real: LidarPointsReading, parts: list[LidarPointsReading]) -> LidarPointsReading:
    """Return the points of several clouds in the same frame as one cloud."""
    points = np.concatenate([part.points_frd_m for part in parts])
    return replace(real, points_frd_m=points, object_ids=None, mount=parts[0].mount)
