import itertools
import math
import time
from collections.abc import Callable

import pytest
import shapely
from hypothesis import assume, example, given, reject
from hypothesis import strategies as st

from wil_campaign.safety.fence.areas import Region
from wil_campaign.safety.fence.geofence import (
    _MOST_STEPS,
    _SHORTEST_STEP_M,
    Area,
    Circle,
    Fence,
    FenceError,
    Polygon,
    require_few_corners,
)
from wil_campaign.safety.fence.stopping import VehicleMotion, stopping_path
from wil_campaign.worlds.frames import Vec3, add, lerp

BOX = Fence.box(north_m=(-1.2, 4.2), east_m=(-2.7, 2.7), up_m=(-0.5, 2.3))
L_SHAPE = Polygon(((0, 0), (10, 0), (10, 4), (4, 4), (4, 10), (0, 10)))

coordinate = st.floats(-30, 30)
point = st.tuples(coordinate, coordinate, coordinate)
# Subnormal speeds only test the arithmetic of floats.
speed = st.floats(-8, 8).map(lambda x: round(x, 3))
velocity = st.tuples(speed, speed, speed)


@st.composite
def star_polygons(draw: st.DrawFn, low: int = 3, high: int = 40) -> Polygon:
    """Simple polygons, convex or not: radii at rising angles about a centre inside.

    The radii, of 0.5 to 12 m, are bytes: a list of floats takes so long to draw that Hypothesis
    gives up on a busy machine.
    """
    centre = draw(st.tuples(st.floats(-5, 5), st.floats(-5, 5)))
    radii = [0.5 + 11.5 * one / 255 for one in draw(st.binary(min_size=low, max_size=high))]
    count = len(radii)
    corners = [
        (
            centre[0] + radius * math.cos(2 * math.pi * i / count),
            centre[1] + radius * math.sin(2 * math.pi * i / count),
        )
        for i, radius in enumerate(radii)
    ]
    return Polygon(tuple(corners))


def _gear(corners: int) -> Polygon:
    """A polygon of many corners."""
    turns = [2 * math.pi * k / corners for k in range(corners)]
    return Polygon(tuple((9 * math.cos(turn), 9 * math.sin(turn)) for turn in turns))


area = star_polygons(high=12) | st.builds(
    Circle, st.tuples(st.floats(-8, 8), st.floats(-8, 8)), st.floats(0.2, 10)
)
inclusions, exclusions = st.lists(area, max_size=3), st.lists(area, max_size=2)
floor, ceiling = st.none() | st.floats(-5, 0), st.none() | st.floats(1, 20)


@st.composite
def fences(draw: st.DrawFn) -> Fence:
    try:
        return Fence(
            inclusions=draw(inclusions),
            exclusions=draw(exclusions),
            floor_up_m=draw(floor),
            ceiling_up_m=draw(ceiling),
        )
    except FenceError:
        reject()


@pytest.mark.parametrize(
    ("position", "margin_m"),
    [
        ((0, 0, -1.0), 1.2),
        ((4.0, 0, -1.0), 0.2),
        ((1.5, 0, -2.0), 0.3),
        ((1.5, 0, 0.4), 0.1),
        ((4.2, 0, -1.0), 0.0),
        ((5.2, 0, -1.0), -1.0),
        ((1.5, 0, -3.3), -1.0),
        ((7.2, 0, -6.3), -5.0),
    ],
)
def test_margin_to_a_box(position: Vec3, margin_m: float) -> None:
    assert BOX.margin_m(position) == pytest.approx(margin_m, abs=1e-9)


@given(star_polygons(), coordinate, coordinate)
def test_region_agrees_with_shapely(polygon: Polygon, north_m: float, east_m: float) -> None:
    shape = shapely.Polygon(polygon.corners_m)
    expected = shapely.Point(north_m, east_m).distance(shape.boundary)
    distance = Region([polygon]).distance_m(north_m, east_m)
    assert abs(distance) == pytest.approx(expected, abs=1e-9)
    if expected > 1e-9:
        assert (distance > 0) == shape.contains(shapely.Point(north_m, east_m))


@given(fences(), point, point.filter(lambda direction: math.hypot(*direction) > 0.1))
def test_margin_is_room_on_all_sides(fence: Fence, position: Vec3, direction: Vec3) -> None:
    margin_m = fence.margin_m(position)
    assert math.isfinite(margin_m)
    length = math.dist(direction, (0, 0, 0))
    if margin_m <= 0:
        return
    step = [0.999 * margin_m * x / length for x in direction]
    beyond = add(position, (step[0], step[1], step[2]))
    assert fence.margin_m(beyond) >= -1e-9


@given(fences(), point)
def test_inside_means_in_an_inclusion_in_no_exclusion_and_between_the_heights(
    fence: Fence, position: Vec3
) -> None:
    def within(area: Area) -> bool:
        shape = (
            shapely.Polygon(area.corners_m)
            if isinstance(area, Polygon)
            else shapely.Point(area.centre_m).buffer(area.radius_m, quad_segs=2048)
        )
        return bool(shape.contains(shapely.Point(position[:2])))

    margin_m = fence.margin_m(position)
    assume(abs(margin_m) > 1e-4)
    up_m = -position[2]
    inside = (
        (not fence.inclusions or any(map(within, fence.inclusions)))
        and not any(map(within, fence.exclusions))
        and (fence.floor_up_m is None or up_m > fence.floor_up_m)
        and (fence.ceiling_up_m is None or up_m < fence.ceiling_up_m)
    )
    assert (margin_m > 0) == inside


@given(fences(), point, velocity, st.floats(0, 0.5), st.floats(0.5, 10))
@example(Fence(floor_up_m=0.0), (0.0, 0.0, 0.0), (0.0, 8.0, 0.0), 0.0, 0.5)
def test_a_breach_is_what_a_fine_search_of_the_way_finds(
    fence: Fence, position: Vec3, speed: Vec3, late: float, brake: float
) -> None:
    motion = VehicleMotion(position, speed)
    path = stopping_path(motion, speed, latency_s=late, braking_m_s2=brake)
    end = path.end_ned_m
    way = [fence.margin_m(lerp(position, end, i / 400)) for i in range(401)]
    breach = fence.breached(motion, latency_s=late, braking_m_s2=brake)
    # A graze thinner than the search's step, or than rounding, may be seen by one of the two.
    if min(way) < -1e-6:
        assert breach is not None
    elif breach is not None:
        # A way of 50 m within a centimetre of a boundary is a breach, too: it takes too many steps.
        endless = path.length_m > _MOST_STEPS * _SHORTEST_STEP_M
        assert fence.margin_m(breach.point_ned_m) < (_SHORTEST_STEP_M if endless else 0.0)
        assert min(way) < 0.02 + math.dist(position, end) / 400
    if breach is not None:
        assert breach.predicted == (fence.margin_m(position) >= 0)


def test_a_thin_exclusion_is_not_jumped_over() -> None:
    wall = Polygon.rectangle((2.0, 2.02), (-5, 5))
    fence = Fence(inclusions=[Polygon.rectangle((-50, 50), (-50, 50))], exclusions=[wall])
    breach = fence.breached(VehicleMotion((0, 0, -1), (10.0, 0, 0)), latency_s=0.2, braking_m_s2=5)
    assert breach is not None
    assert breach.predicted
    assert breach.point_ned_m[0] == pytest.approx(2.01, abs=0.02)
    assert (
        fence.breached(VehicleMotion((0, 0, -1), (0, 10.0, 0)), latency_s=0.2, braking_m_s2=5)
        is None
    )


@given(fences(), st.lists(point, min_size=2, max_size=12))
def test_a_way_outside_is_what_a_fine_search_of_it_finds(fence: Fence, points: list[Vec3]) -> None:
    for start, end in itertools.pairwise(points):
        found = fence.outside_between(start, end, (fence.margin_m(start), fence.margin_m(end)))
        if min(fence.margin_m(start), fence.margin_m(end)) < 0.0:
            assert found is None
            continue
        searched_m = min(fence.margin_m(lerp(start, end, step / 400)) for step in range(401))
        if found is None:
            assert searched_m >= -1e-3
        else:
            share, margin_m = found
            assert margin_m < 0.0
            assert margin_m <= searched_m + 1e-3
            assert fence.margin_m(lerp(start, end, share)) == pytest.approx(margin_m)


def test_a_predicted_breach_tells_the_distance_of_the_boundary_that_it_names() -> None:
    beside_the_wall = VehicleMotion((4.1, 0.0, -1.0), (0.0, 0.0, -2.0))
    breach = BOX.breached(beside_the_wall, latency_s=0.5, braking_m_s2=2.5)
    assert breach is not None
    assert str(breach) == "cannot stop before the fence's ceiling, 1.30 m away"


@pytest.mark.parametrize(
    ("speed_m_s", "breaks"), [(0.0, False), (1.0, False), (1.9, False), (2.1, True)]
)
def test_prediction_counts_latency_and_braking(speed_m_s: float, breaks: bool) -> None:
    # 1.2 m of room north; 0.1 s and 2 m/s^2 make 1.93 m/s the most that stops in time.
    breach = BOX.breached(
        VehicleMotion((3.0, 0, -1), (speed_m_s, 0, 0)), latency_s=0.1, braking_m_s2=2.0
    )
    assert (breach is not None) == breaks


def test_keep_distance_and_words() -> None:
    breach = BOX.breached(
        VehicleMotion((4.0, 0, -1), (0, 0, 0)), latency_s=0, braking_m_s2=1, keep_m=0.3
    )
    assert breach is not None
    outside = BOX.breached(VehicleMotion((4.5, 0, -1), (0, 0, 0)), latency_s=0, braking_m_s2=1)
    assert str(outside) == "0.30 m outside of the fence's north side"
    above = BOX.breached(VehicleMotion((0, 0, -2.2), (0, 0, -2)), latency_s=0.1, braking_m_s2=2)
    assert str(above) == "cannot stop before the fence's ceiling, 0.10 m away"
    assert BOX.boundary((0, 0, 1)) == "floor"


def test_a_side_is_named_by_where_it_faces_and_an_exclusion_by_its_number() -> None:
    fence = Fence(
        inclusions=[Polygon.rectangle((-4, 4), (-4, 4))],
        exclusions=[Circle((2, 2), 0.5), Polygon.rectangle((-2, -1), (-2, -1))],
    )
    sides = {(3.9, 0): "north", (0, 3.9): "east", (-4.1, 0): "south", (0, -3.9): "west"}
    for (north_m, east_m), side in sides.items():
        assert fence.boundary((north_m, east_m, -1)) == f"{side} side"
    assert fence.boundary((4.1, 4.1, -1)) == "north-east side"
    assert fence.boundary((1.4, 2, -1)) == "exclusion 1"
    assert fence.boundary((-1.5, -1.1, -1)) == "exclusion 2"
    assert Fence(exclusions=[Circle((2, 2), 0.5)]).boundary((2, 2.4, -1)) == "exclusion"
    breach = fence.breached(VehicleMotion((3, 0, -1), (2, 0, 0)), latency_s=0.5, braking_m_s2=2)
    assert str(breach) == "cannot stop before the fence's north side, 1.00 m away"


def test_areas_unite_and_exclusions_cut() -> None:
    fence = Fence(
        inclusions=[L_SHAPE, Circle((12, 2), 3)],
        exclusions=[Circle((2, 2), 1), Polygon.rectangle((8, 9), (1, 2))],
    )
    assert fence.margin_m((10.5, 2, 0)) > 0
    assert fence.margin_m((14.5, 2, 0)) == pytest.approx(0.5)
    assert fence.margin_m((2, 2, 0)) == pytest.approx(-1.0)
    assert fence.margin_m((8.5, 1.5, 0)) == pytest.approx(-0.5)
    assert fence.margin_m((7, 7, 0)) < 0


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Polygon(((0, 0), (1, 1))), "too_few_points"),
        (lambda: Polygon(((0, 0), (1, 1), (0, 0))), "too_few_points"),
        (lambda: Polygon(((0, 0), (2, 2), (2, 0), (0, 2))), "self_intersecting"),
        (lambda: Polygon(((0, 0), (1, 1), (2, 2))), "no_area"),
        (lambda: Polygon(((0, 0), (1, math.nan), (2, 0))), "not_finite"),
        (lambda: Polygon.rectangle((1, 0), (0, 1)), "no_area"),
        (lambda: Circle((0, 0), 0), "radius"),
        (lambda: Circle((0, math.inf), 1), "not_finite"),
        (lambda: Fence(floor_up_m=3, ceiling_up_m=2), "altitude_swapped"),
        (lambda: Fence(floor_up_m=math.nan), "not_finite"),
        (Fence, "empty"),
        (
            lambda: require_few_corners(Fence(inclusions=[_gear(600), _gear(401)])),
            "too_many_points",
        ),
        (
            lambda: require_few_corners(Fence(inclusions=[Circle((0, 0), 1)] * 334)),
            "too_many_points",
        ),
        (lambda: Fence(inclusions=[Circle((0, 0), 1)], exclusions=[Circle((0, 0), 2)]), "empty"),
    ],
)
def test_a_fence_that_cannot_be_says_why(make: Callable[[], object], reason: str) -> None:
    with pytest.raises(FenceError) as caught:
        make()
    assert caught.value.reason == reason


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_position_that_is_not_finite_has_no_margin(bad: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        BOX.margin_m((0.0, bad, 0.0))


def test_a_sharp_polygon_with_little_area_is_one() -> None:
    needle = Polygon(((0, 0), (10, 0.01), (10, -0.01)))
    assert Region([needle]).distance_m(9, 0) == pytest.approx(0.009, abs=1e-3)


def test_a_path_of_an_impossible_velocity_is_a_breach_within_a_second() -> None:
    """Where a fence has no sides, a broken velocity kept the guard busy for minutes."""
    fence = Fence(exclusions=(Circle((50, 50), 5),), floor_up_m=0, ceiling_up_m=10)
    begin_s = time.process_time()
    breach = fence.breached(VehicleMotion((0, 0, -5), (1e6, 0, 0)), latency_s=0.7, braking_m_s2=2.5)
    assert breach is not None
    assert breach.predicted
    assert time.process_time() - begin_s < 2.0
