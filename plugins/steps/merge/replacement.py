"""The merge by rule: one side's reading, or parts of it, in place of the other's."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part, closest_word
from wil_campaign.plugins.steps.filter.regions import (
    BoxPart,
    element_angles_of,
    is_in_sector,
    region_mask,
)
from wil_campaign.plugins.steps.merge.points import join_clouds, kept_points
from wil_campaign.plugins.steps.operations.quantities import quantities_of
from wil_campaign.recipes.model.registry import EVERY_SENSOR, StepContext, StepParameters, step
from wil_campaign.recipes.operations.masks import kept_elements
from wil_campaign.recipes.operations.optics import image_size_px
from wil_campaign.recipes.operations.step_parameters import IMAGE_SENSORS
from wil_campaign.recipes.steps.merge.overlays import refuse_mismatch
from wil_campaign.recipes.working import (
    AnyMasked,
    CannotMixError,
    Merge,
    Need,
    Side,
    Sides,
    refuse_other_elements,
)
from wil_campaign.vehicles.readings import (
    CameraReading,
    DepthReading,
    LidarPointsReading,
    LidarScanReading,
    Reading,
    sensor_names,
    sensor_type_of,
)

Bools = NDArray[np.bool_]


class SectorPart(Part):
    """The sector of a scan to replace: clockwise from the first, seen from above; 0 is forward.

    from_deg: its first direction, right of forward. to_deg: its last direction, right of forward.
    """

    from_deg: float
    to_deg: float


class ConditionPart(Part):
    """A replacement's condition: a quantity of a side's reading within limits.

    of: the side whose reading is measured. what: the measured quantity of that reading. above: the
    quantity has to be above this value. below: it has to be below this value.
    """

    of: Side
    what: str
    above: float | None = None
    below: float | None = None

    @model_validator(mode="after")
    def _some_limit(self) -> "ConditionPart":
        """Require a known quantity and a limit in a replacement's condition."""
        known = [name for kind in sensor_names() for name in quantities_of(kind)]
        if self.what not in known:
            message = f"unknown quantity '{self.what}'"
            raise KeyFaultError("what", message, closest_word(self.what, known))
        if self.above is None and self.below is None:
            raise ValueError("a condition needs 'above' or 'below'")
        return self


class ReplaceParameters(StepParameters):
    """source: the side whose reading replaces the other's, where all given keys hold.

    sector: of a lidar. region: of an image (fractions of its size). when: a condition. Of a
    filtered source only the kept elements replace.
    """

    shorthand = "source"

    source: Side = "twin"
    sector: SectorPart | None = None
    region: BoxPart | None = None
    when: ConditionPart | None = None

    def refuses(self, kind: str) -> str:
        """Return why a replacement rule makes no sense for a sensor type."""
        if self.sector is not None and kind not in ("lidar", "lidar_points"):
            return f"a sector applies to lidars, not to {kind}"
        if self.region is not None and kind not in IMAGE_SENSORS:
            return f"a region applies to images, not to {kind}"
        if self.when is not None and self.when.what not in quantities_of(kind):
            known = ", ".join(quantities_of(kind))
            return f"a {kind} has no '{self.when.what}' (it has {known})"
        return ""

    def covers_with(self) -> Side | None:
        """Return the source of a replacement without a rule."""
        rules = (self.sector, self.region, self.when)
        return self.source if all(rule is None for rule in rules) else None

    def needed(self) -> frozenset[Need]:
        """Return depth where a replacement's condition uses it."""
        asks = self.when is not None and self.when.what == "depth_m"
        return frozenset({"depth"}) if asks else frozenset()


@step("replace", stage="merge", sensors=EVERY_SENSOR, parameters=ReplaceParameters)
def replacement(parameters: ReplaceParameters, context: StepContext) -> Merge:  # noqa: ARG001 - the interface of steps
    """Replace one side's reading by the other's: all of it, in a sector or region, or by a rule.

    Per pixel, beam or point where the rule applies to elements, otherwise as a whole. Images of one
    size and camera, scans of the same beams; angles in degrees from forward to the right.
    """
    source: Side = parameters.source
    ground: Side = "real" if source == "twin" else "twin"

    def merge(sides: Sides) -> Reading:
        if source not in sides or ground not in sides:
            whole: Reading = next(iter(sides.values())).reading
            return whole
        rule = _rule(parameters, sides)
        return _replace_reading(sides[source], sides[ground], rule)

    return merge


@dataclass(frozen=True, slots=True)
class _Rule:
    """A replacement rule, evaluated. whole: whether it holds; elements: where, None: everywhere."""

    holds: bool
    elements: Bools | None
    sector: SectorPart | None


def _rule(parameters: ReplaceParameters, sides: Sides) -> _Rule:
    """Return the replacement rule evaluated on two readings."""
    reading = sides[parameters.source].reading
    parts: list[Bools] = []
    if parameters.sector is not None and isinstance(reading, LidarScanReading):
        sector = parameters.sector
        parts.append(is_in_sector(element_angles_of(reading), sector.from_deg, sector.to_deg))
    if parameters.region is not None and isinstance(reading, CameraReading | DepthReading):
        corners = parameters.region.corners()
        parts.append(region_mask(corners, image_size_px(reading), outside=False) != 0)
    holds = True
    if parameters.when is not None:
        found = _condition(parameters.when, sides)
        if isinstance(found, np.ndarray):
            parts.append(found)
        else:
            holds = found
    elements = None
    for part in parts:
        if elements is not None and elements.shape != part.shape:
            raise CannotMixError("mismatch", f"replace: {part.shape} beside {elements.shape}")
        elements = part if elements is None else elements & part
    return _Rule(holds, elements, parameters.sector)


def _condition(part: ConditionPart, sides: Sides) -> bool | Bools:
    reading = sides[part.of].reading
    values = quantities_of(sensor_type_of(reading))[part.what](reading)
    if values is None:
        raise CannotMixError("no_depth", f"replace: the reading of {part.of} has no {part.what}")
    found: Any = np.ones(np.shape(values), np.bool_)
    if part.above is not None:
        found = found & (np.asarray(values) > part.above)
    if part.below is not None:
        found = found & (np.asarray(values) < part.below)
    return np.asarray(found, np.bool_) if np.ndim(values) else bool(found)


def _replace_reading(source: AnyMasked, ground: AnyMasked, rule: _Rule) -> Reading:
    below: Reading = ground.reading
    if not rule.holds:
        return below
    if isinstance(below, LidarPointsReading):
        return _replace_points(source, ground, rule)
    where = rule.elements
    if isinstance(below, CameraReading | DepthReading):
        return _replace_in_image(source, ground, where)
    if isinstance(below, LidarScanReading):
        refuse_other_elements("replace", source.reading, below)
        chosen_beams = kept_elements(source) if where is None else where & kept_elements(source)
        ranges_m = np.where(chosen_beams, source.reading.ranges_m, below.ranges_m)
        return replace(below, ranges_m=ranges_m)
    whole: Reading = source.reading
    return whole if source.mask is None or source.mask.any() else below


def _replace_in_image(source: AnyMasked, ground: AnyMasked, where: Bools | None) -> Reading:
    refuse_mismatch(source, ground)
    below, above = ground.reading, source.reading
    chosen_px = kept_elements(source) if where is None else where & kept_elements(source)
    if isinstance(below, DepthReading):
        return replace(below, depth_m=np.where(chosen_px, above.depth_m, below.depth_m))
    image = below.image_bgr.copy()
    image[chosen_px] = above.image_bgr[chosen_px]
    made: CameraReading = replace(below, image_bgr=image)
    return made


def _replace_points(source: AnyMasked, ground: AnyMasked, rule: _Rule) -> LidarPointsReading:
    mount = ground.reading.mount
    new, old = kept_points(source, mount), kept_points(ground, mount)
    if rule.sector is None:
        return join_clouds(ground.reading, [new])
    ends = rule.sector.from_deg, rule.sector.to_deg
    inside, outside = (
        is_in_sector(element_angles_of(new), *ends),
        ~is_in_sector(element_angles_of(old), *ends),
    )
    parts = [
        replace(part, points_frd_m=part.points_frd_m[keep], object_ids=None)
        for part, keep in ((old, outside), (new, inside))
    ]
    return join_clouds(ground.reading, parts)
