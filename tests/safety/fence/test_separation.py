"""How far apart two fences keep their vehicles, seen from above."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wil_campaign.safety.fence.geofence import Circle, Fence, Polygon
from wil_campaign.safety.fence.separation import fence_separation_m, moved_fence
from wil_campaign.worlds.frames import Pose, add, rotate

SQUARE = Fence.box(north_m=(-1.0, 1.0), east_m=(-1.0, 1.0), up_m=(0.0, 2.0))
metres = st.floats(-50.0, 50.0)
angles = st.floats(-3.1, 3.1)


def box(north_m: tuple[float, float], up_m: tuple[float, float] = (0.0, 2.0)) -> Fence:
    return Fence.box(north_m=north_m, east_m=(-1.0, 1.0), up_m=up_m)


def test_the_gap_between_fences_is_their_distance_and_height_counts_nothing() -> None:
    assert fence_separation_m(SQUARE, box((4.0, 6.0))) == pytest.approx(3.0)
    assert fence_separation_m(SQUARE, box((0.0, 6.0))) == 0.0
    assert fence_separation_m(SQUARE, box((0.0, 6.0), (50.0, 60.0))) == 0.0


def test_a_fence_without_an_edge_is_apart_from_nothing() -> None:
    hole = Fence(exclusions=(Circle((0.0, 0.0), 100.0),), floor_up_m=0.0, ceiling_up_m=2.0)
    assert fence_separation_m(SQUARE, hole) == 0.0
    assert fence_separation_m(hole, SQUARE) == 0.0


@given(angle=angles, radius_m=st.floats(0.5, 20.0))
def test_a_circle_is_never_taken_for_smaller_than_it_is(angle: float, radius_m: float) -> None:
    far_m = radius_m + 10.0
    centre = (far_m * math.cos(angle), far_m * math.sin(angle))
    circle = Fence(inclusions=(Circle(centre, radius_m),), floor_up_m=0.0, ceiling_up_m=2.0)
    point = 1e-3
    here = Fence.box(north_m=(-point, point), east_m=(-point, point), up_m=(0.0, 2.0))
    assert 10.0 - 0.01 * radius_m - 0.01 <= fence_separation_m(here, circle) <= 10.0


@given(north_m=metres, east_m=metres, yaw_rad=angles, then_rad=angles)
def test_a_moved_fence_has_the_vehicle_as_far_from_its_edge(
    north_m: float, east_m: float, yaw_rad: float, then_rad: float
) -> None:
    corners = ((-3.0, -1.0), (4.0, -1.0), (0.0, 5.0))
    fence = Fence(
        inclusions=(Polygon(corners), Circle((2.0, 1.0), 2.5)),
        exclusions=(Circle((0.0, 3.0), 0.5),),
        floor_up_m=-1.0,
        ceiling_up_m=3.0,
    )
    start = Pose.of(0.5, 0.5, 0.1, yaw_rad=yaw_rad)
    to = Pose.of(north_m, east_m, 1.1, yaw_rad=then_rad)
    there = moved_fence(fence, start=start, to=to)
    assert there.margin_m(to.position_ned_m) == pytest.approx(fence.margin_m(start.position_ned_m))
    # A metre ahead of it is as far from the edge, too.
    margins_m = [
        one.margin_m(add(pose.position_ned_m, rotate(pose.q_wxyz, (1.0, 0.0, 0.0))))
        for one, pose in ((there, to), (fence, start))
    ]
    assert margins_m[0] == pytest.approx(margins_m[1], abs=1e-9)
