"""The campaign's geofence: its forms, its files, one for each vehicle, and its faults."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wil_campaign.campaigns.setup.vehicle_fences import changed_fences
from wil_campaign.foundation.files.documents import BadInput, Problem, parse_document
from wil_campaign.safety.fence.areas import FenceError, Polygon
from wil_campaign.safety.fence.fence_files import parse_fence_file, read_fence_file
from wil_campaign.safety.fence.fence_schema import FencePart
from wil_campaign.safety.fence.geofence import Fence
from wil_campaign.safety.fence.geographic import DrawnFence, GeoCircle, GeoPolygon
from wil_campaign.worlds.geodesy import LocalFrame

FRAME = LocalFrame(47.4, 8.5, 488.0)
BOX = "  box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [-0.5, 2.3]}\n"


def earth(north_m: float, east_m: float) -> tuple[float, float]:
    place = FRAME.to_geodetic((north_m, east_m, 0.0))
    return place.latitude_deg, place.longitude_deg


CORNERS = [earth(-1, -2), earth(4, -2), earth(4, 2), earth(-1, 2)]
HOLE = [earth(2, 1), earth(3, 1), earth(3, 1.5), earth(2, 1.5)]


def plan(**fence: Any) -> str:
    home = {"plannedHomePosition": [47.4, 8.5, 488.0], "items": []}
    drawn = {"circles": [], "polygons": [], "version": 2, **fence}
    document = {"fileType": "Plan", "geoFence": drawn, "mission": home, "version": 1}
    # QGroundControl's own files are indented by spaces; others come with tabs.
    return json.dumps(document, indent="\t")


def geojson(*features: dict[str, Any]) -> str:
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def lon_lat(corners: list[tuple[float, float]]) -> list[list[float]]:
    """Return a ring as GeoJSON has it: longitude first, closed."""
    ring = [[lon, lat] for lat, lon in corners]
    return [*ring, ring[0]]


PLAN = plan(
    polygons=[
        {"inclusion": True, "polygon": [list(c) for c in CORNERS], "version": 1},
        {"inclusion": False, "polygon": [list(c) for c in HOLE], "version": 1},
    ]
)
PLAN_CIRCLES = plan(
    circles=[
        {"circle": {"center": list(earth(1.5, 0)), "radius": 2.5}, "inclusion": True},
        {"circle": {"center": list(earth(2.5, 1.25)), "radius": 0.2}, "inclusion": False},
    ]
)
GEOJSON = geojson(feature("Polygon", [lon_lat(CORNERS), lon_lat(HOLE)]))
GEOJSON_PARTS = geojson(
    feature("MultiPolygon", [[lon_lat(CORNERS)]]),
    feature("Polygon", [lon_lat(HOLE)], inclusion=False),
    feature("Point", list(reversed(earth(0, 0))), inclusion=False, radius_m=0.05),
)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("cage.plan", PLAN),
        ("cage.geojson", GEOJSON),
        ("cage.json", json.dumps(feature("Polygon", [lon_lat(CORNERS), lon_lat(HOLE)]))),
        ("bare.json", json.dumps({"type": "Polygon", "coordinates": [lon_lat(CORNERS)]})),
    ],
)
def test_a_fence_from_a_file(files: Any, name: str, text: str) -> None:
    (files.folder / name).write_text(text)
    files.change(BOX, f"  file: {name}\n  up_m: [-0.5, 2.3]\n")
    campaign = files.load()
    fence = campaign.runs[0].setup().fences["real"]
    assert fence.margin_m((0.0, 0.0, 0.0)) == pytest.approx(0.5)
    assert fence.margin_m((0.0, 1.8, -1.0)) == pytest.approx(0.2, abs=1e-6)
    if name != "bare.json":
        assert fence.margin_m((2.5, 1.25, -1.0)) == pytest.approx(-0.25, abs=1e-6)
    assert files.folder / name in campaign.paths


@pytest.mark.parametrize(("text", "hole_m"), [(PLAN_CIRCLES, 0.2), (GEOJSON_PARTS, 0.25)])
def test_circles_and_exclusions_from_a_file(files: Any, text: str, hole_m: float) -> None:
    (files.folder / "drawn.json").write_text(text)
    files.change("start: {north_m: 0, east_m: 0}", "start: {north_m: 0.5, east_m: 0}")
    files.change(
        "    autopilot: ardupilot\n", "    autopilot: ardupilot\n    start: {north_m: 0.5}\n"
    )
    files.change(BOX, "  file: drawn.json\n  up_m: [-0.5, 2.3]\n")
    fence = files.load().runs[0].setup().fences["twin"]
    assert fence.margin_m((2.5, 1.25, -1.0)) == pytest.approx(-hole_m, abs=1e-6)


@pytest.mark.parametrize(
    "drawn",
    [
        (
            f"box: {{latitude_deg: [{earth(-1, 0)[0]:.9f}, {earth(4, 0)[0]:.9f}], longitude_deg: "
            f"[{earth(0, -2)[1]:.9f}, {earth(0, 2)[1]:.9f}], up_m: [-0.5, 2.3]}}"
        ),
        f"include: [{{polygon_deg: {[list(c) for c in CORNERS]}}}]\n  up_m: [-0.5, 2.3]",
        "include: [{polygon: [[-1, -2], [4, -2], [4, 2], [-1, 2]]}]\n  up_m: [-0.5, 2.3]",
    ],
)
def test_a_fence_in_metres_or_degrees(files: Any, drawn: str) -> None:
    files.change(BOX, f"  {drawn}\n")
    fence = files.load().runs[0].setup().fences["real"]
    assert fence.margin_m((0.0, 0.0, 0.0)) == pytest.approx(0.5)
    assert fence.margin_m((0.0, 1.7, -1.0)) == pytest.approx(0.3, abs=1e-3)


def test_a_fence_for_each_vehicle(files: Any) -> None:
    own = "  twin: {box: {north_m: [-9, 9], east_m: [-9, 9], up_m: [-1, 9]}}\n"
    files.change(BOX, BOX + own + "  keep_m: 0.3\n  latency_s: 0.2\n  braking_m_s2: 4\n")
    setup = files.load().runs[0].setup()
    assert setup.fences["real"].margin_m((0.0, 0.0, -1.0)) == 1.0
    assert setup.fences["twin"].margin_m((0.0, 0.0, -1.0)) == 2.0
    keeping = setup.guarding
    assert (keeping.keep_m, keeping.latency_s, keeping.braking_m_s2) == (0.3, 0.2, 4.0)


def test_a_fence_for_one_vehicle_alone(files: Any) -> None:
    files.change(BOX, "  real: {" + BOX.strip() + "}\n")
    files.change("  geofence:\n", "  geofence: {vehicle: real}\n")
    assert set(files.load().runs[0].setup().fences) == {"real"}


WRONG = [
    # what is drawn ("@" marks the place of the fault), what is said
    ("box: {north_m: @[4, -1], east_m: [-2, 2], up_m: [0, 2]}", "must be [low, high], is [4, -1]"),
    ("box: {north_m: [-1, 4], east_m: [-2, 2], up_m: @[2.3, -0.5]}", "must be [low, high]"),
    ("box: @{north_m: [-1, 4], up_m: [0, 2]}", "give north_m and east_m, or latitude_deg and"),
    ("box: {north_m: [-1, @.nan], east_m: [-2, 2], up_m: [0, 2]}", "(it must be finite)"),
    ("{include: [{polygon: @[[0, 0], [1, 1], [0, 1], [1, 0]]}], up_m: [0, 2]}", "crosses itself"),
    ("{include: [{polygon: @[]}], up_m: [0, 2]}", "a polygon needs 3 different corners, has 0"),
    ("{include: [{polygon: @[[0, 0], [1, 1], [2, 2]]}], up_m: [0, 2]}", "has no area"),
    ("{include: [@{}], up_m: [0, 2]}", "give one of polygon, polygon_deg and circle"),
    ("{include: [{circle: {north_m: 0, east_m: 0, radius_m: @0}}], up_m: [0, 2]}", "greater than"),
    ("box: {north_m: [-1, @2e5], east_m: [-2, 2], up_m: [0, 2]}", "must be at most 100000, is 2"),
    ("{include: [{polygon: [[0, 0], [0, 9], [@-1e6, 0]]}], up_m: [0, 2]}", "at least -100000"),
    (
        "{include: [{circle: {north_m: 0, east_m: @2e5, radius_m: 9}}], up_m: [0, 2]}",
        "at most 1000",
    ),
    (
        "{include: [{circle: {north_m: 0, east_m: 0, radius_m: @2e5}}], up_m: [0, 2]}",
        "at most 1000",
    ),
    (
        "{include: [{polygon_deg: [[47.4, 8.5], @[98.5, 8.6], [47.5, 8.6]]}], up_m: [0, 2]}",
        "latitude 98.5 is beyond 90 degrees; are latitude and longitude swapped?",
    ),
    (
        "{include: [{circle: {latitude_deg: @91, longitude_deg: 8, radius_m: 9}}], up_m: [0, 2]}",
        "latitude 91 is beyond 90 degrees; are",
    ),
    ("{@include: [{circle: {north_m: 0, east_m: 0, radius_m: 9}}]}", "and up_m"),
    ("{box: {north_m: [-1, 4], east_m: [-2, 2], up_m: [0, 2]}, up_m: @[0, 2]}", "has its own up_m"),
    ("{@keep_m: 0.1}", "give a box; or include, exclude or file, and up_m; or real and twin"),
    ("{file: @cage.plan, up_m: [0, 2]}", "there is no file 'cage.plan' beside the campaign"),
]


@pytest.mark.parametrize(("marked", "said"), WRONG)
def test_a_fault_of_the_fence_is_shown_where_it_is(files: Any, marked: str, said: str) -> None:
    drawn = marked.replace("@", "")
    before = "geofence:\n" + BOX
    if drawn.startswith("{"):
        files.change(before, f"geofence: {drawn}\n")
        column = 11 + marked.index("@")
    else:
        files.change(before, f"geofence:\n  {drawn}\n")
        column = 3 + marked.index("@")
    fault = files.faults()[0]
    assert said in fault
    if "give a box" not in said and "and up_m" not in said:
        line = next(
            n for n, t in enumerate(files.path.read_text().splitlines(), 1) if t.endswith(drawn)
        )
        assert fault.startswith(f"campaign.yaml:{line}:{column}: ")


def test_a_fence_far_from_the_world_is_reported_with_what_was_probably_meant(files: Any) -> None:
    corners = [[lon, lat] for lat, lon in CORNERS]
    files.change(BOX, f"  include: [{{polygon_deg: {corners}}}]\n  up_m: [-0.5, 2.3]\n")
    (fault,) = files.faults()
    assert "km from the world's origin; are latitude and longitude swapped?" in fault


def local_of(text: str, name: str = "fence.plan") -> Fence:
    """Return the fence of a file's text, 0 to 2 m high."""
    part = FencePart.model_validate({"file": name, "up_m": (0, 2)})
    return part.fence(FRAME, read_fence_file(parse_fence_file(text.encode(), name=name)))


def square(north_m: float, east_m: float, half_m: float = 2.0) -> list[tuple[float, float]]:
    """Return the corners of a square on Earth."""
    low, high = (north_m - half_m, north_m + half_m), (east_m - half_m, east_m + half_m)
    return [earth(low[0], high[0]), earth(low[1], high[0]), earth(low[1], high[1]),
            earth(low[0], high[1])]  # fmt: skip


def inclusions(*squares: list[tuple[float, float]]) -> str:
    return plan(polygons=[{"inclusion": True, "polygon": [list(c) for c in s]} for s in squares])


def waypoints(*items: tuple[int, float, tuple[float, float]]) -> str:
    """Return a fence as Mission Planner saves it: command, first parameter, place of each item."""
    rows: list[tuple[float, ...]] = [(0, 1, 0, 16, 0, 0, 0, 0, 47.4, 8.5, 488, 1)]
    for number, (command, first, (latitude_deg, longitude_deg)) in enumerate(items, start=1):
        rows.append((number, 0, 3, command, first, 0, 0, 0, latitude_deg, longitude_deg, 0, 1))
    return "\r\n".join(["QGC WPL 110", *("\t".join(map(str, row)) for row in rows), ""])


HERE, AHEAD = (0.0, 0.0, -1.0), (3.0, 0.0, -1.0)


def test_all_inclusions_of_a_plan_count_as_in_both_autopilots(files: Any) -> None:
    text = inclusions(square(0, 0), square(1.5, 0))
    fence = local_of(text)
    assert fence.margin_m((0.5, 0.0, -1.0)) == pytest.approx(1.0, abs=1e-4)
    assert fence.margin_m((-1.0, 0.0, -1.0)) < 0.0
    assert fence.margin_m(AHEAD) < 0.0
    (files.folder / "two.plan").write_text(inclusions(square(0, 0, 6), square(1.5, 0, 6)))
    files.change(BOX, "  file: two.plan\n  up_m: [-0.5, 2.3]\n")
    (said,) = [str(warning) for warning in files.load().warnings if "two.plan" in str(warning)]
    assert "has 2 inclusions: a vehicle has to be inside all of them, as in both autopilots" in said
    # In the campaign, and in GeoJSON, any counts.
    drawn = geojson(*(feature("Polygon", [lon_lat(s)]) for s in (square(0, 0), square(1.5, 0))))
    assert local_of(drawn).margin_m(AHEAD) == pytest.approx(0.5, abs=1e-4)


def test_an_inclusion_within_another_stays_as_it_is() -> None:
    circle = {"circle": {"center": list(earth(0, 0)), "radius": 1.0}, "inclusion": True}
    around = {"inclusion": True, "polygon": [list(c) for c in square(0, 0)]}
    assert local_of(plan(polygons=[around], circles=[circle])).inclusions == (
        GeoCircle(earth(0, 0), 1.0).local(FRAME),
    )
    far = {"circle": {"center": list(earth(2, 0)), "radius": 1.0}, "inclusion": True}
    cut = local_of(plan(polygons=[around], circles=[far]))
    assert cut.margin_m((1.5, 0.0, -1.0)) == pytest.approx(0.5, abs=1e-3)
    assert cut.margin_m((2.2, 0.0, -1.0)) < 0.0


def test_inclusions_with_nothing_in_common_are_refused(files: Any) -> None:
    (files.folder / "two.plan").write_text(inclusions(square(0, 0), square(9, 0)))
    files.change(BOX, "  file: two.plan\n  up_m: [-0.5, 2.3]\n")
    assert "no place is inside all 2 inclusions, as both autopilots require" in files.faults()[0]


@pytest.mark.parametrize("file_type", ["Plan", "Fence"])
def test_a_plan_of_before_qgroundcontrol_3_4_has_one_polygon(file_type: str) -> None:
    fence = {"breachReturn": [47.4, 8.5], "polygon": [list(c) for c in CORNERS], "version": 1}
    text = json.dumps({"fileType": file_type, "geoFence": fence, "version": 1})
    if file_type == "Plan":
        assert local_of(text).margin_m((0.0, 1.8, -1.0)) == pytest.approx(0.2, abs=1e-6)
    else:
        with pytest.raises(BadInput, match="must be Plan"):
            local_of(text)


def test_the_waypoints_of_mission_planner_are_a_fence(files: Any) -> None:
    text = waypoints(
        (5000, 0, earth(0, 0)),
        *((5001, 4, corner) for corner in CORNERS),
        *((5002, 4, corner) for corner in HOLE),
        (5003, 9, earth(0, 0)),
        (5004, 0.5, earth(3.5, -1.5)),
    )
    fence = local_of(text, "fence.waypoints")
    assert fence.margin_m((0.0, 1.8, -1.0)) == pytest.approx(0.2, abs=1e-3)
    assert fence.margin_m((2.5, 1.25, -1.0)) == pytest.approx(-0.25, abs=1e-3)
    assert fence.margin_m((3.5, -1.5, -1.0)) == pytest.approx(-0.5, abs=1e-3)
    (files.folder / "cage.waypoints").write_bytes(text.encode())
    files.change(BOX, "  file: cage.waypoints\n  up_m: [-0.5, 2.3]\n")
    assert files.load().runs[0].setup().fences["real"].margin_m((0.0, 1.8, 0.2)) > 0.1
    assert changed_fences(parse_fence_file(text.encode(), name="new"), FRAME, {"real": PRESENT})


def test_a_waypoint_list_without_home_loses_nothing() -> None:
    """MAVProxy saves fences so: the first area was taken for home."""
    with_home = waypoints(
        (5004, 0.5, earth(0, 0)), *((5001, 4, corner) for corner in CORNERS)
    ).split("\r\n")
    without = "\n".join([with_home[0], *with_home[2:]])
    for text in (without, "\n".join(with_home)):
        fence = local_of(text, "a.txt")
        assert fence.margin_m((0.0, 0.0, -1.0)) == pytest.approx(-0.5, abs=1e-3)
        assert fence.margin_m((0.0, 1.8, -1.0)) == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("QGC WPL 110\n", "1:1: no fence is drawn in this file"),
        (waypoints((16, 0, earth(0, 0))), "3:7: command 16 is no item of a fence"),
        (
            waypoints((5001, 3, earth(0, 0))),
            "3:1: a polygon of 3 corners begins here, and 1",
        ),
        (waypoints((5003, -1, earth(0, 0))), "3:1: a circle needs a positive radius, has -1"),
        (waypoints((5003, 2e5, earth(0, 0))), "3:1: a circle of 200 km: at most 100 km are"),
        (waypoints((5001, math.nan, earth(0, 0))), "3:1: a row of a waypoint list has 12 numbers"),
        ("QGC WPL 110\n0\n1 0 3 1e999 0 0 0 0 0 0 0 1", "2:1: a row of a waypoint list has 12"),
        (waypoints((5003, 5, (98.0, 8.5))), "3:1: latitude 98 is beyond 90 degrees"),
        (waypoints((5003, 5, earth(0, 0)))[:-20], "3:1: a row of a waypoint list has 12 numbers"),
    ],
)
def test_a_fault_of_a_waypoint_list_is_shown_where_it_is(files: Any, text: str, said: str) -> None:
    (files.folder / "cage.waypoints").write_text(text)
    files.change(BOX, "  file: cage.waypoints\n  up_m: [-0.5, 2.3]\n")
    assert files.faults()[0].startswith(f"cage.waypoints:{said}")


EXCLUDING = [
    {"type": "Exclusive"},
    {"fence_type": "exclusion"},
    {"name": "No-fly zone 3"},
    {"Inclusion": False},
    {"inclusive": "false"},
    {"exclusion": True},
    {"is_exclusion": 1},
    {"inclusion": False, "name": "hole"},
    {"fence": {"kind": "exclusion"}},
    {"name": "NFZ_12"},
    {"name": "no flight zone"},
    {"tags": ["site", "Exclusive"]},
    {"zones": [{"exclusion": True}]},
]


@pytest.mark.parametrize("named", [{"type": "restricted"}, {"name": "Danger area"}])
def test_an_area_that_may_be_meant_either_way_is_asked_for(named: dict[str, Any]) -> None:
    def drawn(**properties: Any) -> Any:
        return geojson(
            feature("Polygon", [lon_lat(CORNERS)]),
            feature("Polygon", [lon_lat(HOLE)], **named, **properties),
        )

    with pytest.raises(BadInput, match="may be an exclusion: give the property inclusion"):
        local_of(drawn())
    here = (2.5, 1.25, -1.0)
    assert local_of(drawn(inclusion=False)).margin_m(here) == pytest.approx(-0.25, abs=1e-6)
    assert local_of(drawn(inclusion=True)).margin_m(here) > 0.0


@pytest.mark.parametrize("properties", EXCLUDING)
def test_a_feature_marked_as_an_exclusion_is_an_exclusion(properties: dict[str, Any]) -> None:
    """It was flown through, as an inclusion of its own."""
    text = geojson(
        feature("Polygon", [lon_lat(CORNERS)]), feature("Polygon", [lon_lat(HOLE)], **properties)
    )
    assert local_of(text).margin_m((2.5, 1.25, -1.0)) == pytest.approx(-0.25, abs=1e-6)
    alone = {**feature("Polygon", [lon_lat(HOLE)]), "id": "exclusion-1"}
    text = geojson(feature("Polygon", [lon_lat(CORNERS)]), alone)
    assert local_of(text).margin_m((2.5, 1.25, -1.0)) == pytest.approx(-0.25, abs=1e-6)


@pytest.mark.parametrize(
    "properties",
    [{"name": "cage"}, {"exclusion": False}, {"inclusion": True}, {"Inclusive": "yes"}, {"id": 3}],
)
def test_a_feature_without_a_mark_of_exclusion_is_an_inclusion(properties: dict[str, Any]) -> None:
    text = geojson(feature("Polygon", [lon_lat(CORNERS)], **properties))
    assert local_of(text).margin_m((2.5, 1.25, -1.0)) == pytest.approx(0.75, abs=1e-6)


def test_a_feature_that_says_both_is_refused() -> None:
    both = feature("Polygon", [lon_lat(HOLE)], inclusion=True, type="Exclusive")
    with pytest.raises(BadInput, match="inclusion is true, and 'type: Exclusive' says that it is"):
        local_of(geojson(feature("Polygon", [lon_lat(CORNERS)]), both))


@pytest.mark.parametrize(
    ("system", "is_read"),
    [
        ("urn:ogc:def:crs:OGC:1.3:CRS84", True),
        ("urn:ogc:def:crs:EPSG::4326", True),
        ("EPSG:4326", True),
        ("EPSG:4314", False),
        ("urn:ogc:def:crs:EPSG:6.9:4258", False),
        ("EPSG:14326", False),
    ],
)
def test_coordinates_of_another_system_are_refused(system: str, is_read: bool) -> None:
    """Those of Germany's old system are 100 m off, and were read as WGS 84."""
    crs = {"crs": {"type": "name", "properties": {"name": system}}}
    text = json.dumps({**json.loads(GEOJSON), **crs})
    if is_read:
        assert local_of(text).margin_m((2.5, 1.25, -1.0)) == pytest.approx(-0.25, abs=1e-6)
        return
    with pytest.raises(BadInput, match="another system; export it in EPSG:4326"):
        local_of(text)


def test_a_fence_that_excludes_home_or_is_too_near_to_it(files: Any) -> None:
    files.change("up_m: [-0.5, 2.3]", "up_m: [0.1, 2.3]")
    said = "starts 0.10 m outside of the geofence's floor"
    assert [fault.partition("' ")[2] for fault in files.faults()] == [said, said]
    files.change("up_m: [0.1, 2.3]", "up_m: [-0.5, 2.3]")
    files.change(BOX, BOX + "  keep_m: 0.6\n")
    said = "starts 0.50 m from the geofence's floor, nearer than keep_m 0.6"
    assert [fault.partition("' ")[2] for fault in files.faults()] == [said, said]


BAD_FILES = [
    # text ("@" before the place of the fault), what is said
    ("@{}", "is neither a QGroundControl plan"),
    ('{"type": @"Topology"}', "a fence is polygons, or features or a FeatureCollection"),
    ('@{"fileType": "Plan", "geoFence": {"polygons": [], "circles": []}}', "no fence is drawn"),
    ('{"fileType": @"Rally", "geoFence": {}}', "must be Plan, is 'Rally'"),
    ('{"fileType": "Plan", "geoFence": {"polygons": @{}}}', "must be a list"),
    (
        (
            '{"fileType": "Plan", "geoFence": {"polygons": [{"polygon": @[[47, 8], [47.1, 8.1], '
            "[47, 8.1], [47.1, 8]]}]}}"
        ),
        "crosses itself",
    ),
    (
        (
            '{"fileType": "Plan", "geoFence": {"polygons": [{"polygon": [[47, 8], @[147, 8.1], '
            "[47, 8.1]]}]}}"
        ),
        "latitude 147 is beyond 90 degrees",
    ),
    (
        (
            '{"fileType": "Plan", "geoFence": {"circles": [{"circle": {"center": [47, 8], '
            '"radius": @-3}}]}}'
        ),
        "must be greater than 0",
    ),
    (
        (
            '{"fileType": "Plan", "geoFence": {"polygons": [{"polygon": [[47, 8], [@NaN, 8], '
            "[47, 9]]}]}}"
        ),
        "must be a number",
    ),
    (
        (
            '{"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": '
            "@[8, 47]}}"
        ),
        "a point is a circle only with the property radius_m",
    ),
    (
        '{"type": "Feature", "geometry": {"type": "LineString", "coordinates": [[8, 47]]}}',
        "must be Polygon, MultiPolygon or Point",
    ),
    ('{"type": "Polygon", "coordinates": @[]}', "a polygon without corners"),
    (
        '{"type": "Polygon", "coordinates": [@[[8, 47], [9, 47], [8, 47]]]}',
        "a polygon needs 3 different corners, has 2",
    ),
]


@pytest.mark.parametrize(("marked", "said"), BAD_FILES)
def test_a_fault_of_a_fence_file_is_shown_where_it_is(files: Any, marked: str, said: str) -> None:
    (files.folder / "drawn.json").write_text(marked.replace("@", ""))
    files.change(BOX, "  file: drawn.json\n  up_m: [-0.5, 2.3]\n")
    fault = files.faults()[0]
    assert said in fault
    if "@" in marked:
        assert fault.startswith(f"drawn.json:1:{marked.index('@') + 1}: ")


numbers = st.floats(-200, 200) | st.integers(-200, 200) | st.none() | st.just(math.nan)
values = st.recursive(
    numbers | st.sampled_from(["", "a", "1", "é"]) | st.booleans(),
    lambda inner: st.lists(inner, max_size=4),
    max_leaves=16,
)


@settings(max_examples=300)
@given(
    st.fixed_dictionaries(
        {"fileType": st.just("Plan")},
        optional={
            "geoFence": st.fixed_dictionaries(
                {},
                optional={
                    "polygons": st.lists(st.fixed_dictionaries({"polygon": values}), max_size=2)
                },
            )
        },
    )
    | st.fixed_dictionaries(
        {"type": st.sampled_from(["Polygon", "MultiPolygon", "Feature"]), "coordinates": values}
    )
)
def test_any_file_is_a_fence_or_refused_with_its_faults(document: dict[str, Any]) -> None:
    problems: tuple[Problem, ...] = ()
    drawn = DrawnFence()
    try:
        drawn = read_fence_file(parse_document(json.dumps(document).encode(), name="x.json"))
    except BadInput as error:
        problems = error.problems
    assert bool(problems) is not bool(drawn.inclusions or drawn.exclusions)


# To the millimetre: what is thinner than an atom may cross itself after a turn round the Earth.
places = st.integers(-500_000, 500_000).map(lambda millimetres: millimetres / 1000.0)


@given(st.lists(st.tuples(places, places), min_size=3, max_size=6))
def test_a_polygon_on_earth_is_the_one_in_metres(corners: list[tuple[float, float]]) -> None:
    try:
        local = FencePart.model_validate({"include": [{"polygon": corners}], "up_m": (0, 1)})
        on_earth = GeoPolygon(tuple(earth(*corner) for corner in corners))
    except ValueError:
        return
    there = DrawnFence((on_earth,), (GeoCircle(earth(0, 0), 1.0),)).local(FRAME)[0][0]
    here = local.fence().inclusions[0]
    assert isinstance(here, Polygon)
    assert isinstance(there, Polygon)
    for corner, other in zip(here.corners_m, there.corners_m, strict=True):
        assert other == pytest.approx(corner, abs=1e-5)


def test_a_fence_in_degrees_needs_a_world() -> None:
    part = FencePart.model_validate({"include": [{"polygon_deg": CORNERS}], "up_m": (0, 1)})
    with pytest.raises(FenceError, match="need a world with an origin"):
        part.fence()


def test_a_fence_file_that_cannot_be_read_is_reported(files: Any) -> None:
    Path(files.folder / "drawn.plan").write_bytes(b"\x00\x01")
    files.change(BOX, "  file: drawn.plan\n  up_m: [-0.5, 2.3]\n")
    assert "drawn.plan: is not text (it has NUL bytes)" in files.faults()[0]


def changed(text: str, **present: Fence) -> dict[str, Fence]:
    found = changed_fences(parse_document(text.encode(), name="new"), FRAME, present)
    return {str(name): fence for name, fence in found.items()}


PRESENT = Fence.box(north_m=(-9, 9), east_m=(-9, 9), up_m=(-1, 5))


def test_a_change_in_flight_says_fences_as_a_campaign_does() -> None:
    box = "{box: {north_m: [-1, 1], east_m: [-1, 1], up_m: [0, 3]}}"
    assert set(changed(box)) == {"real", "twin"}
    assert set(changed(f"twin: {box}")) == {"twin"}
    as_json = json.dumps({"box": {"north_m": [-1, 1], "east_m": [-1, 1], "up_m": [0, 3]}})
    assert changed(as_json)["real"].margin_m((0.0, 0.0, -1.0)) == 1.0


@pytest.mark.parametrize("text", [GEOJSON, PLAN.replace("\t", " ")])
def test_a_drawn_fence_keeps_floor_and_ceiling(text: str) -> None:
    fences = changed(text, real=PRESENT)
    assert set(fences) == {"real"}
    assert fences["real"].ceiling_up_m == 5
    assert fences["real"].margin_m((0.0, 0.0, -1.0)) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GEOJSON, "no vehicle has a fence whose floor and ceiling could be kept"),
        ("{file: x.plan, up_m: [0, 2]}", "send the file itself, or its areas"),
        ("{real: {file: x.plan, up_m: [0, 2]}}", "send the file itself, or its areas"),
        (
            "{box: {north_m: [-1, 1], east_m: [-1, 1], up_m: [0, 3]}, keep_m: 1}",
            "'keep_m' cannot be changed in flight",
        ),
        ("{box: {north_m: [1, -1], east_m: [-1, 1], up_m: [0, 3]}}", "must be [low, high]"),
        ("{}", "give a box; or"),
        ("{type: Polygon, coordinates: []}", "a polygon without corners"),
    ],
)
def test_a_change_that_is_no_fence_is_refused(text: str, said: str) -> None:
    with pytest.raises(BadInput) as caught:
        changed(text)
    assert said in str(caught.value)


def test_an_area_across_the_date_line_is_the_same_as_elsewhere() -> None:
    frame = LocalFrame(-17.0, 180.0, 0.0)
    corners_m = ((0, 10), (20, -10), (30, 40), (20, 20), (-40, 10))
    places = [frame.to_geodetic((north_m, east_m, 0.0)) for north_m, east_m in corners_m]
    assert {place.longitude_deg > 0.0 for place in places} == {True, False}
    corners_deg = tuple((place.latitude_deg, place.longitude_deg) for place in places)
    local = GeoPolygon(corners_deg).local(frame)
    for corner_m, here_m in zip(corners_m, local.corners_m, strict=True):
        assert here_m == pytest.approx(corner_m, abs=0.001)
