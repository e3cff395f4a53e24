"""How files say where a vehicle may be: `geofence` of a campaign, `area` of an oracle."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from safety.areas import Area, Circle, FenceError, Polygon
from safety.geofence import Fence
from worlds.documents import KeyFaultError, Part, Path

Range = tuple[float, float]
Corner = tuple[float, float]


class BoxPart(Part):
    """A box by [low, high] of each axis, in metres of the world's local frame."""

    north_m: Range
    east_m: Range
    up_m: Range

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for key in ("north_m", "east_m", "up_m"):
            _require_ordered((key,), getattr(self, key))
        return self


class CirclePart(Part):
    """A disc by its centre and radius."""

    north_m: float
    east_m: float
    radius_m: Annotated[float, Field(gt=0)]


class AreaPart(Part):
    """A flat area: `polygon`, a list of corners [north_m, east_m], or `circle`."""

    polygon: list[Corner] | None = None
    circle: CirclePart | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        if (self.polygon is None) == (self.circle is None):
            raise ValueError("give a polygon or a circle")
        self.area()
        return self

    def area(self) -> Area:
        """Return the area. Raises KeyFaultError for a polygon that encloses nothing."""
        if self.circle is not None:
            centre_m = (self.circle.north_m, self.circle.east_m)
            return Circle(centre_m, self.circle.radius_m)
        try:
            return Polygon(tuple(self.polygon or ()))
        except FenceError as error:
            raise KeyFaultError("polygon", str(error)) from error


class FencePart(Part):
    """A `box`; or the areas of `include`, without those of `exclude`, between the two of `up_m`."""

    box: BoxPart | None = None
    include: list[AreaPart] = Field(default_factory=list)
    exclude: list[AreaPart] = Field(default_factory=list)
    up_m: Range | None = None

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if self.box is not None and self.include:
            raise KeyFaultError("include", "the box is the inclusion; give one of the two")
        if self.box is not None and self.up_m is not None:
            raise KeyFaultError("up_m", "the box has its own up_m")
        if self.box is None and (not self.include or self.up_m is None):
            raise ValueError("give a box, or include and up_m")
        if self.up_m is not None:
            _require_ordered(("up_m",), self.up_m)
        try:
            self.fence()
        except FenceError as error:
            raise ValueError(str(error)) from error
        return self

    def fence(self) -> Fence:
        """Return the fence. Raises FenceError when it leaves no place."""
        if self.box is not None:
            inclusions: tuple[Area, ...] = (Polygon.rectangle(self.box.north_m, self.box.east_m),)
            floor_up_m, ceiling_up_m = self.box.up_m
        else:
            inclusions = tuple(part.area() for part in self.include)
            floor_up_m, ceiling_up_m = self.up_m or (0.0, 0.0)
        return Fence(
            inclusions=inclusions,
            exclusions=tuple(part.area() for part in self.exclude),
            floor_up_m=floor_up_m,
            ceiling_up_m=ceiling_up_m,
        )


def _require_ordered(path: Path, limits: Range) -> None:
    low, high = limits
    if low >= high:
        raise KeyFaultError(path, f"must be [low, high], is [{low:g}, {high:g}]")
