"""What mixed ranges show of virtual objects, against what geometry puts before each beam."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from wil_campaign.recipes.visibility.model import (
    ExpectedRanges,
    FrameVisibility,
    ObjectVisibility,
    VirtualObjects,
)
from wil_campaign.recipes.visibility.ranges import compare_ranges

WALL = 2
VIRTUAL = VirtualObjects({WALL: "wall"})
BEAMS = 60
DUE = slice(20, 40)
Ranges = NDArray[np.float64]


def expected(range_m: float = 4.0) -> ExpectedRanges:
    """A wall before twenty beams, and nothing else."""
    ranges_m, ids = np.full(BEAMS, np.inf), np.zeros(BEAMS, np.uint8)
    ranges_m[DUE], ids[DUE] = range_m, WALL
    return ExpectedRanges(ranges_m, ids)


def real(range_m: float = 9.0) -> Ranges:
    rng = np.random.default_rng(0)
    return range_m + 0.02 * rng.standard_normal(BEAMS)


def with_wall(range_m: float, where: slice = DUE) -> Ranges:
    twin = np.full(BEAMS, np.inf)
    twin[where] = range_m + 0.02 * np.random.default_rng(1).standard_normal(BEAMS)[where]
    return np.asarray(np.minimum(real(), twin))


def compared(mixed: Ranges, *, truly: Ranges | None = None, far_m: float = 12.0) -> FrameVisibility:
    return compare_ranges(
        t_s=1.0,
        real_m=real() if truly is None else truly,
        mixed_m=mixed,
        expected=expected(),
        virtual=VIRTUAL,
        reach_m=(0.15, far_m),
    )


def wall_of(frame: FrameVisibility) -> ObjectVisibility:
    (wall,) = frame.objects
    return wall


def test_a_wall_at_its_range_is_shown() -> None:
    wall = wall_of(compared(with_wall(4.0)))
    assert (wall.in_view, wall.is_shown, wall.is_displaced) == (True, True, False)
    assert wall.shown == 1.0
    assert wall.offset == pytest.approx(0.0, abs=0.03)


def test_ranges_that_nothing_was_mixed_into_show_no_wall() -> None:
    wall = wall_of(compared(real()))
    assert (wall.in_view, wall.is_shown, wall.offset) == (True, False, None)


@pytest.mark.parametrize("range_m", [3.0, 4.5, 6.0])
def test_a_wall_at_another_range_is_displaced(range_m: float) -> None:
    wall = wall_of(compared(with_wall(range_m)))
    assert wall.offset == pytest.approx(abs(range_m - 4.0), abs=0.05)
    assert wall.is_displaced


def test_a_wall_in_other_beams_is_not_shown_in_its_own() -> None:
    frame = compared(with_wall(4.0, slice(0, 18)))
    assert not wall_of(frame).is_shown
    assert frame.elsewhere == pytest.approx(18 / BEAMS)


def test_a_nearer_physical_surface_hides_the_wall() -> None:
    truly = real(2.0)
    assert not wall_of(compared(truly.copy(), truly=truly)).in_view


@pytest.mark.parametrize("knows", [False, True], ids=["measured", "in the world file too"])
def test_a_wall_that_is_laid_over_a_nearer_real_surface_is_unexpected(knows: bool) -> None:
    """As an overlay of scans lays it, which compares no ranges: the autonomy loses the surface."""
    truly, world = np.where(np.arange(BEAMS) < 50, 2.0, 9.0), expected()
    if knows:
        world = ExpectedRanges(truly, np.full(BEAMS, 7, np.uint8), virtual=expected())
    for mixed, is_unexpected in ((with_wall(4.0), True), (np.minimum(truly, 4.0), False)):
        frame = compare_ranges(
            t_s=1.0,
            real_m=truly,
            mixed_m=np.where(np.isfinite(expected().ranges_m), mixed, truly),
            expected=world,
            virtual=VIRTUAL,
            reach_m=(0.15, 12.0),
        )
        assert frame.is_unexpected is is_unexpected
        assert not wall_of(frame).in_view


def test_a_wall_out_of_reach_is_not_in_view() -> None:
    assert not wall_of(compared(real(), far_m=3.0)).in_view


def test_a_wall_where_nothing_is_due_is_reported() -> None:
    nothing = ExpectedRanges(np.full(BEAMS, np.inf), np.zeros(BEAMS, np.uint8))
    frame = compare_ranges(
        t_s=1.0,
        real_m=real(),
        mixed_m=with_wall(4.0),
        expected=nothing,
        virtual=VIRTUAL,
        reach_m=(0.15, 12.0),
    )
    assert frame.is_unexpected


def test_an_object_left_out_by_name_is_reported_where_beams_should_meet_it() -> None:
    due = expected()
    due.ids[30:40] = 3

    def left_out(truly: Ranges, far_m: float = 12.0) -> tuple[str, ...]:
        return compare_ranges(
            t_s=1.0,
            real_m=truly,
            mixed_m=truly,
            expected=due,
            virtual=VirtualObjects({WALL: "wall"}, {3: "intruder", 4: "decoy"}),
            reach_m=(0.15, far_m),
        ).not_mixed

    assert left_out(real()) == ("intruder",)
    assert left_out(real(2.0)) == (), "something physical hides it"
    assert left_out(real(), far_m=3.0) == ()


@pytest.mark.parametrize(("real_m", "in_view"), [(4.18, True), (4.05, False)])
def test_a_real_surface_behind_an_object_does_not_show_it(real_m: float, in_view: bool) -> None:
    """Nothing was mixed in; what is too near to the object tells nothing of it."""
    truly = np.full(BEAMS, real_m)
    wall = wall_of(compared(truly.copy(), truly=truly))
    assert (wall.in_view, wall.is_shown) == (in_view, False)
    shown = truly.copy()
    shown[DUE] = 4.02
    assert wall_of(compared(shown, truly=truly)).is_shown == in_view


def test_something_before_many_beams_beside_an_object_in_view_is_unexpected() -> None:
    mixed = with_wall(4.0)
    assert not compared(mixed).is_unexpected
    mixed[DUE.stop :] = 0.5
    assert compared(mixed).is_unexpected


@pytest.mark.parametrize(("nearest_m", "is_unexpected"), [(math.inf, True), (1.1, False)])
def test_a_single_beam_shows_an_unexpected_object(nearest_m: float, is_unexpected: bool) -> None:
    """But not where an object stands just beside its cone."""
    frame = compare_ranges(
        t_s=1.0,
        real_m=np.array([5.0]),
        mixed_m=np.array([1.0]),
        expected=ExpectedRanges(np.array([5.0]), np.array([0], np.uint8)),
        virtual=VIRTUAL,
        reach_m=(0.05, 40.0),
        least=1,
        nearest_m=nearest_m,
    )
    assert frame.is_unexpected == is_unexpected


@pytest.mark.parametrize(
    ("truly_m", "floor_m", "beams", "is_blind"),
    [
        (np.inf, 2.0, 60, True),
        (0.0, 2.0, 60, True),
        (0.12, 2.0, 60, True),  # the cover itself
        (2.0, 2.0, 60, False),
        (np.inf, 4.5, 60, False),  # farther than any sensor surely reaches
        (np.inf, 2.0, 22, False),  # 19 beams that meet it
        (np.inf, 0.1, 60, False),  # nearer than it measures
    ],
)
def test_a_covered_sensor_has_nothing_of_what_stands_before_it(
    truly_m: float, floor_m: float, beams: int, is_blind: bool
) -> None:
    """Nothing came back of it, so that virtual objects alone were mixed: PASS."""
    ranges_m, ids = np.full(BEAMS, np.inf), np.zeros(BEAMS, np.uint8)
    ranges_m[:beams], ids[:beams] = floor_m, WALL + 1
    ranges_m[:3], ids[:3] = 1.0, WALL
    truly = np.full(BEAMS, truly_m)
    frame = compare_ranges(
        t_s=1.0,
        real_m=truly,
        mixed_m=np.minimum(truly, np.where(ids == WALL, 1.0, np.inf)),
        expected=ExpectedRanges(ranges_m, ids),
        virtual=VIRTUAL,
        reach_m=(0.15, 12.0),
    )
    assert frame.is_blind == is_blind
    virtual = VirtualObjects({WALL: "wall"}, {WALL + 1: "floor"})
    assert not compare_ranges(
        t_s=1.0,
        real_m=truly,
        mixed_m=truly,
        expected=ExpectedRanges(ranges_m, ids),
        virtual=virtual,
        reach_m=(0.15, 12.0),
    ).is_blind, "what is virtual only, no real sensor sees"
