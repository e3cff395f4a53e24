"""Reads fences from files of other programs: QGroundControl's .plan, and GeoJSON (RFC 7946).

A plan's `geoFence` has polygons and circles, each for inclusion or exclusion, with corners
[latitude, longitude]. GeoJSON has corners [longitude, latitude]; a polygon's holes are exclusions,
a point with the property `radius_m` is a circle, and the property `inclusion: false` makes a
feature an exclusion. Heights are not read: the campaign gives them as `up_m`.
"""

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from safety.fence.areas import FenceError, Point2
from safety.fence.geographic import DrawnFence, GeoArea, GeoCircle, GeoPolygon, require_place
from worlds.files.documents import BadInput, Document, Path, Problem, check


class _Foreign(BaseModel):
    """A part of another program's fence file; keys that are not read are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)


class _PlanPolygon(_Foreign):
    """A polygon in a QGroundControl .plan fence file."""

    inclusion: bool = True
    polygon: list[list[float]]


class _PlanDisc(_Foreign):
    """Centre and radius of a circle in a .plan fence file."""

    center: list[float]
    radius: Annotated[float, Field(gt=0)]


class _PlanCircle(_Foreign):
    """A circle in a QGroundControl .plan fence file."""

    inclusion: bool = True
    circle: _PlanDisc


class _GeoFence(_Foreign):
    polygons: list[_PlanPolygon] = Field(default_factory=list)
    circles: list[_PlanCircle] = Field(default_factory=list)


class _Plan(_Foreign):
    """A QGroundControl .plan file with its fence."""

    fileType: Literal["Plan"]  # noqa: N815  # QGroundControl's key
    geoFence: _GeoFence  # noqa: N815  # QGroundControl's key


class _Drawing:
    """Collects the areas of a fence file, and its problems with their paths."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._areas: dict[bool, list[GeoArea]] = {True: [], False: []}
        self.problems: list[Problem] = []

    def fence(self) -> DrawnFence:
        """Return the fence of the file's areas. Raises BadInput with every problem."""
        if not self.problems and not any(self._areas.values()):
            self.note((), "no fence is drawn in this file")
        if self.problems:
            raise BadInput(self.problems)
        return DrawnFence(tuple(self._areas[True]), tuple(self._areas[False]))

    def note(self, path: Path, message: str) -> None:
        """Note a problem with the value at a path of the fence file."""
        self.problems.append(self._document.problem(path, message))

    def add(self, path: Path, make: Callable[[], GeoArea], *, inclusion: bool) -> None:
        """Add an area of the fence file; an invalid one is noted as a problem at the path."""
        try:
            self._areas[inclusion].append(make())
        except FenceError as error:
            self.note(path, str(error))

    def place(self, path: Path, given: list[float], *, longitude_first: bool) -> Point2 | None:
        """Return (latitude, longitude) at a path of the fence file; None if they are invalid."""
        if len(given) < 2:
            self.note(path, f"a position needs two coordinates, this has {len(given)}")
            return None
        first, second = given[:2]
        place = (second, first) if longitude_first else (first, second)
        try:
            require_place(*place)
        except FenceError as error:
            self.note(path, str(error))
            return None
        return place

    def polygon(
        self, path: Path, given: list[list[float]], *, inclusion: bool, longitude_first: bool
    ) -> None:
        """Add a polygon of the fence file by its corners; a closing repeat is left out."""
        found = [
            self.place((*path, index), corner, longitude_first=longitude_first)
            for index, corner in enumerate(given)
        ]
        corners = [corner for corner in found if corner is not None]
        if len(corners) == len(given):
            closed = len(corners) > 1 and corners[0] == corners[-1]
            places = tuple(corners[:-1] if closed else corners)
            self.add(path, lambda: GeoPolygon(places), inclusion=inclusion)

    def circle(
        self, path: Path, centre: Point2 | None, radius_m: float, *, inclusion: bool
    ) -> None:
        """Add a circle of the fence file by centre and radius."""
        if centre is not None:
            self.add(path, lambda: GeoCircle(centre, radius_m), inclusion=inclusion)


def read_fence_file(document: Document) -> DrawnFence:
    """Return the fence in a file (.plan, GeoJSON). Raises BadInput with every problem."""
    if document.get(("fileType",)) is not None:
        return _read_plan(document)
    if isinstance(document.get(("type",)), str):
        return _read_geojson(document)
    message = "is neither a QGroundControl plan (fileType: Plan) nor GeoJSON (type: ...)"
    raise BadInput([document.problem((), message)])


def _read_plan(document: Document) -> DrawnFence:
    """Return the fence in a QGroundControl .plan file."""
    plan = check(document, _Plan)
    drawing = _Drawing(document)
    for index, drawn in enumerate(plan.geoFence.polygons):
        path: Path = ("geoFence", "polygons", index, "polygon")
        drawing.polygon(path, drawn.polygon, inclusion=drawn.inclusion, longitude_first=False)
    for index, each in enumerate(plan.geoFence.circles):
        path = ("geoFence", "circles", index, "circle", "center")
        centre = drawing.place(path, each.circle.center, longitude_first=False)
        drawing.circle(path, centre, each.circle.radius, inclusion=each.inclusion)
    return drawing.fence()


_Position = Annotated[list[float], Field(min_length=2)]
_Ring = list[_Position]


class _Properties(_Foreign):
    """The properties of a GeoJSON feature in a fence file: inclusion, radius."""

    inclusion: bool = True
    radius_m: Annotated[float, Field(gt=0)] | None = None


class _PolygonGeometry(_Foreign):
    """A GeoJSON polygon in a fence file."""

    type: Literal["Polygon"]
    coordinates: list[_Ring]


class _MultiPolygonGeometry(_Foreign):
    """A GeoJSON multi-polygon in a fence file."""

    type: Literal["MultiPolygon"]
    coordinates: list[list[_Ring]]


class _PointGeometry(_Foreign):
    """A GeoJSON point in a fence file: a circle's centre."""

    type: Literal["Point"]
    coordinates: _Position


_Geometry = Annotated[
    _PolygonGeometry | _MultiPolygonGeometry | _PointGeometry, Field(discriminator="type")
]


_BARE: dict[str, type[_PolygonGeometry | _MultiPolygonGeometry]] = {
    "Polygon": _PolygonGeometry,
    "MultiPolygon": _MultiPolygonGeometry,
}


class _Feature(_Foreign):
    """A GeoJSON feature in a fence file."""

    type: Literal["Feature"]
    properties: _Properties | None = None
    geometry: _Geometry


class _Collection(_Foreign):
    """A GeoJSON feature collection in a fence file."""

    type: Literal["FeatureCollection"]
    features: list[_Feature]


def _read_geojson(document: Document) -> DrawnFence:
    """Return the fence in a GeoJSON file."""
    drawing = _Drawing(document)
    bare = _BARE.get(str(document.get(("type",))))
    if bare is not None:
        _draw(drawing, ("coordinates",), check(document, bare), _Properties())
        return drawing.fence()
    for path, feature in _features(document):
        properties = feature.properties or _Properties()
        _draw(drawing, (*path, "geometry", "coordinates"), feature.geometry, properties)
    return drawing.fence()


def _features(document: Document) -> Iterator[tuple[Path, _Feature]]:
    """Yield the features of a GeoJSON fence file with their paths."""
    kind = document.get(("type",))
    if kind == "FeatureCollection":
        for index, each in enumerate(check(document, _Collection).features):
            yield ("features", index), each
    elif kind == "Feature":
        yield (), check(document, _Feature)
    else:
        message = "a fence is polygons, or features or a FeatureCollection of polygons and points"
        raise BadInput([document.problem(("type",), message)])


def _draw(drawing: _Drawing, path: Path, geometry: Any, properties: _Properties) -> None:
    """Add a GeoJSON geometry of a fence file to the drawing."""
    inclusion = properties.inclusion
    match geometry:
        case _PointGeometry(coordinates=centre):
            if properties.radius_m is None:
                drawing.note(path, "a point is a circle only with the property radius_m")
                return
            place = drawing.place(path, centre, longitude_first=True)
            drawing.circle(path, place, properties.radius_m, inclusion=inclusion)
        case _PolygonGeometry(coordinates=rings):
            _draw_rings(drawing, path, rings, inclusion=inclusion)
        case _MultiPolygonGeometry(coordinates=polygons):
            for index, rings in enumerate(polygons):
                _draw_rings(drawing, (*path, index), rings, inclusion=inclusion)


def _draw_rings(drawing: _Drawing, path: Path, rings: list[_Ring], *, inclusion: bool) -> None:
    """Add a GeoJSON polygon's rings to the fence: the outer one, then holes as exclusions."""
    if not rings:
        drawing.note(path, "a polygon without corners")
    for index, ring in enumerate(rings):
        if index > 0 and not inclusion:
            drawing.note((*path, index), "a hole in an exclusion: draw the exclusion around it")
            continue
        drawing.polygon(
            (*path, index), ring, inclusion=inclusion and index == 0, longitude_first=True
        )
