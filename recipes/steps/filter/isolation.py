"""Filters that keep a part of a reading: by colour, or by a simulator's object ids."""

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field, field_validator, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part, Path, closest_word
from wil_campaign.recipes.model.registry import SidedParameters, StepContext, step
from wil_campaign.recipes.operations.masks import intersect_masks
from wil_campaign.recipes.working import AnyMasked, CannotMixError, Masked, Operator
from wil_campaign.vehicles.perception.hsv import FULL_CIRCLE_DEG, NAMED_COLORS, HsvMask, HsvRange
from wil_campaign.vehicles.readings import CameraReading, Mask

Fraction = Annotated[float, Field(ge=0, le=1)]
Degrees = Annotated[float, Field(ge=0, le=360)]
RadiusPx = Annotated[int, Field(ge=0, le=50)]
PAIR = Field(min_length=2, max_length=2)


class RangePart(Part):
    """A colour range to isolate: hue from the first to the second, clockwise, may wrap.

    hue_deg: [from, to] on the circle of hues, red at 0. saturation: [low, high], 0 is grey. value:
    [low, high] of the brightness, from 0 to 1.
    """

    hue_deg: Annotated[list[Degrees], PAIR] = Field(default_factory=lambda: [*FULL_CIRCLE_DEG])
    saturation: Annotated[list[Fraction], PAIR] = Field(default_factory=lambda: [0.0, 1.0])
    value: Annotated[list[Fraction], PAIR] = Field(default_factory=lambda: [0.0, 1.0])

    @field_validator("saturation", "value")
    @classmethod
    def _in_order(cls, pair: list[float]) -> list[float]:
        """Refuse a colour range whose limits of saturation or value are swapped."""
        if pair[0] > pair[1]:
            raise ValueError(f"[{pair[0]}, {pair[1]}] has its limits in the wrong order")
        return pair

    def range(self) -> HsvRange:
        """Return the colour range to isolate."""
        (hue_low, hue_high), (pale, vivid), (dark, bright) = (
            self.hue_deg,
            self.saturation,
            self.value,
        )
        return HsvRange((hue_low, hue_high), (pale, vivid), (dark, bright))


class IsolateColorParameters(SidedParameters):
    """name: a colour of the table; ranges: own colours; at least one of both.

    remove_specks_px, fill_holes_px: radius of morphological opening and closing. shrink_px: radius
    of an erosion, for an image whose edges are blended with the background.
    """

    shorthand = "name"

    name: str | None = None
    ranges: list[RangePart] = Field(default_factory=list)
    remove_specks_px: RadiusPx = 0
    fill_holes_px: RadiusPx = 0
    shrink_px: RadiusPx = 0

    @field_validator("name")
    @classmethod
    def _require_known_color(cls, name: str | None) -> str | None:
        if name is not None and name not in NAMED_COLORS:
            known = ", ".join(NAMED_COLORS)
            raise KeyFaultError(
                (), f"unknown colour '{name}' (known: {known})", closest_word(name, NAMED_COLORS)
            )
        return name

    @model_validator(mode="after")
    def _some(self) -> "IsolateColorParameters":
        if self.name is None and not self.ranges:
            raise ValueError("needs a colour: 'name' or 'ranges'")
        return self


@step("isolate_color", stage="filter", sensors=("camera",), parameters=IsolateColorParameters)
def isolate_color(parameters: IsolateColorParameters, context: StepContext) -> Operator:  # noqa: ARG001 - the interface of steps
    """Keep the pixels of a colour, by ranges of hue, saturation and value."""
    named = NAMED_COLORS[parameters.name] if parameters.name is not None else ()
    finder = HsvMask((*named, *(part.range() for part in parameters.ranges)))

    def operator(
        work: Masked[CameraReading],
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> Masked[CameraReading]:
        mask = finder.of(work.reading.image_bgr)
        _clean(mask, parameters)
        return Masked(work.reading, intersect_masks(mask, work.mask))

    return operator


def _clean(mask: Mask, parameters: IsolateColorParameters) -> None:
    """Apply opening, closing and erosion to the isolated colour's mask, in place."""
    for radius_px, operation in (
        (parameters.remove_specks_px, cv2.MORPH_OPEN),
        (parameters.fill_holes_px, cv2.MORPH_CLOSE),
        (parameters.shrink_px, cv2.MORPH_ERODE),
    ):
        if radius_px:
            size = 2 * radius_px + 1
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
            cv2.morphologyEx(mask, operation, disc, dst=mask)


class IsolateObjectsParameters(SidedParameters):
    """names: of objects in the world of the twin, the side that the step works on."""

    shorthand = "names"
    needs = frozenset({"ids"})

    names: Annotated[list[str], Field(min_length=1)]

    @field_validator("on")
    @classmethod
    def _only_the_twin(cls, on: str) -> str:
        if on != "twin":
            raise ValueError("only the twin's images have object ids per pixel")
        return on

    def objects(self) -> tuple[tuple[Path, str], ...]:
        """Return the names of the objects to isolate, each with its path."""
        return tuple((("names", index), name) for index, name in enumerate(self.names))


@step(
    "isolate_objects",
    stage="filter",
    sensors=lambda traits: "object_ids" in traits.ground_truth,
    parameters=IsolateObjectsParameters,
)
def isolate_objects(parameters: IsolateObjectsParameters, context: StepContext) -> Operator:
    """Keep the pixels, beams or points of objects, by the object ids of the simulator.

    object_ids: (height, width), (beams,) or (points,) uint8. Drops the overlay ("no_ids") when
    the reading has none.
    """
    table = np.zeros(256, np.uint8)
    for name in parameters.names:
        table[_id_of(name, context)] = 255

    def operator(
        work: AnyMasked,
        other: AnyMasked | None,  # noqa: ARG001 - the interface
    ) -> AnyMasked:
        ids = work.reading.object_ids
        if ids is None:
            reason = "the reading has no object ids; a drawn camera gives them with `register`"
            raise CannotMixError("no_ids", f"isolate_objects: {reason}")
        # OpenCV is faster for images, but does not accept an empty cloud.
        kept = cv2.LUT(ids, table) if ids.ndim == 2 else table[ids]
        return Masked(work.reading, intersect_masks(kept, work.mask))

    return operator


def _id_of(name: str, context: StepContext) -> int:
    """Return the id of an object to isolate. Raises UnknownObjectError."""
    if name not in context.object_ids:
        known = ", ".join(context.object_ids) or "none"
        raise UnknownObjectError(f"isolate_objects: no object '{name}' in the world ({known})")
    return context.object_ids[name]


class UnknownObjectError(ValueError):
    """The recipe isolates an object that the twin's world does not have."""
