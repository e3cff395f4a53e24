"""Reads fences from files of other programs: QGroundControl, Mission Planner, GeoJSON (RFC 7946).

A plan's `geoFence` has polygons and circles, each for inclusion or exclusion, with corners
[latitude, longitude]; before QGroundControl 3.4 one polygon. Mission Planner's .waypoints have the
items of MAVLink. Of several inclusions of these a vehicle has to be inside all, as in both
autopilots (AC_PolyFence_loader::breached; Geofence::isInsidePolygonOrCircle of PX4 in 2026).
GeoJSON has corners [longitude, latitude]; a polygon's holes are exclusions, a point with the
property `radius_m` is a circle, and a feature is an exclusion by the property `inclusion: false`,
or where another property or its name says so. Heights are not read: the campaign gives them as
`up_m`.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from wil_campaign.foundation.files.documents import (
    BadInput,
    Document,
    Path,
    Problem,
    check_document,
    parse_document,
    read_document_bytes,
)
from wil_campaign.safety.fence.areas import FenceError, Point2
from wil_campaign.safety.fence.geographic import (
    DrawnFence,
    GeoArea,
    GeoCircle,
    GeoPolygon,
    require_place,
)
from wil_campaign.safety.fence.waypoint_files import (
    ROWS,
    WaypointRow,
    is_waypoint_list,
    waypoint_document,
    waypoint_rows,
)
from wil_campaign.vehicles.mavlink.fence_areas import CIRCLES, POLYGONS, RETURN_POINT


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
    """The fence of a .plan file. polygon: the only inclusion, before QGroundControl 3.4."""

    polygons: list[_PlanPolygon] = Field(default_factory=list)
    circles: list[_PlanCircle] = Field(default_factory=list)
    polygon: list[list[float]] = Field(default_factory=list)


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

    def fence(self, *, all_of: bool = False) -> DrawnFence:
        """Return the fence of the file's areas. Raises BadInput with every problem.

        all_of: whether a vehicle has to be inside all inclusions.
        """
        if not self.problems and not any(self._areas.values()):
            self.note((), "no fence is drawn in this file")
        if self.problems:
            raise BadInput(self.problems)
        return DrawnFence(tuple(self._areas[True]), tuple(self._areas[False]), all_of)

    def note(self, path: Path, message: str) -> None:
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
        if centre is not None:
            self.add(path, lambda: GeoCircle(centre, radius_m), inclusion=inclusion)


def load_fence_file(path: FilePath, name: str) -> Document:
    """Return the document of a fence file. name: what to call it in messages. Raises BadInput."""
    document = parse_fence_file(read_document_bytes(path, name), name=name)
    return replace(document, path=path)


def parse_fence_file(content: bytes, *, name: str) -> Document:
    """Return the document in a fence file's bytes: YAML, JSON or a waypoint list.

    Raises BadInput.
    """
    if is_waypoint_list(content):
        return waypoint_document(content, name=name)
    # JSON allows tabs between its tokens; the rest of it is YAML.
    return parse_document(content.replace(b"\t", b" "), name=name)


def is_fence_file(document: Document) -> bool:
    """Return whether a document is a fence file of another program."""
    others = document.get(("fileType",)) is not None or document.get((ROWS,)) is not None
    return others or isinstance(document.get(("type",)), str)


def fence_warnings(document: Document) -> Iterator[Problem]:
    """Yield what a valid fence file means that its author may not expect."""
    try:
        drawn = read_fence_file(document)
    except BadInput:
        return
    if drawn.is_common:
        path: Path = ("geoFence",) if document.get(("geoFence",)) is not None else (ROWS,)
        yield document.problem(
            path,
            f"has {len(drawn.inclusions)} inclusions: a vehicle has to be inside all of them, as "
            "in both autopilots; draw one area, or `include` them in the campaign where any is "
            "meant",
            key=True,
        )


def read_fence_file(document: Document) -> DrawnFence:
    """Return the fence in a file (.plan, GeoJSON). Raises BadInput with every problem."""
    if document.get(("fileType",)) is not None:
        return _read_plan(document)
    if document.get((ROWS,)) is not None:
        return _read_waypoints(document)
    if isinstance(document.get(("type",)), str):
        return _read_geojson(document)
    message = (
        "is neither a QGroundControl plan (fileType: Plan), nor GeoJSON (type: ...), nor a "
        "waypoint list (QGC WPL 110)"
    )
    raise BadInput([document.problem((), message)])


def _read_plan(document: Document) -> DrawnFence:
    plan = check_document(document, _Plan)
    drawing = _Drawing(document)
    for index, drawn in enumerate(plan.geoFence.polygons):
        path: Path = ("geoFence", "polygons", index, "polygon")
        drawing.polygon(path, drawn.polygon, inclusion=drawn.inclusion, longitude_first=False)
    for index, each in enumerate(plan.geoFence.circles):
        path = ("geoFence", "circles", index, "circle", "center")
        centre = drawing.place(path, each.circle.center, longitude_first=False)
        drawing.circle(path, centre, each.circle.radius, inclusion=each.inclusion)
    if plan.geoFence.polygon:
        path = ("geoFence", "polygon")
        drawing.polygon(path, plan.geoFence.polygon, inclusion=True, longitude_first=False)
    return drawing.fence(all_of=True)


def _read_waypoints(document: Document) -> DrawnFence:
    drawing = _Drawing(document)
    rows = list(waypoint_rows(document))
    at = 0
    while at < len(rows):
        at += _draw_items(drawing, rows[at:])
    return drawing.fence(all_of=True)


def _draw_items(drawing: _Drawing, rows: Sequence[WaypointRow | Path]) -> int:
    """Add the area that a waypoint list's next rows are; return how many rows it has."""
    first = rows[0]
    if not isinstance(first, WaypointRow):
        drawing.note(first, "a row of a waypoint list has 12 numbers")
    elif first.command in POLYGONS:
        return _draw_corners(drawing, first, rows)
    elif first.command in CIRCLES:
        centre = drawing.place(
            first.path, [first.latitude_deg, first.longitude_deg], longitude_first=False
        )
        inclusion = CIRCLES[first.command]
        drawing.circle(first.path, centre, first.first, inclusion=inclusion)
    elif first.command != RETURN_POINT:
        drawing.note((*first.path, 3), f"command {first.command} is no item of a fence")
    return 1


def _draw_corners(drawing: _Drawing, first: WaypointRow, rows: Sequence[WaypointRow | Path]) -> int:
    """Add a polygon of a waypoint list, whose rows each state their count; return the count."""
    count = max(1, int(first.first)) if math.isfinite(first.first) else 1
    corners = [
        row for row in rows[:count] if isinstance(row, WaypointRow) and row.command == first.command
    ]
    if len(corners) != count:
        message = f"a polygon of {first.first:g} corners begins here, and {len(corners)} follow"
        drawing.note(first.path, message)
        return len(rows)
    given = [[row.latitude_deg, row.longitude_deg] for row in corners]
    drawing.polygon(first.path, given, inclusion=POLYGONS[first.command], longitude_first=False)
    return count


_Position = Annotated[list[float], Field(min_length=2)]
_Ring = list[_Position]


class _Properties(_Foreign):
    """The properties of a GeoJSON feature in a fence file: inclusion, radius, and any others."""

    model_config = ConfigDict(extra="allow", frozen=True, strict=True, allow_inf_nan=False)

    inclusion: bool | None = None
    radius_m: Annotated[float, Field(gt=0)] | None = None

    def exclusion(self, names: Iterable[object] = ()) -> str:
        """Return what makes the feature an exclusion, other than `inclusion`; "" for nothing.

        names: of the feature, beside its properties.
        """
        for key, value in _leaves(self.model_extra or {}):
            if _EXCLUDES.search(key):
                says = not _is_false(value)
            elif _INCLUDES.match(key):
                says = _is_false(value)
            else:
                says = isinstance(value, str) and bool(_EXCLUDES.search(value[:_NAME]))
            if says:
                return f"{key}: {value}"[:_NAME]
        named = (name for name in names if isinstance(name, str) and _EXCLUDES.search(name[:_NAME]))
        return next(named, "")[:_NAME]

    def doubt(self, names: Iterable[object] = ()) -> str:
        """Return what of a feature without `inclusion` may mean either; "" for nothing."""
        if self.inclusion is not None:
            return ""
        texts = (value for _, value in _leaves(self.model_extra or {}))
        named = (one[:_NAME] for one in (*texts, *names) if isinstance(one, str))
        return next((one for one in named if _DOUBTFUL.search(one)), "")


_EXCLUDES = re.compile(
    r"exclu[ds]|no[\s_-]*fl(?:y|ight)|keep[\s_-]*out|forbidden|prohibited|(?<![a-z])nfz(?![a-z])",
    re.IGNORECASE,
)
_DOUBTFUL = re.compile(r"restrict|danger|hazard|obstacle|block(?:ed|ade)|avoid", re.IGNORECASE)
"""Of an area that may be meant either way."""
_INCLUDES = re.compile(r"(is[\s_-]*)?inclu[ds]", re.IGNORECASE)
_NAME = 60
"""Characters of a name; a longer text is prose."""


def _leaves(properties: Mapping[str, object]) -> Iterator[tuple[str, object]]:
    """Yield the single values of properties with their keys, those within others too."""
    for key, value in properties.items():
        if isinstance(value, dict):
            yield from _leaves(value)
        elif isinstance(value, list):
            for one in value:
                yield from _leaves(one if isinstance(one, dict) else {key: one})
        else:
            yield key, value


def _is_false(value: object) -> bool:
    if isinstance(value, str):
        return value.strip().lower() in {"", "false", "no", "off", "0", "none"}
    return not value


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
    id: Any = None
    name: Any = None
    properties: _Properties | None = None
    geometry: _Geometry


class _Collection(_Foreign):
    """A GeoJSON feature collection in a fence file."""

    type: Literal["FeatureCollection"]
    features: list[_Feature]


_WGS_84 = re.compile(r"(?:CRS84h?|EPSG:(?:.*:)?(?:4326|4979))$", re.IGNORECASE)
"""Names of the system that GeoJSON has; files of before RFC 7946 may name another."""


def _read_geojson(document: Document) -> DrawnFence:
    drawing = _Drawing(document)
    system = str(document.get(("crs", "properties", "name")))
    if document.get(("crs",)) is not None and not _WGS_84.search(system):
        drawing.note(("crs",), "its coordinates are of another system; export it in EPSG:4326")
    bare = _BARE.get(str(document.get(("type",))))
    if bare is not None:
        geometry = check_document(document, bare)
        _draw(drawing, ("coordinates",), geometry, _Properties(), inclusion=True)
        return drawing.fence()
    for path, feature in _features(document):
        properties = feature.properties or _Properties()
        exclusion = properties.exclusion((feature.id, feature.name))
        if exclusion and properties.inclusion:
            message = f"inclusion is true, and '{exclusion}' says that it is an exclusion"
            drawing.note((*path, "properties"), message)
        if not exclusion and (doubt := properties.doubt((feature.id, feature.name))):
            message = f"'{doubt}' may be an exclusion: give the property inclusion, true or false"
            drawing.note((*path, "properties"), message)
        inclusion = properties.inclusion is not False and not exclusion
        coordinates = (*path, "geometry", "coordinates")
        _draw(drawing, coordinates, feature.geometry, properties, inclusion=inclusion)
    return drawing.fence()


def _features(document: Document) -> Iterator[tuple[Path, _Feature]]:
    kind = document.get(("type",))
    if kind == "FeatureCollection":
        for index, each in enumerate(check_document(document, _Collection).features):
            yield ("features", index), each
    elif kind == "Feature":
        yield (), check_document(document, _Feature)
    else:
        message = "a fence is polygons, or features or a FeatureCollection of polygons and points"
        raise BadInput([document.problem(("type",), message)])


def _draw(
    drawing: _Drawing, path: Path, geometry: Any, properties: _Properties, *, inclusion: bool
) -> None:
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
