"""The YAML schema of fences: `geofence` of a campaign, `area` of an oracle."""

from collections.abc import Callable
from functools import partial
from typing import Annotated, ClassVar, Self, TypeVar

from pydantic import Field, model_validator

from wil_campaign.foundation.files.documents import KeyFaultError, Part, Path
from wil_campaign.safety.fence.areas import Area, Circle, FenceError, Polygon
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.geographic import (
    FARTHEST_M,
    DrawnFence,
    GeoArea,
    GeoCircle,
    GeoPolygon,
    require_place,
)
from wil_campaign.worlds.geodesy import LocalFrame

T = TypeVar("T")
Coordinate = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
Range = tuple[Coordinate, Coordinate]
Corner = tuple[Coordinate, Coordinate]
Radius = Annotated[float, Field(gt=0, le=FARTHEST_M)]


class BoxPart(Part):
    """A fence's box in YAML: [low, high] of north_m, east_m or latitude_deg, longitude_deg.

    north_m, east_m: limits [low, high] in the world's local frame. latitude_deg, longitude_deg:
    limits [low, high] on WGS-84, in place of metres. up_m: limits [low, high] up from the world's
    origin.
    """

    north_m: Range | None = None
    east_m: Range | None = None
    latitude_deg: Range | None = None
    longitude_deg: Range | None = None
    up_m: Range

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        """Require a fence box in metres or in degrees, its limits ordered."""
        for key in ("north_m", "east_m", "latitude_deg", "longitude_deg", "up_m"):
            limits = getattr(self, key)
            if limits is not None:
                _require_ordered((key,), limits)
        local = (self.north_m, self.east_m)
        earth = (self.latitude_deg, self.longitude_deg)
        if not (_are_all_given(local, earth) or _are_all_given(earth, local)):
            raise ValueError("give north_m and east_m, or latitude_deg and longitude_deg")
        self.shape()
        return self

    def shape(self) -> Polygon | GeoPolygon:
        """Return the fence box's rectangle. Raises KeyFaultError for invalid coordinates."""
        if self.north_m is not None and self.east_m is not None:
            return Polygon.rectangle(self.north_m, self.east_m)
        (lat_0, lat_1), (lon_0, lon_1) = self.latitude_deg or (0, 0), self.longitude_deg or (0, 0)
        corners = ((lat_0, lon_0), (lat_1, lon_0), (lat_1, lon_1), (lat_0, lon_1))
        return _at(("latitude_deg",), lambda: GeoPolygon(corners))


class CirclePart(Part):
    """A fence's circle in YAML: north_m, east_m or latitude_deg, longitude_deg, and radius.

    north_m, east_m: its centre in the world's local frame. latitude_deg, longitude_deg: its centre
    on WGS-84, in place of metres. radius_m: the circle's radius.
    """

    north_m: Coordinate | None = None
    east_m: Coordinate | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    radius_m: Radius

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        """Require a fence circle's centre in metres or in degrees."""
        local = (self.north_m, self.east_m)
        earth = (self.latitude_deg, self.longitude_deg)
        if not (_are_all_given(local, earth) or _are_all_given(earth, local)):
            raise ValueError("give north_m and east_m, or latitude_deg and longitude_deg")
        self.shape()
        return self

    def shape(self) -> Circle | GeoCircle:
        """Return the fence circle. Raises KeyFaultError for invalid coordinates."""
        if self.north_m is not None and self.east_m is not None:
            return Circle((self.north_m, self.east_m), self.radius_m)
        centre = (self.latitude_deg or 0.0, self.longitude_deg or 0.0)
        return _at(("latitude_deg",), lambda: GeoCircle(centre, self.radius_m))


class AreaPart(Part):
    """A flat fence area in YAML: a polygon in metres or degrees, or a circle.

    polygon: its corners [north, east] in metres, at least three. polygon_deg: its corners
    [latitude, longitude] on WGS-84. circle: a centre and a radius.
    """

    polygon: list[Corner] | None = None
    polygon_deg: list[Corner] | None = None
    circle: CirclePart | None = None

    @model_validator(mode="after")
    def _one(self) -> Self:
        """Require exactly one form of a fence area."""
        given = [each for each in (self.polygon, self.polygon_deg, self.circle) if each is not None]
        if len(given) != 1:
            raise ValueError("give one of polygon, polygon_deg and circle")
        for index, corner in enumerate(self.polygon_deg or ()):
            _at(("polygon_deg", index), partial(require_place, *corner))
        self.shape()
        return self

    def shape(self) -> Area | GeoArea:
        """Return the area. Raises KeyFaultError for a polygon that encloses nothing."""
        if self.circle is not None:
            return self.circle.shape()
        if self.polygon_deg is not None:
            corners = tuple(self.polygon_deg)
            return _at(("polygon_deg",), lambda: GeoPolygon(corners))
        return _at(("polygon",), lambda: Polygon(tuple(self.polygon or ())))


class FencePart(Part):
    """A `box`; or the areas of `include` and `file`, without those of `exclude`, within `up_m`.

    file: a QGroundControl plan, a waypoint list with a fence, or GeoJSON, beside the file that
    names it. up_m: limits [low, high]
    of the areas, up from the world's origin.
    """

    may_be_empty: ClassVar[bool] = False

    box: BoxPart | None = None
    include: list[AreaPart] = Field(default_factory=list)
    exclude: list[AreaPart] = Field(default_factory=list)
    file: str | None = None
    up_m: Range | None = None

    @property
    def is_drawn(self) -> bool:
        """Return whether the YAML fence gives any area or height."""
        given = (self.box, self.include, self.exclude, self.file, self.up_m)
        return any(each not in (None, []) for each in given)

    @model_validator(mode="after")
    def _require_bounds_if_drawn(self) -> Self:
        if self.is_drawn or not self.may_be_empty:
            self._require_bounds()
        return self

    def _require_bounds(self) -> None:
        for key in ("include", "file"):
            if self.box is not None and getattr(self, key):
                raise KeyFaultError(key, "the box is the inclusion; give one of the two")
        if self.box is not None and self.up_m is not None:
            raise KeyFaultError("up_m", "the box has its own up_m")
        areas = self.include or self.exclude or self.file
        if self.box is None and (not areas or self.up_m is None):
            raise ValueError("give a box; or include, exclude or file, and up_m")
        if self.up_m is not None:
            _require_ordered(("up_m",), self.up_m)
        if not self.is_on_earth:
            try:
                self.fence()
            except FenceError as error:
                raise ValueError(str(error)) from error

    @property
    def is_on_earth(self) -> bool:
        """Return whether any area of the YAML fence is given in degrees."""
        shapes = [part.shape() for part in (*self.include, *self.exclude)]
        if self.box is not None:
            shapes.append(self.box.shape())
        in_degrees = any(isinstance(shape, GeoPolygon | GeoCircle) for shape in shapes)
        return self.file is not None or in_degrees

    def fence(self, frame: LocalFrame | None = None, drawn: DrawnFence | None = None) -> Fence:
        """Return the YAML fence in the world's frame; drawn: what is in its `file`.

        Raises FenceError when it is empty, far from the world, or geographic without a frame.
        """
        inside, outside = ((), ()) if drawn is None else drawn.local(_require_given(frame))
        if self.box is not None:
            inclusions: tuple[Area, ...] = (_local(self.box.shape(), frame),)
            floor_up_m, ceiling_up_m = self.box.up_m
        else:
            inclusions = (*(_local(part.shape(), frame) for part in self.include), *inside)
            floor_up_m, ceiling_up_m = self.up_m or (0.0, 0.0)
        return Fence(
            inclusions=inclusions,
            exclusions=(*(_local(part.shape(), frame) for part in self.exclude), *outside),
            floor_up_m=floor_up_m,
            ceiling_up_m=ceiling_up_m,
        )


def _local(shape: Area | GeoArea, frame: LocalFrame | None) -> Area:
    """Return a YAML fence's area in the world's frame."""
    if isinstance(shape, GeoPolygon | GeoCircle):
        return shape.local(_require_given(frame))
    return shape


def _require_given(frame: LocalFrame | None) -> LocalFrame:
    """Return the world's frame for a fence on Earth. Raises FenceError without one."""
    if frame is None:
        raise FenceError("far", "areas on Earth need a world with an origin")
    return frame


def _at(path: Path, make: Callable[[], T]) -> T:
    """Return the result of `make`; a FenceError becomes a fault of the YAML key."""
    try:
        return make()
    except FenceError as error:
        raise KeyFaultError(path, str(error)) from error


def _are_all_given(wanted: tuple[object, ...], others: tuple[object, ...]) -> bool:
    return None not in wanted and all(other is None for other in others)


def _require_ordered(path: Path, limits: Range) -> None:
    """Raise KeyFaultError when a fence key's [low, high] are not in order."""
    low, high = limits
    if low >= high:
        raise KeyFaultError(path, f"must be [low, high], is [{low:g}, {high:g}]")
