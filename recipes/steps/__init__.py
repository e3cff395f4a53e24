"""The built-in steps; importing this package registers them."""

from recipes.steps import own, sounds
from recipes.steps.filter import background, detections, isolation, outliers, ranges, regions
from recipes.steps.merge import aggregation, overlays, points, replacement
from recipes.steps.transform import (
    beams,
    colors,
    frames,
    geometry,
    holes,
    places,
    registration,
    timing,
    units,
)

__all__ = [
    "aggregation",
    "background",
    "beams",
    "colors",
    "detections",
    "frames",
    "geometry",
    "holes",
    "isolation",
    "outliers",
    "overlays",
    "own",
    "places",
    "points",
    "ranges",
    "regions",
    "registration",
    "replacement",
    "sounds",
    "timing",
    "units",
]
